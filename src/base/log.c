#include "base/log.h"

#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"

static const char *const names[] = {
    [LOG_LEVEL_ERROR] = "error",
    [LOG_LEVEL_WARNING] = "warning",
    [LOG_LEVEL_INFO] = "info",
    [LOG_LEVEL_DEBUG] = "debug",
};

static atomic_int threshold = LOG_LEVEL_INFO;

void log_set_level(log_level level)
{
    atomic_store(&threshold, (int)level);
}

bool log_level_from_name(const char *name, log_level *level)
{
    for (int i = 0; i < (int)(sizeof names / sizeof *names); i++) {
        if (strcmp(names[i], name) == 0) {
            *level = (log_level)i;
            return true;
        }
    }
    return false;
}

void log_write_list(log_level level, const char *format, va_list arguments)
{
    if ((int)level > atomic_load(&threshold)) return;
    char record[2048], now[CLOCK_TEXT_SIZE];
    size_t used = (size_t)snprintf(record, sizeof record, "%s %s ",
                                   clock_format_utc(clock_wall_ms(), now), names[level]);
    /* one byte stays free for the line break */
    int wanted = vsnprintf(record + used, sizeof record - used - 1, format, arguments);
    if (wanted < 0) return;
    size_t room = sizeof record - used - 2;
    size_t length = used + ((size_t)wanted < room ? (size_t)wanted : room);
    if ((size_t)wanted > room) memcpy(record + length - 3, "...", 3);
    for (size_t i = used; i < length; i++)
        if ((unsigned char)record[i] < 0x20 || record[i] == 0x7F) record[i] = ' ';
    record[length++] = '\n';
    ssize_t written = write(STDERR_FILENO, record, length);
    (void)written; /* nowhere is left to complain to */
}

void log_write(log_level level, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    log_write_list(level, format, arguments);
    va_end(arguments);
}

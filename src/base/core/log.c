// SPDX-License-Identifier: Apache-2.0
#include "base/core/log.h"

#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/terminal_text.h"

static const char *const names[] = {LOG_LEVEL_LIST(WORDS_TEXT, )};

static atomic_int threshold = LOG_LEVEL_INFO;
static log_journal *journal;

void log_set_level(log_level level)
{
    atomic_store(&threshold, (int)level);
}

void log_set_journal(log_journal *to)
{
    journal = to;
}

bool log_level_from_name(const char *name, log_level *level)
{
    for (int i = 0; i < LOG_LEVEL_COUNT; i++) {
        if (strcmp(names[i], name) == 0) {
            *level = (log_level)i;
            return true;
        }
    }
    return false;
}

/* Maximum length of a record; longer ones are truncated. */
#define RECORD_SIZE 2048
#define CUT "..." /* the end of a truncated record */
/* Size of a value of a field: an id or a number. */
#define VALUE_SIZE 64

typedef struct field {
    const char *key;  /* key in the message, preceded by a space */
    const char *name; /* name of the field in the journal */
} field;

static const field fields[] = {
    {" job=", "HEXAD_JOB="}, {" attempt=", "HEXAD_ATTEMPT="}, {" worker=", "HEXAD_WORKER="}};
enum { FIELDS = sizeof fields / sizeof *fields };

static bool write_to_journal(log_level level, const char *message)
{
    static const char *const priorities[] = {
        [LOG_LEVEL_ERROR] = "PRIORITY=3",
        [LOG_LEVEL_WARNING] = "PRIORITY=4",
        [LOG_LEVEL_INFO] = "PRIORITY=6",
        [LOG_LEVEL_DEBUG] = "PRIORITY=7",
    };
    char text[RECORD_SIZE + 16], value[FIELDS][VALUE_SIZE];
    struct iovec parts[FIELDS + 3] = {{(char *)priorities[level], strlen(priorities[level])},
                                      {"SYSLOG_IDENTIFIER=hexad", strlen("SYSLOG_IDENTIFIER=hexad")}};
    size_t count = 2;
    parts[count++] = (struct iovec){text, (size_t)snprintf(text, sizeof text, "MESSAGE=%s", message)};
    for (size_t i = 0; i < FIELDS; i++) {
        const char *at = strstr(message, fields[i].key);
        if (!at) continue;
        at += strlen(fields[i].key);
        int length = snprintf(value[i], VALUE_SIZE, "%s%.*s", fields[i].name, (int)strcspn(at, " :,"), at);
        if (length < VALUE_SIZE) parts[count++] = (struct iovec){value[i], (size_t)length};
    }
    return journal(parts, count);
}

static void write_line(log_level level, const char *message)
{
    char line[RECORD_SIZE + 64], now[CLOCK_TEXT_SIZE];
    clock_format_utc(clock_wall_ms(), now);
    int length = snprintf(line, sizeof line, "%s %s %s\n", now, names[level], message);
    ssize_t written = write(STDERR_FILENO, line, (size_t)length);
    (void)written; /* there is no place to report an error */
}

void log_write_list(log_level level, const char *format, va_list arguments)
{
    if ((int)level > atomic_load(&threshold)) return;
    char text[RECORD_SIZE], message[RECORD_SIZE];
    int wanted = vsnprintf(text, sizeof text, format, arguments);
    if (wanted < 0) return;
    if ((size_t)wanted < sizeof text)
        while (wanted > 0 && text[wanted - 1] == '\n') text[--wanted] = '\0';
    size_t shown = terminal_text_copy(message, sizeof message - strlen(CUT), TERMINAL_TEXT_RECORD, text);
    if (shown >= sizeof message - strlen(CUT))
        strcat(message, CUT); /* a truncated text is longer than that, too */
    if (!journal || !write_to_journal(level, message)) write_line(level, message);
}

void log_write(log_level level, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    log_write_list(level, format, arguments);
    va_end(arguments);
}

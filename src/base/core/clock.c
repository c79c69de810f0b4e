// SPDX-License-Identifier: Apache-2.0
#include "base/core/clock.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

static int64_t read_ms(clockid_t clock)
{
    struct timespec now;
    clock_gettime(clock, &now);
    return (int64_t)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

int64_t clock_monotonic_ms(void)
{
    return read_ms(CLOCK_MONOTONIC);
}

int64_t clock_boot_ms(void)
{
    return read_ms(CLOCK_BOOTTIME);
}

int64_t clock_wall_ms(void)
{
    return read_ms(CLOCK_REALTIME);
}

bool clock_was_set_back(clock_watch *w)
{
    int64_t ahead = clock_wall_ms() - clock_boot_ms();
    bool back = ahead < w->ahead_ms - CLOCK_SET_BACK_MS;
    w->ahead_ms = ahead;
    return back;
}

char *clock_format_utc(int64_t wall_ms, char buffer[CLOCK_TEXT_SIZE])
{
    int64_t ms = wall_ms % 1000;
    if (ms < 0) ms += 1000;
    time_t seconds = (time_t)((wall_ms - ms) / 1000);
    struct tm utc;
    char text[24];
    if (!gmtime_r(&seconds, &utc) || !strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%S", &utc)) text[0] = '\0';
    snprintf(buffer, CLOCK_TEXT_SIZE, "%s.%03dZ", text, (int)ms);
    return buffer;
}

/* Parses "+02:00" or "Z", in minutes. False: other text. */
static bool read_offset(const char *text, int *minutes)
{
    int hours = 0, rest = 0, end = 0;
    char sign = 0;
    *minutes = 0;
    if (!*text || strcmp(text, "Z") == 0 || strcmp(text, "z") == 0) return true;
    if (sscanf(text, "%c%2d:%2d%n", &sign, &hours, &rest, &end) != 3 || text[end] || strchr(text + 1, '+') ||
        strchr(text + 1, '-'))
        return false;
    *minutes = (sign == '-' ? -1 : 1) * (60 * hours + rest);
    return (sign == '-' || sign == '+') && hours < 24 && rest < 60;
}

bool clock_parse_utc(const char *text, int64_t *wall_ms)
{
    struct tm utc = {0};
    int ms = 0, offset = 0, end = 0;
    if (strspn(text, "0123456789TtZz:.+-") != strlen(text)) return false;
    if (sscanf(text, "%4d-%2d-%2d%n", &utc.tm_year, &utc.tm_mon, &utc.tm_mday, &end) != 3) return false;
    const char *at = text + end;
    if ((*at == 'T' || *at == 't') && sscanf(at + 1, "%2d:%2d%n", &utc.tm_hour, &utc.tm_min, &end) == 2) {
        at += 1 + end;
        if (*at == ':' && sscanf(at + 1, "%2d%n", &utc.tm_sec, &end) == 1) at += 1 + end;
        if (*at == '.' && sscanf(at + 1, "%3d%n", &ms, &end) == 1) {
            for (int digits = end; digits < 3; digits++) ms *= 10;
            at += 1 + end;
            at += strspn(at, "0123456789");
        }
    }
    if (!read_offset(at, &offset)) return false;
    utc.tm_year -= 1900;
    utc.tm_mon--;
    struct tm same = utc;
    time_t seconds = timegm(&same);
    /* an invalid day or hour would be normalised to another one */
    if (ms < 0 || same.tm_mday != utc.tm_mday || same.tm_mon != utc.tm_mon || same.tm_hour != utc.tm_hour ||
        same.tm_min != utc.tm_min || same.tm_sec != utc.tm_sec)
        return false;
    *wall_ms = ((int64_t)seconds - 60 * offset) * 1000 + ms;
    return true;
}

double clock_processor_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

// SPDX-License-Identifier: Apache-2.0
/* clock: the time, in milliseconds.
 *
 * The monotonic clock is for durations and deadlines inside one process; the wall clock is for times that are
 * stored or shown. Any thread.
 */
#ifndef HEXAD_BASE_CORE_CLOCK_H
#define HEXAD_BASE_CORE_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

#define CLOCK_TEXT_SIZE 32

int64_t clock_monotonic_ms(void);
int64_t clock_boot_ms(void); /* monotonic, including time in suspension */
int64_t clock_wall_ms(void); /* since 1970-01-01T00:00:00Z */

/* Whether the wall clock was set back, by more than CLOCK_SET_BACK_MS, since the last call; true at the first
 * call. Initialise with CLOCK_WATCH. */
typedef struct clock_watch {
    int64_t ahead_ms; /* wall clock minus CLOCK_BOOTTIME */
} clock_watch;
#define CLOCK_WATCH ((clock_watch){INT64_MAX})
#define CLOCK_SET_BACK_MS 100 /* more than a delay between two readings, less than any significant wait */
bool clock_was_set_back(clock_watch *w);

/* Seconds as the nearest double, which prints without rounding errors: 0.3, not 0.30000000000000004. */
static inline double clock_seconds(int64_t ms)
{
    return (double)ms / 1000;
}

/* RFC 3339 in UTC, "2026-01-31T23:59:59.123Z"; writes into `buffer` and returns it. */
char *clock_format_utc(int64_t wall_ms, char buffer[CLOCK_TEXT_SIZE]);

/* Parses RFC 3339, or a prefix of it that ends with the day, the minute or the second; without an offset the
 * time is UTC. False, with *wall_ms unchanged: the text is no such time. */
bool clock_parse_utc(const char *text, int64_t *wall_ms);

/* CPU time of this process, all threads, in seconds. */
double clock_processor_s(void);

#endif

/* running_time: how long the program has run since a moment of the wall clock, over all its starts.
 *
 * What is kept for a time is removed only when the wall clock and the running time both say that the time is over. A
 * wall clock that was set forward therefore removes nothing. The wall clock alone decides about what began after the
 * last start and the last step of the wall clock. A step is a change of more than RUNNING_STEP_MS against CLOCK_BOOTTIME
 * between two calls. What began before that is kept for at least RUNNING_HOLD_MS after the start or the step.
 *
 * The time is a list of periods. A period begins with a start or a step and ends with the next one. The caller stores
 * the periods and hands them back at the next start. Beyond RUNNING_PERIODS_MOST, the two neighbours with the least time
 * between them become one: no running time is lost, but what began in them may be kept longer, by the time that the program
 * did not run between them. What began before the oldest counts from its beginning. Every function reads the clocks. Any
 * thread may call them.
 */
#ifndef HEXAD_BASE_RUNNING_TIME_H
#define HEXAD_BASE_RUNNING_TIME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* More than time services correct at once on hosts whose clock they keep. */
#define RUNNING_STEP_MS 60000
/* Time for an operator to notice a wrong clock and to set it right. */
#define RUNNING_HOLD_MS 3600000
/* A month of daily restarts apart. Every look for expired jobs costs a lookup for each. */
#define RUNNING_PERIODS_MOST 32
#define RUNNING_BOUNDS_MOST (RUNNING_PERIODS_MOST + 1)

typedef struct running_period {
    int64_t from_ms;   /* wall clock, as it was then */
    int64_t length_ms; /* measured by CLOCK_BOOTTIME */
} running_period;

typedef struct running_time running_time;

/* Begins a period after `count` earlier ones, oldest first. */
running_time *running_time_new(const running_period *past, size_t count);
void running_time_free(running_time *t); /* accepts NULL */

/* Whether what began at `since_ms` (wall clock) and is kept for `keep_ms` may be removed. */
bool running_time_is_over(running_time *t, int64_t since_ms, int64_t keep_ms);

/* The same for a query: what began in from_ms <= since < until_ms is over when
 * max(since, counts_from_ms) + keep <= over_ms. */
typedef struct running_bound {
    int64_t from_ms, until_ms, counts_from_ms, over_ms;
} running_bound;

/* The bounds that can be met at this moment; returns their number. */
size_t running_time_list_bounds(running_time *t, running_bound bounds[RUNNING_BOUNDS_MOST]);

/* The periods up to now, oldest first; returns their number. */
size_t running_time_list(running_time *t, running_period periods[RUNNING_PERIODS_MOST]);

#endif

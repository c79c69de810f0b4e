// SPDX-License-Identifier: Apache-2.0
/* running_time: how long the program has run since a time of the wall clock, over all its starts.
 *
 * An object with a retention time is removed only when this time has passed both by the wall clock and by the
 * running time. A wall clock that was set forward therefore removes nothing. For objects created after the
 * last start and the last step of the wall clock, only the wall clock counts. A step is a change of more than
 * RUNNING_STEP_MS against CLOCK_BOOTTIME between two calls. Objects created before a start or step are kept
 * for at least RUNNING_HOLD_MS after it.
 *
 * The time is a list of periods. A period begins with a start or a step and ends with the next one. The
 * caller stores the periods and passes them at the next start. Beyond RUNNING_PERIODS_MOST, the two
 * neighbours with the smallest gap are merged: no running time is lost, but objects created in them may be
 * kept longer, by the length of the gap. Objects created before the oldest period count from its start. Every
 * function reads the clocks. Any thread.
 */
#ifndef HEXAD_BASE_CORE_RUNNING_TIME_H
#define HEXAD_BASE_CORE_RUNNING_TIME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* More than time services correct in one step on hosts whose clock they maintain. */
#define RUNNING_STEP_MS 60000
/* Time for an operator to notice and correct a wrong clock. */
#define RUNNING_HOLD_MS 3600000
/* A month of daily restarts. Every search for expired jobs needs one lookup per period. */
#define RUNNING_PERIODS_MOST 32
#define RUNNING_BOUNDS_MOST (RUNNING_PERIODS_MOST + 1)

typedef struct running_period {
    int64_t from_ms;   /* wall clock at that time */
    int64_t length_ms; /* measured by CLOCK_BOOTTIME */
} running_period;

typedef struct running_time running_time;

/* Starts a period after `count` earlier ones, oldest first. Free it with running_time_free. */
running_time *running_time_new(const running_period *past, size_t count);
void running_time_free(running_time *t); /* accepts NULL */

/* Whether an object created at `since_ms` (wall clock) with the retention time `keep_ms` may be removed. */
bool running_time_is_over(running_time *t, int64_t since_ms, int64_t keep_ms);

/* A bound for queries: an object created in from_ms <= since < until_ms may be removed if max(since,
 * counts_from_ms) + keep <= over_ms. */
typedef struct running_bound {
    int64_t from_ms, until_ms, counts_from_ms, over_ms;
} running_bound;

/* The bounds that can be met now; returns their number. */
size_t running_time_list_bounds(running_time *t, running_bound bounds[RUNNING_BOUNDS_MOST]);

/* The periods up to now, oldest first; returns their number. */
size_t running_time_list(running_time *t, running_period periods[RUNNING_PERIODS_MOST]);

#endif

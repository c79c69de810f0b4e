// SPDX-License-Identifier: Apache-2.0
#include "base/core/running_time.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/memory.h"

struct running_time {
    pthread_mutex_t mutex;
    running_period period[RUNNING_PERIODS_MOST]; /* the last period is the current one */
    size_t count;
    int64_t wall_ms, boot_ms; /* at the last update */
};

static int64_t least(int64_t a, int64_t b)
{
    return a < b ? a : b;
}

static int64_t time_between(const running_period *a, const running_period *b)
{
    return llabs(b->from_ms - a->from_ms - a->length_ms);
}

/* Merges the two neighbours with the smallest gap. The merged period starts early enough that it counts no
 * time in which the program did not run. For objects created in its later part it counts too little, by at
 * most the gap. */
static void join_two(running_time *t)
{
    running_period *best = t->period;
    for (running_period *p = t->period + 1; p + 1 < t->period + t->count; p++)
        if (time_between(p, p + 1) < time_between(best, best + 1)) best = p;
    best->from_ms = least(best->from_ms, best[1].from_ms - best->length_ms);
    best->length_ms += best[1].length_ms;
    memmove(best + 1, best + 2, (size_t)(t->period + t->count - (best + 2)) * sizeof *best);
    t->count--;
}

static void begin_period(running_time *t, int64_t from_ms)
{
    if (t->count == RUNNING_PERIODS_MOST) join_two(t);
    t->period[t->count++] = (running_period){.from_ms = from_ms};
}

/* Extends the last period to now. After a step of the wall clock, the time since the last update belongs to a
 * new period, because the step may have been at its start. */
static void update(running_time *t)
{
    int64_t wall = clock_wall_ms(), passed = clock_boot_ms() - t->boot_ms, step = wall - t->wall_ms - passed;
    if (step > RUNNING_STEP_MS || step < -RUNNING_STEP_MS) begin_period(t, wall - passed);
    t->period[t->count - 1].length_ms += passed;
    t->wall_ms = wall;
    t->boot_ms += passed;
}

running_time *running_time_new(const running_period *past, size_t count)
{
    running_time *t = mem_alloc(sizeof *t);
    size_t kept = count < RUNNING_PERIODS_MOST ? count : RUNNING_PERIODS_MOST;
    pthread_mutex_init(&t->mutex, NULL);
    for (size_t i = 0; i < kept; i++) t->period[i] = past[count - kept + i];
    t->count = kept;
    t->wall_ms = clock_wall_ms();
    t->boot_ms = clock_boot_ms();
    begin_period(t, t->wall_ms);
    return t;
}

void running_time_free(running_time *t)
{
    if (!t) return;
    pthread_mutex_destroy(&t->mutex);
    free(t);
}

/* After a step backwards, a time of the wall clock may belong to several periods. The last of these is used:
 * it gives the shortest running time. */
static size_t list_bounds(const running_time *t, running_bound bounds[])
{
    size_t count = 0, last = t->count - 1;
    bool held = t->period[last].length_ms < RUNNING_HOLD_MS;
    int64_t until = INT64_MAX, after_ms = 0, over = t->wall_ms;
    for (size_t i = t->count; i-- > 0; after_ms += t->period[i].length_ms) {
        const running_period *p = &t->period[i];
        if (i < last) over = least(p->from_ms + p->length_ms + after_ms, t->wall_ms);
        if ((i == last || !held) && p->from_ms < until)
            bounds[count++] = (running_bound){p->from_ms, until, p->from_ms, over};
        until = least(until, p->from_ms);
    }
    if (!held) bounds[count++] = (running_bound){INT64_MIN, until, t->period[0].from_ms, over};
    return count;
}

size_t running_time_list_bounds(running_time *t, running_bound bounds[RUNNING_BOUNDS_MOST])
{
    pthread_mutex_lock(&t->mutex);
    update(t);
    size_t count = list_bounds(t, bounds);
    pthread_mutex_unlock(&t->mutex);
    return count;
}

bool running_time_is_over(running_time *t, int64_t since_ms, int64_t keep_ms)
{
    running_bound bounds[RUNNING_BOUNDS_MOST];
    size_t count = running_time_list_bounds(t, bounds);
    for (size_t i = 0; i < count; i++) {
        const running_bound *b = &bounds[i];
        if (b->from_ms > since_ms || since_ms >= b->until_ms) continue;
        return (since_ms > b->counts_from_ms ? since_ms : b->counts_from_ms) <= b->over_ms - keep_ms;
    }
    return false;
}

size_t running_time_list(running_time *t, running_period periods[RUNNING_PERIODS_MOST])
{
    pthread_mutex_lock(&t->mutex);
    update(t);
    size_t count = t->count;
    memcpy(periods, t->period, count * sizeof *periods);
    pthread_mutex_unlock(&t->mutex);
    return count;
}

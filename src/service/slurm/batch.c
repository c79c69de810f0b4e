// SPDX-License-Identifier: Apache-2.0
/* batch: attempts that are submitted together, and the counts of those that are still to run. */
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "service/slurm/engine_data.h"

slurm_batch *slurm_batch_find(slurm *s, const char *name)
{
    slurm_batch *b;
    LIST_FOREACH (b, &s->batches, link)
        if (strcmp(b->name, name) == 0) return b;
    return NULL;
}

slurm_batch *slurm_batch_new(slurm *s, const char *name, bool shared)
{
    slurm_batch *b = mem_alloc(sizeof *b);
    b->name = mem_strdup(name);
    b->shared = shared;
    LIST_INSERT_HEAD(&s->batches, b, link);
    return b;
}

slurm_task *slurm_batch_task(slurm *s, slurm_batch *b, size_t number)
{
    if (number >= b->task_count) b->tasks = mem_resize(b->tasks, (number + 1) * sizeof *b->tasks);
    for (; b->task_count <= number; b->task_count++)
        b->tasks[b->task_count] = (slurm_task){.listing = s->listing, .seen_ms = clock_monotonic_ms()};
    return &b->tasks[number];
}

void slurm_batch_release(slurm_batch *b)
{
    if (--b->users) return;
    LIST_REMOVE(b, link);
    free(b->name);
    free(b->list);
    free(b->tasks);
    free(b);
}

/* Adds `change` to the counts of the batch's attempts to run, if the attempt is one of them. */
static void count(const engine_attempt *a, size_t change)
{
    slurm_batch *b = a->batch;
    if (!b || a->cancelled) return;
    bool open = b->shared && !a->is_claimed;
    *(open ? &b->open : &b->tasks[a->task].wanted) += change;
    b->wanted += change;
    if (open) a->place->open += change;
}

void slurm_enter(engine_attempt *a, slurm_batch *b, size_t task)
{
    slurm_batch_task(a->place, b, task);
    b->users++;
    a->batch = b;
    a->task = task;
    a->is_claimed = a->has_predecessor = false;
    count(a, 1);
}

void slurm_take(engine_attempt *a, const attempt_files_batch *by)
{
    slurm *s = a->place;
    slurm_batch *own = a->batch, *b = slurm_batch_find(s, by->name);
    if (!b) b = slurm_batch_new(s, by->name, true);
    own->users++;
    slurm_leave(a);
    slurm_enter(a, b, (size_t)by->task);
    count(a, (size_t)-1);
    a->is_claimed = true;
    a->has_predecessor = by->number > 0;
    count(a, 1);
    if (own->shared && !own->open) slurm_list_soon(s); /* tasks that wait have nothing to do */
    slurm_batch_release(own);
}

void slurm_forsake(engine_attempt *a)
{
    count(a, (size_t)-1); /* no effect if it was cancelled before */
    a->cancelled = true;
}

void slurm_leave(engine_attempt *a)
{
    if (!a->batch) return;
    count(a, (size_t)-1);
    slurm_batch_release(a->batch);
    a->batch = NULL;
}

void slurm_list_soon(slurm *s)
{
    s->list_due_ms = 0;
    runner_wake(s->commands);
}

// SPDX-License-Identifier: Apache-2.0
/* runner: background work of the daemon. A task does a step, then waits for a time or for a wake-up, then
 * does the next.
 *
 * Each task has a thread, because steps wait for disks, databases and receivers. Tasks are added while the
 * service is set up; they start together, and end together before the objects that they use are freed.
 * ARCHITECTURE.md, Threads of the daemon, lists the tasks, and the threads that are none.
 */
#ifndef HEXAD_BASE_CORE_RUNNER_H
#define HEXAD_BASE_CORE_RUNNER_H

#include <stdbool.h>
#include <stdint.h>

#include "base/core/error.h"

/* Wait after an error that may pass, such as one of the database while the disk is full, in milliseconds.
 * Short enough to recover soon, long enough not to occupy a CPU or the disk. */
#define RUNNER_RETRY_MS 1000
/* The time after this wait. */
int64_t runner_retry_time(void);
/* A time that is never reached: the step follows a wake-up only. */
#define RUNNER_WHEN_WOKEN INT64_MAX

typedef struct runner runner;
typedef struct runner_task runner_task;

/* Returns the time of the next step (clock_monotonic_ms; a past time: at once). */
typedef int64_t runner_step(void *context);

runner *runner_new(void);
/* After runner_stop, or if nothing was started. Tasks are invalid afterwards. Accepts NULL. */
void runner_free(runner *r);

/* Adds a task. `name` is the name of its thread, at most 15 bytes, and is not copied. The first step begins
 * at runner_start. */
runner_task *runner_add(runner *r, const char *name, runner_step *step, void *context);

/* Starts all tasks, in the order in which they were added. Each does one step at least. On failure some have
 * been started; call runner_stop. Error: internal. */
bool runner_start(runner *r, error *e);

/* Requests the end of all tasks, then waits for each of them, the last started first. Steps in progress are
 * completed; long ones check runner_is_stopping. */
void runner_stop(runner *r);

/* The next step begins at once. A wake-up during a step causes another step. Any thread, also before the
 * start and after the end. */
void runner_wake(runner_task *t);

/* Whether runner_stop was called. Any thread. */
bool runner_is_stopping(const runner_task *t);

#endif

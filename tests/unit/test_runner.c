// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <errno.h>
#include <pthread.h>
#include <sched.h>
#include <semaphore.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "base/core/runner.h"

enum { TASKS = 3, NAME_SIZE = 16 };

typedef struct work {
    runner_task *task;
    sem_t began;       /* counts steps */
    sem_t may_end;     /* a step waits for it if `held` */
    bool held;         /* steps wait */
    int64_t next_ms;   /* what steps return */
    int64_t next_once; /* what the first step returns, unless it is 0 */
    atomic_int steps;
    char name[NAME_SIZE];
    int64_t stepped_ms; /* start of the last step */
} work;

typedef struct place {
    runner *r;
    work work[TASKS];
} place;

static int64_t step(void *context)
{
    work *w = context;
    const bool first = atomic_fetch_add(&w->steps, 1) == 0;
    w->stepped_ms = clock_monotonic_ms();
    pthread_getname_np(pthread_self(), w->name, sizeof w->name);
    sem_post(&w->began);
    if (w->held) sem_wait(&w->may_end);
    return first && w->next_once ? w->next_once : w->next_ms;
}

static int set_up(void **state)
{
    place *p = mem_alloc(sizeof *p);
    p->r = runner_new();
    for (int i = 0; i < TASKS; i++) {
        sem_init(&p->work[i].began, 0, 0);
        sem_init(&p->work[i].may_end, 0, 0);
        p->work[i].next_ms = RUNNER_WHEN_WOKEN;
    }
    *state = p;
    return 0;
}

static int tear_down(void **state)
{
    place *p = *state;
    runner_stop(p->r);
    runner_free(p->r);
    for (int i = 0; i < TASKS; i++) {
        sem_destroy(&p->work[i].began);
        sem_destroy(&p->work[i].may_end);
    }
    free(p);
    return 0;
}

static work *add(place *p, int number)
{
    static const char *const names[TASKS] = {"first", "second", "third"};
    work *w = &p->work[number];
    w->task = runner_add(p->r, names[number], step, w);
    return w;
}

static void start(place *p)
{
    error e = {0};
    if (!runner_start(p->r, &e)) fail_msg("%s", e.message);
}

static void test_every_task_does_a_step_at_the_start_in_a_thread_of_its_name(void **state)
{
    place *p = *state;
    for (int i = 0; i < TASKS; i++) add(p, i);
    start(p);
    for (int i = 0; i < TASKS; i++) sem_wait(&p->work[i].began);
    runner_stop(p->r);
    assert_string_equal(p->work[0].name, "first");
    assert_string_equal(p->work[2].name, "third");
    for (int i = 0; i < TASKS; i++) assert_int_equal(p->work[i].steps, 1);
}

static void test_a_wake_up_causes_a_step_of_its_task_only(void **state)
{
    place *p = *state;
    work *woken = add(p, 0), *other = add(p, 1);
    start(p);
    sem_wait(&woken->began);
    sem_wait(&other->began);
    runner_wake(woken->task);
    sem_wait(&woken->began);
    runner_stop(p->r);
    assert_int_equal(woken->steps, 2);
    assert_int_equal(other->steps, 1);
}

static void test_wake_ups_during_a_step_cause_one_more_step(void **state)
{
    place *p = *state;
    work *w = add(p, 0);
    w->held = true;
    start(p);
    sem_wait(&w->began);
    for (int i = 0; i < 5; i++) runner_wake(w->task);
    sem_post(&w->may_end);
    sem_wait(&w->began);
    sem_post(&w->may_end);
    runner_wake(w->task); /* the second step has taken the first five */
    sem_wait(&w->began);
    sem_post(&w->may_end);
    runner_stop(p->r);
    assert_int_equal(w->steps, 3);
}

static void test_a_step_follows_at_the_time_that_the_last_one_returned(void **state)
{
    place *p = *state;
    work *w = add(p, 0);
    w->next_once = clock_monotonic_ms() + 30;
    /* near a whole second, rounding to seconds would not be detected */
    if (w->next_once % 1000 < 30) w->next_once += 30;
    start(p);
    sem_wait(&w->began);
    sem_wait(&w->began);
    runner_stop(p->r);
    assert_true(w->stepped_ms >= w->next_once);
    assert_int_equal(w->steps, 2);
}

static void test_a_step_follows_at_once_if_its_time_has_passed(void **state)
{
    enum { STEPS = 1000 };
    place *p = *state;
    work *w = add(p, 0);
    w->next_ms = 0;
    start(p);
    for (int i = 0; i < STEPS; i++) sem_wait(&w->began);
    runner_stop(p->r);
    assert_true(w->steps >= STEPS);
}

static void test_a_wake_up_ends_the_wait_after_an_error(void **state)
{
    place *p = *state;
    work *w = add(p, 0);
    w->next_ms = runner_retry_time();
    assert_in_range(w->next_ms - clock_monotonic_ms(), 1, RUNNER_RETRY_MS);
    w->next_ms += 3600000; /* so that only the wake-up can end it */
    start(p);
    sem_wait(&w->began);
    runner_wake(w->task);
    sem_wait(&w->began);
    runner_stop(p->r);
    assert_int_equal(w->steps, 2);
}

static void *stop(void *argument)
{
    place *p = argument;
    runner_stop(p->r);
    return NULL;
}

/* The step in progress sees the end, is completed, and is the last one. */
static void test_a_stop_waits_for_the_step_in_progress(void **state)
{
    place *p = *state;
    work *w = add(p, 0);
    pthread_t stopper;
    w->held = true;
    w->next_ms = 0;
    start(p);
    sem_wait(&w->began);
    assert_false(runner_is_stopping(w->task));
    assert_int_equal(pthread_create(&stopper, NULL, stop, p), 0);
    while (!runner_is_stopping(w->task)) sched_yield();
    assert_int_equal(pthread_tryjoin_np(stopper, NULL), EBUSY);
    sem_post(&w->may_end);
    pthread_join(stopper, NULL);
    assert_int_equal(w->steps, 1);
}

static void test_a_stop_ends_tasks_that_wait(void **state)
{
    place *p = *state;
    for (int i = 0; i < TASKS; i++) add(p, i);
    p->work[1].next_ms = clock_monotonic_ms() + 3600000;
    start(p);
    for (int i = 0; i < TASKS; i++) sem_wait(&p->work[i].began);
    runner_stop(p->r);
    for (int i = 0; i < TASKS; i++) assert_int_equal(p->work[i].steps, 1);
}

static void test_tasks_may_be_woken_before_the_start_and_after_the_end(void **state)
{
    place *p = *state;
    work *w = add(p, 0);
    runner_wake(w->task);
    runner_stop(p->r); /* nothing was started */
    runner_wake(w->task);
    assert_int_equal(w->steps, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_every_task_does_a_step_at_the_start_in_a_thread_of_its_name,
                                        set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_wake_up_causes_a_step_of_its_task_only, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_wake_ups_during_a_step_cause_one_more_step, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_step_follows_at_the_time_that_the_last_one_returned, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(test_a_step_follows_at_once_if_its_time_has_passed, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(test_a_wake_up_ends_the_wait_after_an_error, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_stop_waits_for_the_step_in_progress, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_stop_ends_tasks_that_wait, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_tasks_may_be_woken_before_the_start_and_after_the_end, set_up,
                                        tear_down),
    };
    return cmocka_run_group_tests_name("runner", tests, NULL, NULL);
}

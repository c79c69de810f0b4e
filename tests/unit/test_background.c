// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "base/core/background.h"
#include "base/core/clock.h"

typedef struct place {
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    bool asked, answered;
} place;

static void *answer(void *argument)
{
    place *p = argument;
    pthread_mutex_lock(&p->mutex);
    while (!p->asked) pthread_cond_wait(&p->changed, &p->mutex);
    p->answered = true;
    pthread_cond_broadcast(&p->changed);
    pthread_mutex_unlock(&p->mutex);
    return NULL;
}

static void test_a_waiting_thread_is_woken(void **state)
{
    (void)state;
    enum { PATIENCE_MS = 60000 };
    place p = {.mutex = PTHREAD_MUTEX_INITIALIZER};
    pthread_t thread;
    error e = {0};
    background_init_condition(&p.changed);
    assert_true(background_start(&thread, answer, &p, "the test", &e));
    pthread_mutex_lock(&p.mutex);
    p.asked = true;
    pthread_cond_broadcast(&p.changed);
    int64_t until_ms = clock_monotonic_ms() + PATIENCE_MS;
    while (!p.answered && background_wait_until(&p.changed, &p.mutex, until_ms)) {
    }
    assert_true(p.answered);
    pthread_mutex_unlock(&p.mutex);
    pthread_join(thread, NULL);
    pthread_cond_destroy(&p.changed);
}

static void test_a_wait_ends_at_its_deadline(void **state)
{
    (void)state;
    place p = {.mutex = PTHREAD_MUTEX_INITIALIZER};
    background_init_condition(&p.changed);
    pthread_mutex_lock(&p.mutex);
    assert_false(background_wait_until(&p.changed, &p.mutex, 0)); /* a deadline in the past */
    int64_t until_ms = clock_monotonic_ms() + 5;
    while (background_wait_until(&p.changed, &p.mutex, until_ms)) {
    }
    assert_true(clock_monotonic_ms() >= until_ms);
    pthread_mutex_unlock(&p.mutex);
    pthread_cond_destroy(&p.changed);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_waiting_thread_is_woken),
        cmocka_unit_test(test_a_wait_ends_at_its_deadline),
    };
    return cmocka_run_group_tests_name("background", tests, NULL, NULL);
}

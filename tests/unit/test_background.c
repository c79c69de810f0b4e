// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <sys/eventfd.h>
#include <unistd.h>

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

static void set(void *argument)
{
    *(bool *)argument = true;
}

static void test_a_call_writes_to_its_descriptor_at_its_end(void **state)
{
    (void)state;
    bool is_set = false;
    uint64_t count = 0;
    int fd = eventfd(0, EFD_CLOEXEC);
    background_call *c = background_call_start(set, &is_set, fd);
    assert_int_equal(read(fd, &count, sizeof count), sizeof count); /* waits for the end */
    assert_int_equal(count, 1);
    assert_true(background_call_has_ended(c));
    background_call_end(c);
    assert_true(is_set);
    close(fd);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_waiting_thread_is_woken),
        cmocka_unit_test(test_a_wait_ends_at_its_deadline),
        cmocka_unit_test(test_a_call_writes_to_its_descriptor_at_its_end),
    };
    return cmocka_run_group_tests_name("background", tests, NULL, NULL);
}

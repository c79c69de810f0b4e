// SPDX-License-Identifier: Apache-2.0
/* thread_pool: the order of work, and the end of work when the pool stops. */
#include <pthread.h>
#include <semaphore.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <sys/resource.h>

#include <cmocka.h>

#include "base/core/clock.h"
#include "service/http/thread_pool.h"
#include "service/ledger/ledger.h"

/* Longer than any test takes. */
#define PATIENT_MS 1000000

static struct {
    pthread_mutex_t mutex;
    char order[64];          /* names of the work that began; in capitals: of the work that was refused */
    thread_pool_refusal why; /* of the last refusal */
    sem_t began, ended;      /* refused work counts as begun */
} seen = {.mutex = PTHREAD_MUTEX_INITIALIZER};

typedef struct piece {
    thread_pool_work work; /* first member */
    char name;
    bool blocks; /* it runs until may_end */
    int priority;
    sem_t may_end;
} piece;

static void note(char name)
{
    pthread_mutex_lock(&seen.mutex);
    seen.order[strlen(seen.order)] = name;
    pthread_mutex_unlock(&seen.mutex);
}

static void run(thread_pool_work *work)
{
    piece *p = (piece *)(void *)work;
    note(p->name);
    sem_post(&seen.began);
    if (p->blocks) sem_wait(&p->may_end);
    sem_post(&seen.ended);
}

static void refuse(thread_pool_work *work, thread_pool_refusal why)
{
    seen.why = why;
    note((char)(((piece *)(void *)work)->name - 'a' + 'A'));
    sem_post(&seen.began);
}

static piece piece_of(const char *user, char name, bool blocks)
{
    return (piece){.work = {.run = run, .refuse = refuse, .user = user}, .name = name, .blocks = blocks};
}

static ledger *counts;

static thread_pool *start(unsigned threads, unsigned most_of_user, int64_t patience_ms)
{
    ledger_limit(counts, LEDGER_THREADS, (ledger_limits){.holder = most_of_user});
    thread_pool *p = thread_pool_start(&(thread_pool_settings){.threads = threads,
                                                               .counts = counts,
                                                               .kind = LEDGER_THREADS,
                                                               .most_weight = 10,
                                                               .patience_ms = patience_ms},
                                       NULL);
    assert_non_null(p);
    return p;
}

static int set_up(void **state)
{
    (void)state;
    memset(seen.order, 0, sizeof seen.order);
    counts = ledger_new();
    sem_init(&seen.began, 0, 0);
    sem_init(&seen.ended, 0, 0);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    ledger_free(counts);
    return 0;
}

static void wait_for(sem_t *what, int count)
{
    for (int i = 0; i < count; i++) sem_wait(what);
}

static void test_users_are_served_in_turn(void **state)
{
    piece first = piece_of("ann", 'a', true),
          rest[] = {piece_of("ann", 'b', false), piece_of("ann", 'c', false), piece_of("bob", 'd', false),
                    piece_of("bob", 'e', false), piece_of("cat", 'f', false)};
    (void)state;
    thread_pool *p = start(1, 1, PATIENT_MS);
    thread_pool_add(p, &first.work);
    wait_for(&seen.began, 1);
    for (size_t i = 0; i < sizeof rest / sizeof *rest; i++) thread_pool_add(p, &rest[i].work);
    sem_post(&first.may_end);
    wait_for(&seen.ended, 6);
    thread_pool_stop(p);
    assert_string_equal(seen.order, "abdfce");
}

static void test_the_user_with_fewer_running_pieces_is_next(void **state)
{
    piece held[] = {piece_of("ann", 'a', true), piece_of("ann", 'b', true), piece_of("bob", 'c', true)},
          rest[] = {piece_of("ann", 'd', false), piece_of("bob", 'e', false)};
    (void)state;
    thread_pool *p = start(3, 3, PATIENT_MS);
    for (size_t i = 0; i < 3; i++) {
        thread_pool_add(p, &held[i].work);
        wait_for(&seen.began, 1);
    }
    for (size_t i = 0; i < 2; i++) thread_pool_add(p, &rest[i].work);
    sem_post(&held[2].may_end); /* ann has two threads, and was served less recently */
    wait_for(&seen.ended, 3);
    sem_post(&held[0].may_end);
    sem_post(&held[1].may_end);
    wait_for(&seen.ended, 2);
    thread_pool_stop(p);
    assert_string_equal(seen.order, "abced");
}

static void test_a_thread_remains_for_other_users(void **state)
{
    piece ann[] = {piece_of("ann", 'a', true), piece_of("ann", 'b', false)},
          bob = piece_of("bob", 'c', false);
    (void)state;
    thread_pool *p = start(2, 1, PATIENT_MS);
    thread_pool_add(p, &ann[0].work);
    wait_for(&seen.began, 1);
    thread_pool_add(p, &ann[1].work);
    thread_pool_add(p, &bob.work);
    wait_for(&seen.ended, 1);
    assert_string_equal(seen.order, "ac");
    sem_post(&ann[0].may_end);
    wait_for(&seen.ended, 2);
    thread_pool_stop(p);
    assert_string_equal(seen.order, "acb");
}

static void test_work_runs_together_up_to_a_sum_of_weights(void **state)
{
    piece held = piece_of("ann", 'a', true), large = piece_of("bob", 'b', false),
          small = piece_of("cat", 'c', false);
    (void)state;
    held.work.weight = 8;
    large.work.weight = 11; /* above the limit of the sum: it runs alone */
    small.work.weight = 2;
    thread_pool *p = start(3, 3, PATIENT_MS);
    thread_pool_add(p, &held.work);
    wait_for(&seen.began, 1);
    thread_pool_add(p, &large.work);
    thread_pool_add(p, &small.work); /* it would fit, but it is not its turn */
    sem_post(&held.may_end);
    wait_for(&seen.ended, 3);
    thread_pool_stop(p);
    assert_string_equal(seen.order, "abc");
}

static void note_priority(thread_pool_work *work)
{
    ((piece *)(void *)work)->priority = getpriority(PRIO_PROCESS, 0);
    sem_post(&seen.ended);
}

static void test_the_threads_have_a_lower_priority(void **state)
{
    piece one = piece_of("ann", 'a', false);
    (void)state;
    one.work.run = note_priority;
    thread_pool *p = thread_pool_start(
        &(thread_pool_settings){
            .threads = 1, .counts = counts, .kind = LEDGER_THREADS, .nice = 3, .patience_ms = PATIENT_MS},
        NULL);
    thread_pool_add(p, &one.work);
    wait_for(&seen.ended, 1);
    thread_pool_stop(p);
    int own = getpriority(PRIO_PROCESS, 0);
    assert_int_equal(one.priority, own < 16 ? own + 3 : 19);
}

static void test_work_that_has_not_begun_is_refused_at_the_stop(void **state)
{
    piece first = piece_of("ann", 'a', true),
          waiting[] = {piece_of("ann", 'b', false), piece_of("bob", 'c', false)},
          late = piece_of("bob", 'd', false);
    (void)state;
    thread_pool *p = start(1, 1, PATIENT_MS);
    thread_pool_add(p, &first.work);
    wait_for(&seen.began, 1);
    for (size_t i = 0; i < 2; i++) thread_pool_add(p, &waiting[i].work);
    thread_pool_refuse(p);
    thread_pool_add(p, &late.work);
    assert_true(strcmp(seen.order, "aBCD") == 0 || strcmp(seen.order, "aCBD") == 0);
    assert_int_equal(seen.why, THREAD_POOL_STOPS);
    sem_post(&first.may_end);
    thread_pool_stop(p);
}

/* Adds the work repeatedly until it runs instead of being refused. Clears the record of earlier work. */
static void add_until_it_runs(thread_pool *p, piece *held)
{
    do {
        memset(seen.order, 0, sizeof seen.order);
        thread_pool_add(p, &held->work);
        wait_for(&seen.began, 1);
    } while (seen.order[0] != held->name);
}

static void test_work_that_waits_too_long_is_refused_while_other_work_runs(void **state)
{
    piece held = piece_of("ann", 'a', true), same = piece_of("ann", 'b', false),
          heavy = piece_of("bob", 'c', false);
    (void)state;
    held.work.weight = heavy.work.weight = 10;
    thread_pool *p = start(2, 1, 1);
    add_until_it_runs(p, &held);
    thread_pool_add(p, &same.work); /* ann may not use the other thread */
    wait_for(&seen.began, 1);
    assert_int_equal(seen.why, THREAD_POOL_IS_BUSY);
    thread_pool_add(p, &heavy.work); /* the work is too heavy */
    wait_for(&seen.began, 1);
    assert_int_equal(seen.why, THREAD_POOL_IS_BUSY);
    sem_post(&held.may_end);
    wait_for(&seen.ended, 1);
    thread_pool_stop(p);
    assert_string_equal(seen.order, "aBC");
}

static void test_work_that_has_waited_too_long_for_the_only_thread_does_not_begin(void **state)
{
    piece held = piece_of("ann", 'a', true), late = piece_of("bob", 'b', false);
    (void)state;
    thread_pool *p = start(1, 1, 1);
    add_until_it_runs(p, &held);
    thread_pool_add(p, &late.work);
    while (clock_monotonic_ms() <= late.work.since_ms) continue;
    sem_post(&held.may_end);
    wait_for(&seen.began, 1);
    thread_pool_stop(p);
    assert_string_equal(seen.order, "aB");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_users_are_served_in_turn, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_the_user_with_fewer_running_pieces_is_next, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_thread_remains_for_other_users, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_work_runs_together_up_to_a_sum_of_weights, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_the_threads_have_a_lower_priority, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_work_that_has_not_begun_is_refused_at_the_stop, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(test_work_that_waits_too_long_is_refused_while_other_work_runs,
                                        set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_work_that_has_waited_too_long_for_the_only_thread_does_not_begin,
                                        set_up, tear_down),
    };
    return cmocka_run_group_tests_name("thread_pool", tests, NULL, NULL);
}

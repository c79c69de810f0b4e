// SPDX-License-Identifier: Apache-2.0
/* The pool processes every item once, with any number of workers, in many repetitions. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "base/core/threads.h"

enum { ITEMS = 1000 };

static void count_items(void *context, int worker, size_t begin, size_t end)
{
    atomic_int *seen = context;
    assert_in_range(worker, 0, 7);
    for (size_t i = begin; i < end; i++) atomic_fetch_add(&seen[i], 1);
}

static void every_item_once(void **state)
{
    (void)state;
    for (int workers = 1; workers <= 8; workers++) {
        error e = {0};
        threads *pool = threads_new(workers, NULL, &e);
        assert_non_null(pool);
        assert_int_equal(threads_count(pool), workers);
        for (size_t grain = 1; grain < 2 * ITEMS; grain = grain * 3 + 1) {
            atomic_int seen[ITEMS];
            memset(seen, 0, sizeof seen);
            for (int round = 0; round < 5; round++) threads_run(pool, ITEMS, grain, count_items, seen);
            for (int i = 0; i < ITEMS; i++) assert_int_equal(seen[i], 5);
        }
        threads_run(pool, 0, 1, count_items, NULL);
        threads_free(pool);
    }
}

static void count_one(void *context)
{
    atomic_fetch_add((atomic_int *)context, 1);
}

static void another_call_runs_beside_a_loop(void **state)
{
    (void)state;
    for (int workers = 1; workers <= 4; workers++) {
        error e = {0};
        threads *pool = threads_new(workers, NULL, &e);
        assert_non_null(pool);
        for (size_t count = 0; count < ITEMS; count = count * 3 + 1)
            for (size_t grain = 1; grain < 2 * ITEMS; grain = grain * 3 + 1) {
                atomic_int seen[ITEMS], others = 0;
                memset(seen, 0, sizeof seen);
                threads_run_beside(pool, count_one, &others, count, grain, count_items, seen);
                assert_int_equal(others, 1);
                for (size_t i = 0; i < ITEMS; i++) assert_int_equal(seen[i], i < count);
            }
        threads_free(pool);
    }
}

typedef struct short_loop {
    atomic_int done, late;
    atomic_bool over;
} short_loop;

static void count_and_look(void *context, int worker, size_t begin, size_t end)
{
    short_loop *l = context;
    (void)worker;
    if (atomic_load(&l->over)) atomic_fetch_add(&l->late, 1);
    atomic_fetch_add(&l->done, (int)(end - begin));
}

/* Workers that wake up after the end of a loop do not process it, and no loop is processed twice. */
static void short_loops_end_for_all(void **state)
{
    (void)state;
    error e = {0};
    threads *pool = threads_new(8, NULL, &e);
    assert_non_null(pool);
    for (int k = 0; k < 20000; k++) {
        short_loop l = {0, 0, false};
        threads_run(pool, 2 + (size_t)k % 9, 1, count_and_look, &l);
        atomic_store(&l.over, true);
        assert_int_equal(atomic_load(&l.done), 2 + k % 9);
        assert_int_equal(atomic_load(&l.late), 0);
    }
    threads_free(pool);
}

static void at_least_one_processor_is_available(void **state)
{
    (void)state;
    assert_true(threads_available() >= 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_item_once), cmocka_unit_test(another_call_runs_beside_a_loop),
        cmocka_unit_test(short_loops_end_for_all), cmocka_unit_test(at_least_one_processor_is_available)};
    return cmocka_run_group_tests_name("threads", tests, NULL, NULL);
}

/* The pool does every item once, with any number of workers, many times over. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "base/threads.h"

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

static void there_is_a_processor(void **state)
{
    (void)state;
    assert_true(threads_available() >= 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_item_once),
                                       cmocka_unit_test(there_is_a_processor)};
    return cmocka_run_group_tests_name("threads", tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
/* Results that are sent file by file. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>

#include "service/queue/queue.h"
#include "service/results/fetches.h"

static fetches_result result_of(int number, int frame)
{
    fetches_result of = {.frame = frame};
    snprintf(of.id, sizeof of.id, "%d", number);
    return of;
}

static void test_a_result_is_complete_with_its_last_file(void **state)
{
    (void)state;
    fetches *f = fetches_new();
    fetches_result first = result_of(1, 7), other_frame = result_of(1, 8),
                   alone = result_of(2, QUEUE_NO_FRAME);
    assert_false(fetches_note(f, &first, 2, 3));
    assert_false(fetches_note(f, &first, 0, 3));
    assert_false(fetches_note(f, &first, 0, 3)); /* the same file again */
    assert_false(fetches_note(f, &other_frame, 1, 3));
    assert_true(fetches_note(f, &alone, 0, 1));
    assert_true(fetches_note(f, &first, 1, 3));
    assert_false(fetches_note(f, &first, 1, 3)); /* a new record */
    fetches_free(f);
}

static void test_the_least_recently_used_record_is_replaced(void **state)
{
    (void)state;
    fetches *f = fetches_new();
    fetches_result first = result_of(0, 0), second = result_of(1, 0);
    for (int i = 0; i < FETCHES_MOST; i++) {
        fetches_result of = result_of(i, 0);
        assert_false(fetches_note(f, &of, 0, 2));
    }
    assert_false(fetches_note(f, &first, 0, 2)); /* now the second one is the oldest */
    fetches_result more = result_of(FETCHES_MOST, 0);
    assert_false(fetches_note(f, &more, 0, 2));
    assert_true(fetches_note(f, &first, 1, 2));
    assert_false(fetches_note(f, &second, 1, 2));
    fetches_free(f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_result_is_complete_with_its_last_file),
        cmocka_unit_test(test_the_least_recently_used_record_is_replaced),
    };
    return cmocka_run_group_tests_name("fetches", tests, NULL, NULL);
}

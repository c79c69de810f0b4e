// SPDX-License-Identifier: Apache-2.0
/* A value is counted under the first bound that is not below it. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "base/core/histogram.h"

static void test_a_value_is_counted_under_its_bound(void **state)
{
    (void)state;
    histogram h = {0};
    int64_t sum = 0;
    for (int i = 0; i < HISTOGRAM_BOUNDS; i++) {
        int64_t bound_ms = (int64_t)(1000 * histogram_bounds_s[i]);
        histogram_add(&h, bound_ms);
        histogram_add(&h, bound_ms + 1);
        sum += 2 * bound_ms + 1;
    }
    assert_int_equal(h.count[0], 1);
    for (int i = 1; i < HISTOGRAM_BOUNDS; i++) assert_int_equal(h.count[i], 2);
    assert_int_equal(h.count[HISTOGRAM_BOUNDS], 1);
    assert_true(h.sum_ms == sum);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_a_value_is_counted_under_its_bound)};
    return cmocka_run_group_tests_name("histogram", tests, NULL, NULL);
}

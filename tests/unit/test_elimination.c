// SPDX-License-Identifier: Apache-2.0
/* Small dense systems: solutions that are known, and matrices that have none. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "shapes.h"
#include "sampling/weights/elimination.h"

enum { MOST = 130, SIDES = 3, STRIDE = MOST + SIDES + 2 };

/* Random matrices of several sizes, half of them with zeros on the diagonal, which require exchanges of rows. */
static void solutions_of_random_systems_are_found(void **state)
{
    (void)state;
    static double a[MOST * STRIDE], x[SIDES][MOST], found[MOST];
    static const int sizes[] = {1, 2, 3, 4, 5, 7, 8, 9, 64, 116, MOST};
    rng r = rng_seed(test_seed(), 0);
    for (size_t s = 0; s < 2 * sizeof sizes / sizeof *sizes; s++) {
        const int n = sizes[s / 2];
        for (int side = 0; side < SIDES; side++)
            for (int k = 0; k < n; k++) x[side][k] = 2 * rng_uniform(&r) - 1;
        for (int i = 0; i < n; i++) {
            double *row = a + i * STRIDE;
            for (int j = 0; j < n; j++) row[j] = s % 2 && n > 1 && i == j ? 0 : 2 * rng_uniform(&r) - 1;
            for (int side = 0; side < SIDES; side++) {
                row[n + side] = 0;
                for (int j = 0; j < n; j++) row[n + side] += row[j] * x[side][j];
            }
        }
        assert_true(elimination_reduce(a, n, n + SIDES, STRIDE));
        for (int side = 0; side < SIDES; side++) {
            elimination_solve(a, n, STRIDE, n + side, n / 2, found);
            for (int k = n / 2; k < n; k++) assert_close(found[k], x[side][k], 1e-9);
            elimination_solve(a, n, STRIDE, n + side, 0, found);
            for (int k = 0; k < n; k++) assert_close(found[k], x[side][k], 1e-9);
        }
    }
}

/* Exchanges of rows are exact. */
static void a_permutation_is_inverted_exactly(void **state)
{
    (void)state;
    enum { SIZE = 9, COLUMNS = SIZE + 1 };
    double a[SIZE * COLUMNS] = {0}, x[SIZE];
    for (int i = 0; i < SIZE; i++) {
        a[i * COLUMNS + (i * 4 + 2) % SIZE] = 1;
        a[i * COLUMNS + SIZE] = (i * 4 + 2) % SIZE;
    }
    assert_true(elimination_reduce(a, SIZE, COLUMNS, COLUMNS));
    elimination_solve(a, SIZE, COLUMNS, SIZE, 0, x);
    for (int i = 0; i < SIZE; i++) assert_true(x[i] == i);
}

static void singular_systems_and_values_that_are_not_finite_are_refused(void **state)
{
    (void)state;
    enum { SIZE = 6 };
    for (int k = 0; k < 3; k++) {
        double a[SIZE * SIZE];
        for (int i = 0; i < SIZE * SIZE; i++) a[i] = i % SIZE == i / SIZE ? 2 : 0;
        if (k == 0) memset(a + 3 * SIZE, 0, SIZE * sizeof *a);
        if (k == 1) a[4 * SIZE + 4] = NAN;
        if (k == 2) memcpy(a + 5 * SIZE, a + 1 * SIZE, SIZE * sizeof *a);
        assert_false(elimination_reduce(a, SIZE, SIZE, SIZE));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(solutions_of_random_systems_are_found),
        cmocka_unit_test(a_permutation_is_inverted_exactly),
        cmocka_unit_test(singular_systems_and_values_that_are_not_finite_are_refused),
    };
    return cmocka_run_group_tests_name("elimination", tests, NULL, NULL);
}

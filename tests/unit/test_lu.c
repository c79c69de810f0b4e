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
#include "sampling/weights/lu.h"

enum { MOST = 130, STRIDE = MOST + 3, COLUMNS = 3 };

/* Random matrices of several sizes, half of them with zeros on the diagonal, which require pivots. */
static void solutions_of_random_systems_are_found(void **state)
{
    (void)state;
    static double a[MOST * STRIDE], x[MOST * COLUMNS], b[MOST * COLUMNS];
    static const int sizes[] = {1, 2, 3, 4, 5, 7, 8, 9, 64, 116, MOST};
    rng r = rng_seed(test_seed(), 0);
    for (size_t s = 0; s < 2 * sizeof sizes / sizeof *sizes; s++) {
        const int n = sizes[s / 2];
        int pivot[MOST];
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                a[i * STRIDE + j] = s % 2 && n > 1 && i == j ? 0 : 2 * rng_uniform(&r) - 1;
        for (int k = 0; k < n * COLUMNS; k++) x[k] = 2 * rng_uniform(&r) - 1;
        memset(b, 0, sizeof b);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                for (int c = 0; c < COLUMNS; c++)
                    b[i * COLUMNS + c] += a[i * STRIDE + j] * x[j * COLUMNS + c];
        assert_true(lu_factor(a, n, STRIDE, pivot));
        lu_solve(a, n, STRIDE, pivot, b, COLUMNS);
        for (int k = 0; k < n * COLUMNS; k++) assert_close(b[k], x[k], 1e-9);
    }
}

/* Exchanges of rows are exact. */
static void a_permutation_is_inverted_exactly(void **state)
{
    (void)state;
    enum { SIZE = 9 };
    double a[SIZE * SIZE] = {0}, b[SIZE];
    int pivot[SIZE];
    for (int i = 0; i < SIZE; i++) a[i * SIZE + (i * 4 + 2) % SIZE] = 1;
    for (int i = 0; i < SIZE; i++) b[i] = (i * 4 + 2) % SIZE;
    assert_true(lu_factor(a, SIZE, SIZE, pivot));
    lu_solve(a, SIZE, SIZE, pivot, b, 1);
    for (int i = 0; i < SIZE; i++) assert_true(b[i] == i);
}

static void singular_matrices_and_values_that_are_not_finite_are_refused(void **state)
{
    (void)state;
    enum { SIZE = 6 };
    int pivot[SIZE];
    for (int k = 0; k < 3; k++) {
        double a[SIZE * SIZE];
        for (int i = 0; i < SIZE * SIZE; i++) a[i] = 1 + i % SIZE == 1 + i / SIZE ? 2 : 0;
        if (k == 0) memset(a + 3 * SIZE, 0, SIZE * sizeof *a);
        if (k == 1) a[4 * SIZE + 4] = NAN;
        if (k == 2) memcpy(a + 5 * SIZE, a + 1 * SIZE, SIZE * sizeof *a);
        assert_false(lu_factor(a, SIZE, SIZE, pivot));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(solutions_of_random_systems_are_found),
        cmocka_unit_test(a_permutation_is_inverted_exactly),
        cmocka_unit_test(singular_matrices_and_values_that_are_not_finite_are_refused),
    };
    return cmocka_run_group_tests_name("lu", tests, NULL, NULL);
}

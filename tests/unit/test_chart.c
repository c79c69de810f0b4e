// SPDX-License-Identifier: Apache-2.0
/* chart: ticks, and the positions of curves. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "io/pictures/chart.h"

enum { WIDTH = 400, HEIGHT = 300 };

static void ticks_are_round(void **state)
{
    (void)state;
    static const struct {
        double range;
        int most;
        double step;
    } cases[] = {{10, 5, 2},    {10.1, 5, 5}, {1, 10, 0.1}, {0.003, 4, 0.001},
                 {7e6, 8, 1e6}, {24, 5, 5},   {26, 5, 10}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        double step = chart_tick(cases[k].range, cases[k].most);
        if (fabs(step / cases[k].step - 1) > 1e-9)
            fail_msg("%g in %d: %g", cases[k].range, cases[k].most, step);
    }
}

static canvas draw(const double *values, size_t count, bool decades)
{
    const chart_curve curve = {"step", values, decades};
    const chart what = {"sweep", count, &curve, 1};
    error e = {0};
    canvas c;
    if (!chart_draw(&what, WIDTH, HEIGHT, &c, &e)) fail_msg("%s", e.message);
    return c;
}

/* The first and the last blue row of a column, where curves are; false if there is none. */
static bool rows_of(const canvas *c, int x, int *first, int *last)
{
    *first = *last = -1;
    for (int y = 0; y < HEIGHT; y++) {
        const unsigned char *p = c->rgb + 3 * (y * WIDTH + x);
        if (p[2] < p[0] + 50) continue;
        if (*first < 0) *first = y;
        *last = y;
    }
    return *first >= 0;
}

/* A straight line from the lower left to the upper right; the same for powers of ten on a logarithmic
 * axis. */
static void lines_are_straight(void **state)
{
    (void)state;
    for (int decades = 0; decades <= 1; decades++)
        for (size_t count = 2; count <= 200000; count *= 10) {
            double *values = calloc(count, sizeof *values);
            for (size_t k = 0; k < count; k++) {
                values[k] = 4.0 * (double)k / (double)(count - 1);
                if (decades) values[k] = pow(10, values[k]);
            }
            canvas c = draw(values, count, decades);
            int left = 0, right = WIDTH - 1, first, last, low, high, middle_first, middle_last;
            while (!rows_of(&c, left, &first, &low)) left++;
            while (!rows_of(&c, right, &high, &last)) right--;
            assert_true(right - left > WIDTH / 2 && low - high > HEIGHT / 2);
            assert_true(rows_of(&c, (left + right) / 2, &middle_first, &middle_last));
            assert_true(abs(middle_first + middle_last - low - high) <= 4);
            assert_true(middle_last - middle_first <= 4);
            free(c.rgb);
            free(values);
        }
}

/* A value without a logarithm is a gap; the other values are drawn. */
static void gaps_stay_open(void **state)
{
    (void)state;
    double values[101];
    for (int k = 0; k <= 100; k++) values[k] = k < 40 || k > 60 ? 0.1 : k % 2 ? 0 : NAN;
    canvas c = draw(values, 101, true);
    int first, last, columns = 0, left = 0, right = WIDTH - 1;
    while (!rows_of(&c, left, &first, &last)) left++;
    while (!rows_of(&c, right, &first, &last)) right--;
    for (int x = left; x <= right; x++) columns += rows_of(&c, x, &first, &last);
    assert_in_range(columns, (right - left) * 3 / 4, (right - left) * 5 / 6);
    free(c.rgb);
    for (int k = 0; k <= 100; k++) values[k] = NAN;
    c = draw(values, 101, false); /* an empty panel */
    for (int x = 0; x < WIDTH; x++) assert_false(rows_of(&c, x, &first, &last));
    free(c.rgb);
    values[0] = 7;
    c = draw(values, 1, false); /* one value is a horizontal line */
    assert_true(rows_of(&c, WIDTH / 2, &first, &last) && last - first <= 4);
    free(c.rgb);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ticks_are_round),
        cmocka_unit_test(lines_are_straight),
        cmocka_unit_test(gaps_stay_open),
    };
    return cmocka_run_group_tests_name("chart", tests, NULL, NULL);
}

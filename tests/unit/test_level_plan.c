// SPDX-License-Identifier: Apache-2.0
/* Plans of counts: refinement gives the planned count of the next level. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "sampling/solver/level_plan.h"
#include "sampling/solver/passes/refine.h"

/* Triangulations by Euler's formula: n particles, b of them on a rim, have 3 (n - x) - b edges; a rim of b
 * particles has b edges, so refining doubles it. */
static void corrected_plans_match_the_refined_counts(void **state)
{
    (void)state;
    for (int euler = -40; euler <= 2; euler++)
        for (int rim = 0; rim <= 200; rim += 50) {
            level_plan plan = {.count = 4, .particles = {0, 0, 0, 100000}};
            for (int k = 2; k >= 0; k--) plan.particles[k] = refine_coarser(plan.particles[k + 1]);
            double before = (double)plan.particles[0], n = before, b = rim;
            level_plan_correct(&plan, (size_t)(3 * (n - euler) - b), (size_t)rim);
            n = (double)plan.particles[0];
            b = rim * sqrt(n / before); /* the boundary has the same length */
            for (int k = 1; k < 4; k++) {
                n += 3 * (n - euler) - b;
                b *= 2;
                /* rounding is refined with the rest, and the share of the boundary was rounded */
                if (fabs(n - (double)plan.particles[k]) > 5 + 0.1 * rim)
                    fail_msg("euler %d rim %d: level %d gets %g of %zu", euler, rim, k, n, plan.particles[k]);
                n = (double)plan.particles[k];
            }
        }
}

/* If the edges give no information, the plan stays near the usual counts. */
static void plans_with_invalid_edge_counts_are_bounded(void **state)
{
    (void)state;
    level_plan none = {.count = 2, .particles = {250, 1000}}, many = none;
    level_plan_correct(&none, 0, 0);
    level_plan_correct(&many, 100000, 0);
    assert_true(none.particles[0] > 250 && none.particles[0] <= 333);
    assert_true(many.particles[0] < 250 && many.particles[0] >= 200);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(corrected_plans_match_the_refined_counts),
        cmocka_unit_test(plans_with_invalid_edge_counts_are_bounded),
    };
    return cmocka_run_group_tests_name("levels", tests, NULL, NULL);
}

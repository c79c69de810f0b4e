// SPDX-License-Identifier: Apache-2.0
/* schedule: values of the tables at the positions of a solve where one rule replaces another. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "close.h"
#include "sampling/solver/schedule.h"

enum { LAST = SCHEDULE_STAGES - 1 };

static schedule_position finest(int sweeps, size_t count)
{
    return (schedule_position){.level = 2, .levels = 3, .stage = LAST, .sweeps = sweeps, .count = count};
}

/* The number of sweeps decreases with the number of particles, within its bounds. */
static void levels_have_fewer_sweeps_the_more_particles_they_have(void **state)
{
    (void)state;
    int before = (int)schedule_multilevel.sweeps_most;
    for (size_t count = 100; count < 100000000; count *= 3) {
        schedule_position at = finest(0, count);
        int sweeps = schedule_level_sweeps(&schedule_multilevel, &at);
        assert_in_range(sweeps, (int)schedule_multilevel.sweeps_least, before);
        before = sweeps;
    }
    assert_int_equal(before, (int)schedule_multilevel.sweeps_least);
}

/* Over-relaxation never increases during the sweeps of a level. It begins above 2, far from a plain step, and
 * ends below 1.3. The paper's method and continued solves use a constant factor. */
static void over_relaxation_follows_the_sweeps(void **state)
{
    (void)state;
    const schedule_position first = finest(0, 10000), last = finest(900, 10000);
    double before = 3;
    for (int k = 0; k < 1000; k++) {
        const schedule_position at = finest(k, 10000);
        const double omega = schedule_omega(&schedule_multilevel, &at);
        assert_true(omega >= 1 && omega <= before);
        before = omega;
    }
    assert_true(before <= 1.3 && schedule_omega(&schedule_multilevel, &first) > 2);
    const schedule *constant[] = {&schedule_paper, &schedule_continued};
    for (size_t k = 0; k < 2; k++)
        assert_true(schedule_omega(constant[k], &first) == schedule_omega(constant[k], &last));
}

/* Each earlier stage requires a larger gain. */
static void the_gain_falls_from_stage_to_stage(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    for (int stage = 1; stage < SCHEDULE_STAGES; stage++)
        assert_true(schedule_gain(s, stage) < schedule_gain(s, stage - 1));
    assert_true(schedule_gain(s, LAST) > 0);
}

static void levels_with_many_defects_take_more_sweeps(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    schedule_position at = finest(0, 50000);
    const int sweeps = schedule_level_sweeps(s, &at);
    at.sweeps = sweeps;
    assert_true(schedule_judges_defects(s, &at));
    assert_true(schedule_has_many_defects(s, 0.2));
    assert_false(schedule_has_many_defects(s, 0.02) || schedule_has_many_defects(s, 0.4));
    at.has_many_defects = true;
    assert_false(schedule_judges_defects(s, &at));
    assert_true(schedule_level_sweeps(s, &at) > sweeps);
}

/* Extra sweeps are limited, so that a level with many sweeps takes few more. */
static void extra_sweeps_are_limited(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    for (size_t count = (size_t)s->defects_count; count < 1000000; count = count * 5 / 4) {
        schedule_position at = finest(0, count);
        const int sweeps = schedule_level_sweeps(s, &at);
        at.has_many_defects = true;
        const int extra = schedule_level_sweeps(s, &at) - sweeps;
        assert_true(extra > 0 && extra <= s->defects_sweeps_most &&
                    extra <= (s->defects_sweeps - 1) * (sweeps + 1));
    }
}

/* A repeated last stage is shaken for a part of the least sweeps of its level. */
static void repeated_stages_take_fewer_sweeps(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    schedule_position at = finest(0, 2000);
    at.sweeps = schedule_repeated_from(s, &at);
    assert_true(at.sweeps > 0 && at.sweeps < schedule_least_sweeps(s, &at));
    assert_true(schedule_is_shaken(s, &at));
    assert_int_equal(schedule_repeated_from(&schedule_paper, &at), 0);
}

/* A small level has many sweeps anyway. */
static void small_levels_take_no_extra_sweeps(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    schedule_position at = finest(0, (size_t)s->defects_count - 1);
    at.sweeps = schedule_level_sweeps(s, &at);
    assert_false(schedule_judges_defects(s, &at));
}

/* The minimum number of sweeps of a level, including extra sweeps, does not raise the gain. */
static void extra_sweeps_do_not_raise_the_gain(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    schedule_position at = finest(0, 5000);
    for (int many = 0; many < 2; many++) {
        at.has_many_defects = many;
        int sweeps = schedule_level_sweeps(s, &at);
        for (at.sweeps = 1; at.sweeps < sweeps; at.sweeps++)
            assert_false(schedule_is_impatient(s, &at, s->gain));
    }
}

/* Steps are unlimited while a level is shaken. Then the limit never rises. */
static void assert_limit_after_shaking(schedule_position at)
{
    const schedule *s = &schedule_multilevel;
    double before = INFINITY;
    for (at.sweeps = 0; at.sweeps < 1000; at.sweeps++) {
        const double longest = schedule_longest_step(s, &at);
        assert_true(schedule_is_shaken(s, &at) ? longest == INFINITY : longest < 1 && longest <= before);
        before = longest;
    }
    assert_true(before < 1e-3);
}

static void steps_are_unlimited_until_a_level_is_shaken(void **state)
{
    (void)state;
    const schedule_position early = {.levels = 3, .sweeps = 15, .count = 100}, late = finest(900, 10000);
    assert_true(schedule_is_shaken(&schedule_multilevel, &(schedule_position){.levels = 3, .count = 100}));
    assert_limit_after_shaking(early);
    assert_limit_after_shaking(late);
    assert_true(schedule_longest_step(&schedule_paper, &early) == INFINITY);
    assert_true(schedule_longest_step(&schedule_continued, &early) < 1);
    assert_true(schedule_longest_step(&schedule_continued, &early) ==
                schedule_longest_step(&schedule_continued, &late));
}

static bool ends(const schedule *s, schedule_position at, double rms_step, double lambda)
{
    const schedule_evidence seen = {rms_step, lambda, true, 0.003};
    return schedule_round_end(s, &at, &seen);
}

static void a_paced_level_has_its_sweeps_before_it_converges(void **state)
{
    (void)state;
    schedule_position at = finest(0, 10000);
    int sweeps = schedule_level_sweeps(&schedule_multilevel, &at);
    assert_false(ends(&schedule_multilevel, finest(sweeps - 1, 10000), 0, 16));
    assert_true(ends(&schedule_multilevel, finest(sweeps, 10000), 0.002, 0));
    assert_true(ends(&schedule_multilevel, finest(sweeps, 10000), 0.01, 0)); /* over-relaxed */
    assert_false(ends(&schedule_multilevel, finest(sweeps, 10000), 0.011, 16));
    assert_false(ends(&schedule_continued, finest(sweeps, 10000), 0.004, 16));
    at.levels = 1; /* a level that is also the coarsest */
    at.level = 0;
    at.sweeps = sweeps;
    assert_true(ends(&schedule_multilevel, at, 0.01, 0));
    assert_false(ends(&schedule_multilevel, at, 0.011, 16));
    at.levels = 3;
    at.level = 1; /* a level that is refined again need not reach small steps */
    at.sweeps = sweeps;
    assert_true(ends(&schedule_multilevel, at, 1, 0));
    assert_true(ends(&schedule_continued, finest(1, 10000), 0.002, 0));
    at = (schedule_position){.levels = 3, .sweeps = 1, .count = 100};
    assert_true(ends(&schedule_multilevel, at, 0.02, 0));
    assert_false(ends(&schedule_multilevel, at, 0.04, 0));
    at.sweeps = schedule_multilevel.patience;
    assert_true(ends(&schedule_multilevel, at, 0.04, 0));
}

/* Whatever its least sweeps are; but the last level, and the earlier stages of the coarsest one, do not. */
static void a_settled_level_that_will_be_refined_ends_early(void **state)
{
    (void)state;
    for (size_t count = 100; count < 100000; count *= 3) {
        schedule_position at = {.level = 1, .levels = 3, .stage = LAST, .sweeps = 1, .count = count};
        assert_true(ends(&schedule_multilevel, at, 0.0009, 0));
        assert_false(ends(&schedule_multilevel, at, 0.002, 0));
        at.level = 0;
        assert_true(ends(&schedule_multilevel, at, 0.0009, 0));
        at.level = 2;
        assert_false(ends(&schedule_multilevel, at, 0, 0));
    }
}

static void the_paper_method_ends_by_lambda(void **state)
{
    (void)state;
    schedule_position at = {.levels = 1, .sweeps = 50, .count = 1000};
    assert_true(ends(&schedule_paper, at, 1, 14.5));
    assert_false(ends(&schedule_paper, at, 0, 13.5));
    at.stage = LAST; /* where steps count, too */
    assert_false(ends(&schedule_paper, at, 1, 14.5));
    assert_true(ends(&schedule_paper, at, 0.002, 14.5));
    const schedule_evidence gradient = {0.002, 0, false, 0.003};
    assert_true(schedule_round_end(&schedule_paper, &at, &gradient));
}

static void patience_ends_at_regular_intervals(void **state)
{
    (void)state;
    int times = 0, last = 0, interval = 0;
    for (int sweeps = 1; sweeps <= 1000; sweeps++) {
        schedule_position at = {.levels = 1, .sweeps = sweeps, .count = 1000};
        if (!schedule_is_impatient(&schedule_paper, &at, 1e-4)) continue;
        if (times > 1) assert_int_equal(sweeps - last, interval);
        interval = sweeps - last;
        last = sweeps;
        times++;
    }
    assert_in_range(times, 10, 100);
}

/* The gain is multiplied at regular intervals until it is the coarsest one, which it keeps for longer. */
static void the_coarsest_gain_lasts_longer_than_the_others(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    double gain = schedule_gain(s, LAST);
    int last = 0, interval = 0;
    for (int sweeps = 1; !(gain > 2 * schedule_coarsest_gain(s)); sweeps++) {
        const schedule_position at = {.levels = 1, .stage = LAST, .sweeps = sweeps, .count = 1000};
        if (!schedule_is_impatient(s, &at, gain)) continue;
        const bool is_coarsest = gain > 0.5 * schedule_coarsest_gain(s);
        if (is_coarsest) assert_true(interval > 0 && sweeps - last > 2 * interval);
        if (interval > 0 && !is_coarsest) assert_int_equal(sweeps - last, interval);
        interval = last > 0 ? sweeps - last : 0;
        last = sweeps;
        gain *= 10;
    }
}

/* By the paper's criterion the expected remainder decreases as lambda rises, and from stage to stage. */
static void expected_sweeps_approach_those_spent(void **state)
{
    (void)state;
    double before = INFINITY;
    for (int stage = 0; stage < SCHEDULE_STAGES; stage++)
        for (double climb = 0; climb <= 1; climb += 0.25) {
            const schedule_position at = {.levels = 1, .stage = stage, .count = 1000};
            const schedule_evidence seen = {0.1, -3 + climb * (schedule_paper.rest_lambda + 3), true, 0.003};
            const double expected = schedule_expected_sweeps(&schedule_paper, &at, 100, &seen);
            assert_true(expected <= before && expected >= 100);
            before = expected;
        }
    assert_true(before == 100);
}

/* A level whose defects may require more sweeps is expected to take longer than its minimum of sweeps. */
static void a_level_that_may_have_many_defects_is_expected_to_take_longer(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    schedule_position at = {.level = 2, .levels = 3, .stage = LAST, .count = 10000};
    const double least = schedule_level_sweeps(s, &at);
    assert_true(schedule_expected_sweeps(s, &at, 0, NULL) > least);
    at.has_many_defects = true;
    assert_true(schedule_expected_sweeps(s, &at, 0, NULL) == schedule_level_sweeps(s, &at));
    at = (schedule_position){.level = 2, .levels = 3, .stage = LAST, .count = 1000};
    assert_true(schedule_expected_sweeps(s, &at, 0, NULL) == schedule_level_sweeps(s, &at));
}

static void lists_are_rebuilt_for_many_limited_particles_or_at_an_age(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    const schedule_position at = finest(10, 10000);
    assert_false(schedule_wants_lists(s, &at, 0, 1000));
    assert_false(schedule_wants_lists(s, &at, 100, 1));
    assert_true(schedule_wants_lists(s, &at, 101, 1));
    assert_true(schedule_wants_lists(s, &at, 1, s->limited_wait));
    assert_true(schedule_skin(s, 0) == s->skin_narrow && schedule_skin(s, 1) == s->skin_wide);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(levels_have_fewer_sweeps_the_more_particles_they_have),
        cmocka_unit_test(over_relaxation_follows_the_sweeps),
        cmocka_unit_test(the_gain_falls_from_stage_to_stage),
        cmocka_unit_test(levels_with_many_defects_take_more_sweeps),
        cmocka_unit_test(extra_sweeps_are_limited),
        cmocka_unit_test(repeated_stages_take_fewer_sweeps),
        cmocka_unit_test(small_levels_take_no_extra_sweeps),
        cmocka_unit_test(extra_sweeps_do_not_raise_the_gain),
        cmocka_unit_test(steps_are_unlimited_until_a_level_is_shaken),
        cmocka_unit_test(a_paced_level_has_its_sweeps_before_it_converges),
        cmocka_unit_test(a_settled_level_that_will_be_refined_ends_early),
        cmocka_unit_test(the_paper_method_ends_by_lambda),
        cmocka_unit_test(patience_ends_at_regular_intervals),
        cmocka_unit_test(the_coarsest_gain_lasts_longer_than_the_others),
        cmocka_unit_test(expected_sweeps_approach_those_spent),
        cmocka_unit_test(a_level_that_may_have_many_defects_is_expected_to_take_longer),
        cmocka_unit_test(lists_are_rebuilt_for_many_limited_particles_or_at_an_age),
    };
    return cmocka_run_group_tests_name("schedule", tests, NULL, NULL);
}

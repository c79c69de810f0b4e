/* schedule: what the tables say, at the places of a solve where one rule hands over to another. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "close.h"
#include "solver/schedule.h"

enum { LAST = SCHEDULE_STAGES - 1 };

static schedule_position finest(int sweeps, size_t count)
{
    return (schedule_position){.level = 2, .levels = 3, .stage = LAST, .sweeps = sweeps, .count = count};
}

/* Sweeps become fewer as particles become more, within their bounds. */
static void level_plan_have_sweeps_by_their_count(void **state)
{
    (void)state;
    int before = (int)schedule_multilevel.sweeps_most;
    for (size_t count = 100; count < 100000000; count *= 3) {
        schedule_position at = finest(0, count);
        int sweeps = schedule_level_sweeps(&schedule_multilevel, &at);
        assert_in_range(sweeps, (int)schedule_multilevel.sweeps_least, before);
        at.level = 1; /* a quarter of the particles: no dearer than so many updates of each of the finest */
        assert_true(schedule_level_sweeps(&schedule_multilevel, &at) <=
                    fmax(sweeps, 4 * schedule_multilevel.sweeps_between[1].share));
        before = sweeps;
    }
    assert_int_equal(before, (int)schedule_multilevel.sweeps_least);
}

/* For a given number of particles, a level far below the finest one gets more sweeps than one right below it, since it
 * costs less in comparison. The more particles there are, the less all coarser levels cost compared with the finest one. */
static void level_plan_far_below_have_more_sweeps(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    schedule_position far = {.level = 3, .levels = 7, .stage = LAST, .count = 156250}, near = far;
    near.level = 5;
    assert_true(schedule_level_sweeps(s, &far) > 4 * schedule_level_sweeps(s, &near));
    double before = INFINITY;
    for (size_t count = 100000; count <= 10000000; count *= 10) {
        double coarser = 0, finest_level = 0; /* updates of single particles */
        for (int level = 1; level < 7; level++) {
            schedule_position at = {
                .level = level, .levels = 7, .stage = LAST, .count = count >> 2 * (6 - level)};
            *(level == 6 ? &finest_level : &coarser) += (double)at.count * schedule_level_sweeps(s, &at);
        }
        assert_true(coarser / finest_level < before);
        before = coarser / finest_level;
    }
    assert_true(before < 1);
}

/* Over-relaxation never grows during the sweeps of a level. It begins above 2, far from a plain
 * step, and ends below 1.3. The paper's method and continued solves have
 * one factor throughout. */
static void over_relaxation_follows_the_sweeps(void **state)
{
    (void)state;
    for (int is_sized = 0; is_sized < 2; is_sized++) {
        double before = 3;
        for (int k = 0; k < 1000; k++) {
            schedule_position at = finest(k, 10000);
            at.is_sized = is_sized;
            double omega = schedule_omega(&schedule_multilevel, &at);
            assert_true(omega >= 1 && omega <= before);
            before = omega;
        }
        assert_true(before <= 1.3);
        schedule_position first = finest(0, 10000);
        first.is_sized = is_sized;
        assert_true(schedule_omega(&schedule_multilevel, &first) > 2);
    }
    const schedule *constant[] = {&schedule_paper, &schedule_continued};
    for (size_t k = 0; k < 2; k++) {
        const schedule_position first = finest(0, 10000), last = finest(900, 10000);
        assert_true(schedule_omega(constant[k], &first) == schedule_omega(constant[k], &last));
    }
}

/* A coarsest level that costs as much as all others evens out in fewer lists and sweeps, sets the order of finer ones in sweeps enough,
 * and does not begin anew for a few particles. */
static void large_coarsest_levels_are_spared(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    const size_t large = (size_t)s->large;
    schedule_position at = {.levels = 2, .count = 10 * large}, small = {.levels = 2, .count = large - 1};
    const size_t limited = at.count / 20; /* a twentieth */
    assert_true(schedule_omega(s, &at) == s->large_omega && schedule_omega(s, &small) == s->omega);
    assert_true(schedule_wants_lists(s, &small, small.count / 20, 1));
    assert_false(schedule_wants_lists(s, &at, limited, 1));
    at.stage = LAST;
    assert_true(schedule_wants_lists(s, &at, limited, 1));
    assert_int_equal(schedule_level_sweeps(s, &at), (int)s->large_sweeps);
    at.levels = 1; /* which is not refined */
    assert_int_equal(schedule_level_sweeps(s, &at), (int)s->sweeps_least);
    assert_false(schedule_begins_anew(s, 10 * large, 10 * large + large / 200));
    assert_true(schedule_begins_anew(s, 10 * large, 10 * large + large / 50));
    assert_true(schedule_begins_anew(s, large - 1, large) && !schedule_begins_anew(s, 1000, 1000));
    assert_true(schedule_begins_anew(&schedule_paper, 10 * large, 10 * large + 1));
}

static void rough_levels_take_more_sweeps(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    schedule_position at = finest(0, 50000);
    const int sweeps = schedule_level_sweeps(s, &at);
    at.sweeps = sweeps;
    assert_true(schedule_judges_defects(s, &at));
    assert_true(schedule_has_many_defects(s, &at, 0.2));
    assert_false(schedule_has_many_defects(s, &at, 0.02) || schedule_has_many_defects(s, &at, 0.4));
    at.is_rough = true;
    assert_false(schedule_judges_defects(s, &at));
    at.sweeps = schedule_level_sweeps(s, &at);
    assert_true(at.sweeps >= (int)s->defects_sweeps[1] * sweeps);
}

/* Rows force little out of order, which finds its way out slowly. */
static void surfaces_with_curves_are_rough_sooner(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    schedule_position at = finest(0, 10000);
    assert_false(schedule_has_many_defects(s, &at, 0.03));
    at.has_curves = true;
    assert_true(schedule_has_many_defects(s, &at, 0.03));
    assert_false(schedule_has_many_defects(s, &at, 0.015));
}

/* Sweeps that the schedule itself asks for cost no patience. */
static void rough_levels_are_not_impatient(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    schedule_position at = finest(0, 5000);
    for (int rough = 0; rough < 2; rough++) {
        at.is_rough = rough;
        int sweeps = schedule_level_sweeps(s, &at);
        for (at.sweeps = 1; at.sweeps < sweeps; at.sweeps++)
            assert_false(schedule_is_impatient(s, &at, s->gain[LAST]));
    }
}

static void steps_are_free_until_a_level_is_shaken(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    schedule_position at = finest(0, 10000);
    assert_true(schedule_longest_step(s, &at) == INFINITY);
    at.sweeps = schedule_level_sweeps(s, &at);
    assert_true(schedule_longest_step(s, &at) == s->longest_step);
    at.sweeps *= 2;
    assert_true(schedule_longest_step(s, &at) == s->longest_step / 4);
    at = (schedule_position){.levels = 3, .sweeps = s->shake_sweeps, .count = 100};
    assert_true(schedule_longest_step(s, &at) == s->longest_step);
    assert_true(schedule_longest_step(&schedule_continued, &at) == schedule_continued.longest_step);
}

static bool rests(const schedule *s, schedule_position at, double rms_step, double lambda)
{
    const schedule_evidence seen = {rms_step, lambda, true, 0.003};
    return schedule_round_end(s, &at, &seen);
}

/* The last level of many even particles may rest after a shaken sweep and a settled one; if it does not, and elsewhere, there are
 * more. */
static void many_particles_need_few_sweeps(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    const size_t many = (size_t)s->many;
    schedule_position at = finest(0, many);
    assert_true(schedule_omega(s, &at) == s->omega_shake);
    at.sweeps = 1;
    assert_true(schedule_omega(s, &at) == s->omega);
    assert_false(rests(s, at, 0.001, 0));
    at.sweeps = 2;
    assert_true(schedule_omega(s, &at) > s->omega);
    assert_true(schedule_judges_defects(s, &at));
    assert_true(rests(s, at, 0.001, 0));
    assert_false(rests(s, at, 0.1, 0));
    const schedule_position others[] = {
        {.level = 2, .levels = 3, .stage = LAST, .sweeps = 2, .count = many - 1},
        {.level = 1, .levels = 3, .stage = LAST, .sweeps = 2, .count = many},
        {.level = 0, .levels = 1, .stage = LAST, .sweeps = 2, .count = many},
        {.level = 2, .levels = 3, .stage = LAST, .sweeps = 2, .count = many, .is_sized = true},
        {.level = 2, .levels = 3, .stage = LAST, .sweeps = 2, .count = many, .has_curves = true},
        {.level = 2, .levels = 3, .stage = LAST, .sweeps = 2, .count = many, .is_divergent = true},
        {.level = 2, .levels = 3, .stage = LAST, .sweeps = 2, .count = many, .is_rough = true},
    };
    for (size_t k = 0; k < sizeof others / sizeof *others; k++) assert_false(rests(s, others[k], 0.001, 0));
}

static void a_paced_level_has_its_sweeps_before_it_rests(void **state)
{
    (void)state;
    schedule_position at = finest(0, 10000);
    int sweeps = schedule_level_sweeps(&schedule_multilevel, &at);
    assert_false(rests(&schedule_multilevel, finest(sweeps - 1, 10000), 0, 16));
    assert_true(rests(&schedule_multilevel, finest(sweeps, 10000), 0.002, 0));
    assert_true(rests(&schedule_multilevel, finest(sweeps, 10000), 0.01, 0)); /* over-relaxed */
    assert_false(rests(&schedule_multilevel, finest(sweeps, 10000), 0.011, 16));
    assert_false(rests(&schedule_continued, finest(sweeps, 10000), 0.004, 16));
    at.levels = 1; /* one that is the coarsest as well */
    at.level = 0;
    at.sweeps = sweeps;
    assert_true(rests(&schedule_multilevel, at, 0.01, 0));
    assert_false(rests(&schedule_multilevel, at, 0.011, 16));
    at.levels = 3;
    at.level = 1; /* that is refined again needs no small steps */
    at.sweeps = sweeps;
    assert_true(rests(&schedule_multilevel, at, 1, 0));
    assert_true(rests(&schedule_continued, finest(1, 10000), 0.002, 0));
    at = (schedule_position){.levels = 3, .sweeps = 1, .count = 100};
    assert_true(rests(&schedule_multilevel, at, 0.02, 0));
    assert_false(rests(&schedule_multilevel, at, 0.04, 0));
    at.sweeps = schedule_multilevel.stage_sweeps_most;
    assert_true(rests(&schedule_multilevel, at, 0.04, 0));
}

/* Of a surface that is mostly creased the coarsest level rests sooner, and is not asked whether it is rough; the last is. */
static void mostly_creased_levels_rest_sooner(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    schedule_position at = {.levels = 2, .stage = LAST, .count = 25000, .is_divergent = true};
    at.sweeps = schedule_level_sweeps(s, &at);
    const double step = 0.5 * (s->stage_step[LAST] + s->stage_step_divergent);
    const schedule_evidence seen = {.rms_step = step, .step_tolerance = 1e-3};
    assert_true(schedule_judges_defects(s, &at));
    assert_false(schedule_round_end(s, &at, &seen));
    at.is_mostly_divergent = true;
    assert_false(schedule_judges_defects(s, &at));
    assert_true(schedule_round_end(s, &at, &seen));
    at.level = 1;
    at.sweeps = schedule_level_sweeps(s, &at);
    assert_true(schedule_judges_defects(s, &at));
}

static void the_paper_goes_by_lambda(void **state)
{
    (void)state;
    schedule_position at = {.levels = 1, .sweeps = 50, .count = 1000};
    assert_true(rests(&schedule_paper, at, 1, 14.5));
    assert_false(rests(&schedule_paper, at, 0, 13.5));
    at.stage = LAST; /* where steps count as well */
    assert_false(rests(&schedule_paper, at, 1, 14.5));
    assert_true(rests(&schedule_paper, at, 0.002, 14.5));
    const schedule_evidence gradient = {0.002, 0, false, 0.003};
    assert_true(schedule_round_end(&schedule_paper, &at, &gradient));
}

static void patience_ends_once_and_again(void **state)
{
    (void)state;
    int times = 0;
    for (int sweeps = 1; sweeps <= schedule_paper.patience[0] + 2 * schedule_paper.patience_more; sweeps++) {
        schedule_position at = {.levels = 1, .sweeps = sweeps, .count = 1000};
        times += schedule_is_impatient(&schedule_paper, &at, 1e-4);
    }
    assert_int_equal(times, 3);
}

/* A gain with which a solve has not converged is the last resort. */
static void the_coarsest_gain_lasts(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    double gain = s->gain[LAST];
    int sweeps = 0;
    for (; !(gain > 2 * s->coarsest_gain); sweeps++) {
        const schedule_position at = {.levels = 1, .stage = LAST, .sweeps = sweeps, .count = 1000};
        if (schedule_is_impatient(s, &at, gain)) gain *= 10;
        if (sweeps == s->patience[LAST] + 3 * s->patience_more) assert_close(gain, s->coarsest_gain, 1e-12);
    }
    assert_int_equal(sweeps - 1, s->patience[LAST] + s->patience_last);
}

/* By the paper's criterion what is left shrinks as lambda climbs, and from stage to stage. */
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

/* A level that may turn out rough is expected to take longer than its least sweeps, one that cannot to take just these. */
static void a_level_that_may_be_rough_is_expected_to_take_longer(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    schedule_position at = {.level = 2, .levels = 3, .stage = LAST, .count = 10000};
    const double least = schedule_level_sweeps(s, &at);
    assert_true(schedule_expected_sweeps(s, &at, 0, NULL) > least);
    at.is_rough = true;
    assert_true(schedule_expected_sweeps(s, &at, 0, NULL) == schedule_level_sweeps(s, &at));
    at = (schedule_position){.level = 2, .levels = 3, .stage = LAST, .count = 1000};
    assert_true(schedule_expected_sweeps(s, &at, 0, NULL) == schedule_level_sweeps(s, &at));
}

static void lists_wait_for_many_or_for_long(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    schedule_position at = finest(10, 10000), coarse = at;
    coarse.level = 1;
    assert_false(schedule_wants_lists(s, &at, 0, 1000));
    assert_false(schedule_wants_lists(s, &at, 100, 1));
    assert_true(schedule_wants_lists(s, &at, 101, 1));
    assert_false(schedule_wants_lists(s, &coarse, 400, 1));
    assert_true(schedule_wants_lists(s, &coarse, 401, 1));
    assert_true(schedule_wants_lists(s, &at, 1, s->limited_wait));
    assert_true(schedule_skin(s, 0) == s->skin_narrow && schedule_skin(s, 1) == s->skin_wide);
}

/* Many particles have a few sweeps only, and stay near their places. */
static void lists_of_many_begin_narrow(void **state)
{
    (void)state;
    const schedule *s = &schedule_multilevel;
    schedule_position at = finest(0, 1000000), coarsest = {.levels = 1, .count = 1000000};
    assert_true(schedule_first_skin(s, &at) == s->skin_first);
    assert_true(schedule_first_skin(s, &coarsest) == s->skin_wide);
    at.count = 100000;
    assert_true(schedule_first_skin(s, &at) == s->skin_wide);
    at.count = 1000000;
    assert_true(schedule_first_skin(&schedule_paper, &at) == s->skin_wide);
    at.is_sized = true;
    assert_true(schedule_first_skin(s, &at) == s->skin_wide);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lists_of_many_begin_narrow),
        cmocka_unit_test(level_plan_have_sweeps_by_their_count),
        cmocka_unit_test(level_plan_far_below_have_more_sweeps),
        cmocka_unit_test(many_particles_need_few_sweeps),
        cmocka_unit_test(over_relaxation_follows_the_sweeps),
        cmocka_unit_test(large_coarsest_levels_are_spared),
        cmocka_unit_test(rough_levels_take_more_sweeps),
        cmocka_unit_test(surfaces_with_curves_are_rough_sooner),
        cmocka_unit_test(rough_levels_are_not_impatient),
        cmocka_unit_test(steps_are_free_until_a_level_is_shaken),
        cmocka_unit_test(a_paced_level_has_its_sweeps_before_it_rests),
        cmocka_unit_test(mostly_creased_levels_rest_sooner),
        cmocka_unit_test(the_paper_goes_by_lambda),
        cmocka_unit_test(patience_ends_once_and_again),
        cmocka_unit_test(the_coarsest_gain_lasts),
        cmocka_unit_test(expected_sweeps_approach_those_spent),
        cmocka_unit_test(a_level_that_may_be_rough_is_expected_to_take_longer),
        cmocka_unit_test(lists_wait_for_many_or_for_long),
    };
    return cmocka_run_group_tests_name("schedule", tests, NULL, NULL);
}

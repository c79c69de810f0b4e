// SPDX-License-Identifier: Apache-2.0
#include "job/phases/cost_model.h"

#include <math.h>

#include "base/core/elementary.h"
#include "sampling/solver/schedule.h"

/* Fraction of the remaining time that a run may be predicted to take: the number of sweeps varies by a few
 * tenths. */
static const double FILL = 0.75;
/* Maximum ratio of the counts of consecutive runs: each run costs a sixth of the next. */
static const double LONGEST_STRIDE = 6;
/* Minimum ratio of the counts: a smaller gain is not worth a run. */
static const double LEAST_GAIN = 1.05;
/* Exponent of time over count: assumed after the first run, and the range accepted from two runs. Work that
 * does not depend on the count reduces it; an increasing number of sweeps raises it. */
static const double POWER_FIRST = 1.1, POWER_LOW = 0.7, POWER_HIGH = 1.4;
/* Minimum time of a run: the resolution of clocks. */
static const double SHORTEST_S = 1e-3;

/* Fitted to schedule_multilevel: after a change of its sweeps, fit this and PER_POINT again
 * (measurements/inputs/estimates.py).
 * Time of a sweep of a level with extra sweeps for its defects, over that of another sweep: later sweeps have fewer
 * guarded steps. Such a level takes at least the time of its minimum number of sweeps. Larger: longer estimates from
 * 5 000 points. */
static const double EXTRA_SHARE = 0.5;
/* Time of the work done once per point (insertion, projection, measurement), in particle updates. From the trial run to a million
 * points the time of the sweeps grows by 35 on the torus and 28 on a level set of a sphere, and by 39 with this value. Larger:
 * longer estimates from 50 000 points. */
static const double PER_POINT = 20;
/* Minimum number of points of the coarsest level (doc/method.md, multilevel schedule). */
enum { LEVEL_LEAST = 100 };

cost_model cost_model_begin(size_t most)
{
    return (cost_model){.most = most};
}

void cost_model_note(cost_model *p, size_t count, double run_s, double rest_s)
{
    p->count[1] = p->count[0];
    p->run_s[1] = p->run_s[0];
    p->rest_s[1] = p->rest_s[0];
    p->count[0] = count;
    p->run_s[0] = fmax(run_s, SHORTEST_S);
    p->rest_s[0] = rest_s;
    p->runs++;
}

static double power(const cost_model *p)
{
    if (p->runs < 2 || p->count[0] == p->count[1]) return POWER_FIRST;
    /* if the counts of two runs are close, noise dominates the slope */
    double apart = fabs(elementary_log((double)p->count[0] / (double)p->count[1])),
           weight = apart / (apart + 1);
    double slope =
        elementary_log(p->run_s[0] / p->run_s[1]) / elementary_log((double)p->count[0] / (double)p->count[1]);
    return fmin(fmax(POWER_FIRST + weight * (slope - POWER_FIRST), POWER_LOW), POWER_HIGH);
}

size_t cost_model_next(const cost_model *p, double left_s)
{
    double ratio = elementary_pow(FILL * left_s / p->run_s[0], 1 / power(p));
    if (!(ratio >= LEAST_GAIN)) return 0;
    if (ratio > LONGEST_STRIDE) ratio = fmin(sqrt(ratio), LONGEST_STRIDE); /* two steps instead of one */
    double count = fmin(floor(ratio * (double)p->count[0]), (double)p->most);
    return count >= LEAST_GAIN * (double)p->count[0] ? (size_t)count : 0;
}

double cost_model_work(size_t count, bool by_levels)
{
    const schedule *s = &schedule_multilevel;
    double work = by_levels ? PER_POINT * (double)count : (double)count;
    for (size_t n = count; by_levels && n >= LEVEL_LEAST; n /= 4) {
        schedule_position at = {.levels = 1, .stage = SCHEDULE_STAGES - 1, .count = n};
        const double sweeps = schedule_level_sweeps(s, &at);
        at.has_many_defects = (double)n >= s->defects_count;
        work += (double)n * fmax(sweeps, EXTRA_SHARE * schedule_level_sweeps(s, &at));
    }
    return work;
}

double cost_model_rest(const cost_model *p, size_t count)
{
    return p->runs == 0 ? 0 : p->rest_s[0] * (double)count / (double)p->count[0];
}

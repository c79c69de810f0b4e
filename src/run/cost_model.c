#include "run/cost_model.h"

#include <math.h>

#include "solver/schedule.h"

/* Of the time that is left, what a run is expected to take: the number of sweeps varies by a few tenths. */
static const double FILL = 0.75;
/* A run has at most so many times the points of the one before it: each costs a sixth of the next. */
static const double LONGEST_STRIDE = 6;
/* A run with fewer more points is not worth its time. */
static const double LEAST_GAIN = 1.05;
/* The power by which time goes with the count: of the first run, and what two runs may say. A part that does
 * not depend on the count makes it small, sweeps that become more make it large. */
static const double POWER_FIRST = 1.1, POWER_LOW = 0.7, POWER_HIGH = 1.4;
/* Clocks count milliseconds. */
static const double SHORTEST_S = 1e-3;

/* Time of a level of schedule.defects_count points and more over that of its least sweeps. Most such levels take 3.5 times as many
 * sweeps, but with fewer guarded steps than coarser levels, and points at rest are skipped. Median of the meshes of
 * doc/measured/estimates.md. Larger: longer estimates from 5 000 points on. */
static const double LONGER = 1.5;
/* Updates that take as long as all that is done once for a point: to insert it, to project and to measure it. With 50 000 points
 * meshes take 1.7 times as long as with 10 000 (median of doc/measured/meshes.md). Larger: longer estimates from 50 000 points on. */
static const double PER_POINT = 30;
/* The coarsest level has at least this many points (doc/method.md, multilevel schedule). */
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
    /* of two runs that are not far apart the noise says more than the slope */
    double apart = fabs(log((double)p->count[0] / (double)p->count[1])), weight = apart / (apart + 1);
    double slope = log(p->run_s[0] / p->run_s[1]) / log((double)p->count[0] / (double)p->count[1]);
    return fmin(fmax(POWER_FIRST + weight * (slope - POWER_FIRST), POWER_LOW), POWER_HIGH);
}

size_t cost_model_next(const cost_model *p, double left_s)
{
    double ratio = pow(FILL * left_s / p->run_s[0], 1 / power(p));
    if (!(ratio >= LEAST_GAIN)) return 0;
    if (ratio > LONGEST_STRIDE) ratio = fmin(sqrt(ratio), LONGEST_STRIDE); /* and the rest in a second */
    double count = fmin(floor(ratio * (double)p->count[0]), (double)p->most);
    return count >= LEAST_GAIN * (double)p->count[0] ? (size_t)count : 0;
}

double cost_model_work(size_t count, bool by_levels)
{
    const schedule *s = &schedule_multilevel;
    double work = by_levels ? PER_POINT * (double)count : (double)count;
    for (size_t n = count; by_levels && n >= LEVEL_LEAST; n /= 4) {
        const schedule_position at = {.levels = 1, .stage = SCHEDULE_STAGES - 1, .count = n};
        work += (double)n * schedule_level_sweeps(s, &at) * ((double)n < s->defects_count ? 1 : LONGER);
    }
    return work;
}

double cost_model_rest(const cost_model *p, size_t count)
{
    return p->runs == 0 ? 0 : p->rest_s[0] * (double)count / (double)p->count[0];
}

#include "run/cost_model.h"

#include <math.h>

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

double cost_model_run(const cost_model *p, size_t count)
{
    double each = p->run_s[0] / (double)p->count[0];
    if (p->runs > 1 && p->run_s[0] > p->run_s[1])
        each = (p->run_s[0] - p->run_s[1]) / ((double)p->count[0] - (double)p->count[1]);
    return p->run_s[0] + each * ((double)count - (double)p->count[0]);
}

double cost_model_rest(const cost_model *p, size_t count)
{
    return p->runs == 0 ? 0 : p->rest_s[0] * (double)count / (double)p->count[0];
}

// SPDX-License-Identifier: Apache-2.0
#include "surface/labels/label_weights.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"

static const char what[] = "the weights of the labels";

/* Newton's method for the logarithm of each weight separately. A step is multiplied by part_of_step, because
 * the neighbouring label also moves. A weight is at most doubled or halved; this limit decreases by `less`
 * after an overshoot and increases by `more` otherwise. A layer of voxels may change its label in one step,
 * so that the best round is used. The rounds take less than a tenth of the filter's time. */
static const double part_of_step = 0.7, first_limit = M_LN2, less = 0.5, more = 1.2;
static const double enough = 0.001; /* tolerance, as a fraction of the voxels of a label */
enum { ROUNDS = 40 };

/* near_factor = e^-near_log, near_log = 0.2. Voxels whose winner changes if the weight of a label changes by
 * this factor estimate the slope of Newton's method. */
static const float near_factor = 0.8187308F;
static const double near_log = 0.2;

typedef struct tally {
    int64_t won, near;
} tally;

/* The state of a label: the maximum change of the logarithm of its weight in the next round, and the sign of
 * its last deviation. */
typedef struct weight_step {
    double limit;
    int lacked; /* 1: too few voxels; -1: too many; 0: within the tolerance so far */
} weight_step;

typedef struct weights_job {
    const label_contests *list;
    float *weight; /* weights of this round */
    tally *of;     /* per worker and label */
    size_t labels;
    weight_step *steps; /* per label */
} weights_job;

static void count_wins(void *context, int worker, size_t begin, size_t end)
{
    const weights_job *f = context;
    tally *of = f->of + (size_t)worker * f->labels;
    for (size_t n = begin; n < end; n++)
        for (size_t i = 0; i < f->list[n].count; i++) {
            const label_contest *c = &f->list[n].at[i];
            const int best = label_weights_winner(c, f->weight);
            const float enough_to_be_near = near_factor * (float)c->share[best] * f->weight[c->label[best]];
            bool any = false;
            of[c->label[best]].won++;
            for (int k = 0; k < LABEL_RIVALS && c->share[k] > 0; k++) {
                const bool near =
                    k != best && (float)c->share[k] * f->weight[c->label[k]] >= enough_to_be_near;
                of[c->label[k]].near += near;
                any |= near;
            }
            of[c->label[best]].near += any;
        }
}

/* Adds the tallies of all workers to those of the first one. Returns the sum over all labels of the relative
 * error of their numbers of voxels. */
static double sum_tallies(weights_job *f, size_t workers, const label_wish *wish)
{
    double missed = 0;
    for (size_t k = 0; k < f->labels; k++) {
        for (size_t w = 1; w < workers; w++) {
            f->of[k].won += f->of[w * f->labels + k].won;
            f->of[k].near += f->of[w * f->labels + k].near;
        }
        missed += fabs((double)(wish[k].wanted - f->of[k].won)) / fmax(1, (double)wish[k].voxels);
    }
    return missed;
}

/* Makes one step. Returns whether no weight changed: every label is within the tolerance or at a bound. */
static bool change_weights(const weights_job *f, const label_wish *wish)
{
    const double most = sqrt(LABEL_WEIGHTS_RATIO);
    bool all = true;
    for (size_t k = 0; k < f->labels; k++) {
        const double lacks = (double)(wish[k].wanted - f->of[k].won),
                     slope = (double)f->of[k].near / (2 * near_log);
        if (fabs(lacks) <= fmax(1, enough * (double)wish[k].voxels)) continue;
        weight_step *c = &f->steps[k];
        const int lacked = lacks > 0 ? 1 : -1;
        c->limit = c->lacked == -lacked ? less * c->limit : fmin(more * c->limit, first_limit);
        c->lacked = lacked;
        const double step = slope > 0 ? part_of_step * lacks / slope : lacks,
                     next = (double)f->weight[k] * elementary_exp(fmin(fmax(step, -c->limit), c->limit));
        const float changed = (float)fmin(fmax(next, 1 / most), most);
        all &= changed == f->weight[k];
        f->weight[k] = changed;
    }
    return all;
}

bool label_weights_find(const label_contests *list, size_t lists, const label_wish *wish, size_t labels,
                        threads *pool, float *weight, error *e)
{
    const size_t workers = (size_t)threads_count(pool);
    weights_job f = {.list = list, .labels = labels};
    const bool ok = (f.of = mem_array(workers * labels, sizeof *f.of, what, e)) &&
                    (f.steps = mem_array(labels, sizeof *f.steps, what, e)) &&
                    (f.weight = mem_array(labels, sizeof *f.weight, what, e));
    bool done = !ok;
    double least = INFINITY;
    for (size_t k = 0; ok && k < labels; k++) {
        weight[k] = f.weight[k] = 1;
        f.steps[k].limit = first_limit;
    }
    for (int round = 0; round < ROUNDS && !done; round++) {
        memset(f.of, 0, workers * labels * sizeof *f.of);
        threads_run(pool, lists, 1, count_wins, &f);
        const double missed = sum_tallies(&f, workers, wish);
        if (missed < least) memcpy(weight, f.weight, labels * sizeof *weight);
        least = fmin(least, missed);
        done = change_weights(&f, wish);
    }
    free(f.of);
    free(f.steps);
    free(f.weight);
    return ok;
}

size_t label_weights_bytes(size_t labels, size_t workers)
{
    return labels * (workers * sizeof(tally) + sizeof(weight_step) + 2 * sizeof(float) + sizeof(label_wish));
}

// SPDX-License-Identifier: Apache-2.0
#include "surface/labels/label_weights.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

static const char what[] = "the weights of the labels";

/* Newton's method, label by label. Both of two labels that meet move by the whole step, so the step is
 * reduced; a weight is at most doubled or halved, and by less each time that it went too far: a layer is won
 * or lost in one step, and the best round counts. Rounds take less than a tenth of the filter's time. */
static const double part_of_step = 0.7, first_limit = M_LN2, less = 0.5, more = 1.2;
static const double enough = 0.001; /* of the voxels of a label, too many or too few */
enum { ROUNDS = 40 };

/* Voxels won, and those that go from or to a label when its weight changes by a factor of at most e^NEAR. */
static const float near_factor = 0.8187308F; /* e^-.2 */
static const double near_log = 0.2;

typedef struct tally {
    int64_t won, near;
} tally;

/* For a label: the maximum next change of its weight, in logarithms, and whether it lacked voxels the last
 * time. */
typedef struct course {
    double limit;
    int lacked; /* 1, or -1; 0: neither */
} course;

typedef struct finding {
    const label_contests *list;
    float *weight; /* of this round */
    tally *of;     /* of each worker, of each label */
    size_t labels;
    course *course; /* of each label */
} finding;

static void count_wins(void *context, int worker, size_t begin, size_t end)
{
    const finding *f = context;
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

/* Adds all workers' tallies to the first one's. Returns the sum over labels of how many voxels too many or
 * too few each has, as a share of its own. */
static double sum_tallies(finding *f, size_t workers, const label_wish *wish)
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

/* Returns whether none changes any more: all have about what they want, or are at a bound. */
static bool change_weights(const finding *f, const label_wish *wish)
{
    const double most = sqrt(LABEL_WEIGHTS_RATIO);
    bool all = true;
    for (size_t k = 0; k < f->labels; k++) {
        const double lacks = (double)(wish[k].wanted - f->of[k].won),
                     slope = (double)f->of[k].near / (2 * near_log);
        if (fabs(lacks) <= fmax(1, enough * (double)wish[k].voxels)) continue;
        course *c = &f->course[k];
        const int lacked = lacks > 0 ? 1 : -1;
        c->limit = c->lacked == -lacked ? less * c->limit : fmin(more * c->limit, first_limit);
        c->lacked = lacked;
        const double step = slope > 0 ? part_of_step * lacks / slope : lacks,
                     next = (double)f->weight[k] * exp(fmin(fmax(step, -c->limit), c->limit));
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
    finding f = {.list = list, .labels = labels};
    const bool ok = (f.of = mem_array(workers * labels, sizeof *f.of, what, e)) &&
                    (f.course = mem_array(labels, sizeof *f.course, what, e)) &&
                    (f.weight = mem_array(labels, sizeof *f.weight, what, e));
    bool done = !ok;
    double least = INFINITY;
    for (size_t k = 0; ok && k < labels; k++) {
        weight[k] = f.weight[k] = 1;
        f.course[k].limit = first_limit;
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
    free(f.course);
    free(f.weight);
    return ok;
}

size_t label_weights_bytes(size_t labels, size_t workers)
{
    return labels * (workers * sizeof(tally) + sizeof(course) + 2 * sizeof(float) + sizeof(label_wish));
}

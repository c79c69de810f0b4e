// SPDX-License-Identifier: Apache-2.0
/* cost_model: predicts the time of a run from runs with fewer points, and how many points fit into the time
 * that is left.
 *
 *     cost_model p = cost_model_begin(most);
 *     for (size_t count = COST_MODEL_FIRST; count > 0; count = cost_model_next(&p, left_s)) {
 *         ...;
 *         cost_model_note(&p, ...);
 *     }
 *
 * The model: time is a power of the count. The last two runs give the exponent. Each run has at most a few
 * times as many points as the one before, so that the prediction is accurate. Pure arithmetic; reads no
 * clock.
 */
#ifndef HEXAD_JOB_PHASES_COST_MODEL_H
#define HEXAD_JOB_PHASES_COST_MODEL_H

#include <stdbool.h>
#include <stddef.h>

#define COST_MODEL_FIRST 200 /* points: a run of milliseconds */

typedef struct cost_model {
    size_t most; /* maximum number of points that memory permits */
    size_t runs;
    size_t count[2];  /* of the last run and of the one before */
    double run_s[2];  /* seconds of these runs, from the placement of points to their measurement */
    double rest_s[2]; /* seconds of these that followed the relaxation */
} cost_model;

cost_model cost_model_begin(size_t most);

/* Adds a run of `count` points: its total time, and the part of it that followed the relaxation, seconds. */
void cost_model_note(cost_model *p, size_t count, double run_s, double rest_s);

/* The count of the next run when left_s remain; 0: no run with more points fits. */
size_t cost_model_next(const cost_model *p, double left_s);

/* Predicts a quantity proportional to the time up to the last sweep, in particle updates. `by_levels`: the
 * solve has levels (schedule_multilevel); otherwise the quantity is the count. */
double cost_model_work(size_t count, bool by_levels);

/* Predicts the seconds that a run of `count` points takes after its relaxation. */
double cost_model_rest(const cost_model *p, size_t count);

#endif

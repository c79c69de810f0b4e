/* cost_model: predicts from runs with fewer points how long a run takes, and how many points fit into the time that is
 * left.
 *
 *     cost_model p = cost_model_begin(most);
 *     for (size_t count = COST_MODEL_FIRST; count > 0; count = cost_model_next(&p, left_s)) {
 *         ...;
 *         cost_model_note(&p, ...);
 *     }
 *
 * The model: time is a power of the count. The last two runs give the exponent. A run has few times the points of the
 * one before it, so that the prediction is good. Pure arithmetic; reads no clock.
 */
#ifndef HEXAD_RUN_COST_MODEL_H
#define HEXAD_RUN_COST_MODEL_H

#include <stdbool.h>
#include <stddef.h>

#define COST_MODEL_FIRST 200 /* points: a run of milliseconds */

typedef struct cost_model {
    size_t most; /* points that memory holds */
    size_t runs;
    size_t count[2];  /* of the last run and of the one before */
    double run_s[2];  /* what they took, from placing the points to measuring them */
    double rest_s[2]; /* of that, what came after the relaxation */
} cost_model;

cost_model cost_model_begin(size_t most);

/* A run of `count` points took run_s, of which rest_s after its relaxation. */
void cost_model_note(cost_model *p, size_t count, double run_s, double rest_s);

/* The count of the next run when left_s remain; 0: no run with more points fits. */
size_t cost_model_next(const cost_model *p, double left_s);

/* Predicts what the time up to the last sweep is proportional to, in updates of a particle. `by_levels`: the solve has levels
 * (schedule_multilevel); otherwise it is the count. */
double cost_model_work(size_t count, bool by_levels);

/* Predicts the seconds that a run of `count` points takes after its relaxation. */
double cost_model_rest(const cost_model *p, size_t count);

#endif

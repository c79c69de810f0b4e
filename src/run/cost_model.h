/* cost_model: how long a run of so many points takes, and how many points fit into the time that is left, learnt from
 * runs with fewer points.
 *
 *     cost_model p = cost_model_begin(most);
 *     for (size_t count = COST_MODEL_FIRST; count > 0; count = cost_model_next(&p, left_s)) {
 *         ...;
 *         cost_model_note(&p, ...);
 *     }
 *
 * The time of a run is taken to go as a power of its count, which the last two runs give; a run is never of
 * much more points than the one before it, so that what it takes is known well. Pure arithmetic; no clock is
 * read here.
 */
#ifndef HEXAD_RUN_COST_MODEL_H
#define HEXAD_RUN_COST_MODEL_H

#include <stddef.h>

#define COST_MODEL_FIRST 200 /* points: a run of milliseconds */

typedef struct cost_model {
    size_t most; /* more points than this are more than memory holds */
    size_t runs;
    size_t count[2];  /* of the last run and of the one before */
    double run_s[2];  /* what they took, from placing the points to measuring them */
    double rest_s[2]; /* of that, what came after the relaxation */
} cost_model;

cost_model cost_model_begin(size_t most);

/* A run of `count` points took run_s, of which rest_s after its relaxation. */
void cost_model_note(cost_model *p, size_t count, double run_s, double rest_s);

/* The count of the next run when left_s remain; 0: none with more points fits. */
size_t cost_model_next(const cost_model *p, double left_s);

/* What a run of `count` points is expected to take, seconds, by the last two runs, the later one of more points: a
 * part that is the same in all, as the coarsest levels are that they share, and one that goes with the count. */
double cost_model_run(const cost_model *p, size_t count);

/* What a run of `count` points is expected to take after its relaxation, seconds. */
double cost_model_rest(const cost_model *p, size_t count);

#endif

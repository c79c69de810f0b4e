/* state: what a sampler is made of. Private to sampler.c, which runs it, control.c, which acts between
 * rounds, and finalize.c, which ends it. */
#ifndef HEXAD_SAMPLER_SAMPLER_INTERNAL_H
#define HEXAD_SAMPLER_SAMPLER_INTERNAL_H

#include "sampler/levels.h"
#include "sampler/particles.h"
#include "sampler/relax.h"
#include "sampler/sampler.h"
#include "sampler/schedule.h"

enum { SAMPLER_MAX_ROUNDS = 40 };

/* A way to solve: what differs between the method of 2005 and that of 1994. */
typedef struct sampler_method {
    bool (*begin)(sampler *s, error *e);    /* the particles are placed */
    bool (*step)(sampler *s, error *e);     /* see sampler_step */
    bool (*describe)(sampler *s, error *e); /* the particles are final: completes s->out */
    void (*release)(sampler *s);            /* of what was begun, or was not */
} sampler_method;

extern const sampler_method sampler_meyer;           /* sampler.c */
extern const sampler_method sampler_witkin_heckbert; /* witkin_heckbert.c */

struct sampler {
    const sampler_method *method;
    const field *field;
    const surface *scan;
    sampler_params params;
    threads *pool;
    particles *p;
    size_t capacity; /* of p and relax */
    relax *relax;
    const schedule *schedule;
    const fast_kernel *fast; /* of relax; NULL: the energy, amplitudes or minimiser need the general way */
    double spacing;          /* h */
    double sigma;
    double skin;
    size_t level_count[LEVELS_MAX]; /* particles of each level; the last is params.count */
    int level, levels;
    bool planned; /* the counts were corrected by what the coarsest packing showed */
    int stage;    /* of the schedule */
    double gain;  /* in force: that of the stage, or more when it does not come to rest */
    bool lists_stale;
    int list_age;           /* sweeps since they were built */
    size_t next_amplitudes; /* the sweep before which they are renewed */
    int resizes;            /* in the round: rests that new sizes ended */
    sampler_outcome outcome;
    size_t removed;
    sampler_sweep *sweep;
    size_t sweep_count;
    sampler_round round[SAMPLER_MAX_ROUNDS];
    size_t round_count;
    int sweeps_in_round;
    double fraction;
    struct swarm *swarm; /* of sampler_witkin_heckbert */
    sampler_points out;
    bool *replaced; /* of each particle, from sampler_finalize on */
    double *column; /* kappa, kappa1, kappa2, spacing: one after the other */
};

/* (14), with curvature freed of scale by L and bounded. */
double sampler_amplitude(const sampler *s, double kappa);

/* Sizes of the particles where they are; returns the rms of their relative change. */
double sampler_resize(sampler *s);

/* Whether a mean energy over mean alpha is the ideal one, within the tolerance asked for. */
bool sampler_is_on_target(const sampler *s, double energy);

/* From the level at hand to the next, without relaxing it. Errors: limit_memory, no_surface. */
bool sampler_refine(sampler *s, error *e);

/* Amplitudes, if they are due, boundaries, and lists for the support at hand. Error: limit_memory. */
bool sampler_build_lists(sampler *s, error *e);

/* The coarsest packing shows, after its first round, whether it resolves the surface at all, and after each
 * later one how many particles its refinement will give. When another count would have been better it begins
 * again with that, *again. Errors: limit_memory, no_surface. */
bool sampler_replan(sampler *s, bool *again, error *e);

/* Room for `capacity` particles, in whatever holds one entry for each; lists are to be built anew. Error:
 * limit_memory, also when the count is beyond params.count_limit. */
bool sampler_reserve(sampler *s, size_t capacity, error *e);

/* A round has come to rest: adapts the support and looks closer, refines, or ends. Errors: limit_memory,
 * no_surface. */
bool sampler_control(sampler *s, error *e);

#endif

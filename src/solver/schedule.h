/* schedule: the numbers by which a solve proceeds. A schedule is a constant table: over-relaxation, step limits, criteria of convergence, sweeps
 * by particle count, and when neighbour lists are rebuilt. The functions compute answers from a table and a position in the solve; they
 * change nothing.
 *
 * A solve has levels, from the coarsest packing to the finest. The coarsest level has SCHEDULE_STAGES stages, each with a smaller gain. A
 * finer level has the last stage only. A round is the sweeps until the particles have converged. Pure functions, any thread. */
#ifndef HEXAD_SOLVER_SCHEDULE_H
#define HEXAD_SOLVER_SCHEDULE_H

#include <stdbool.h>
#include <stddef.h>

enum { SCHEDULE_STAGES = 3 };

typedef struct schedule {
    /* Gain: the smallest decrease of a particle's energy, as a fraction of it, for which the particle moves. The first stage only evens out the
     * density, so that sigma is adapted before work is done under a wrong one. */
    double gain[SCHEDULE_STAGES];
    /* On features smaller than h some particles never converge: each sweep reduces their energy by slightly more than the gain. After
     * `patience` sweeps of a round, and not before the least sweeps of its level, the gain is multiplied by 10, and again after every
     * `patience_more`. Beyond coarsest_gain, with which a solve is not converged, this takes `patience_last` sweeps each. */
    int patience[SCHEDULE_STAGES], patience_more, patience_last;
    double coarsest_gain;

    /* Over-relaxation: the factor on Newton's step with the first term of the Hessian (10), which is about twice the true one. If is_paced,
     * a level starts with omega_shake (omega_shake_sized with a sizing field), falls to omega over its least sweeps, and then falls
     * with the inverse number of sweeps to omega_least. Otherwise the factor is omega. */
    bool is_paced;
    double omega, omega_shake, omega_shake_sized, omega_least;
    /* Longest fast step, over h. If is_paced, steps are unlimited during the least sweeps of a level, and during shake_sweeps of an earlier
     * stage; then the limit falls from longest_step with the inverse square of the sweeps. */
    double longest_step;
    int shake_sweeps;

    /* Least sweeps of a level of n particles: sweeps (sweeps_count / n)^sweeps_fall, between sweeps_least and sweeps_most. */
    double sweeps, sweeps_count, sweeps_fall, sweeps_least, sweeps_most;
    /* After these sweeps the defect fraction (particles without six neighbours) of a level of at least defects_count particles is
     * compared with defects_share: [0] of level sets and [1] of meshes that are sampled on their triangles, and of labels, lower and upper bound. Between the bounds the level takes
     * more sweeps, once: defects_sweeps[1] times as many on the last level, [0] times on others. Above the upper bound the surface is
     * not resolved, and more sweeps do not help. */
    double defects_count, defects_sweeps[2], defects_share[2][2];

    /* Convergence, by the rms step over h. rest_lambda > 0: the paper's criterion on the coarsest level, a mean log10 lambda above it.
     * level_step, level_sweeps: a level that is refined again ends at this step or after these sweeps. stage_step, stage_sweeps_most:
     * the same for each stage of a coarsest level that is judged by steps. finest_rest times the job's tolerance ends the last level: over-relaxed steps are longer than what is left. */
    double finest_rest, rest_lambda, level_step, stage_step[SCHEDULE_STAGES];
    int level_sweeps, stage_sweeps_most;
    /* Convergence holds if the sizes at the present positions differ from those in use by less than this (rms, relative). A round may lose it
     * at most resizes_most times. */
    double size_settled;
    int resizes_most;

    /* Neighbour lists are rebuilt if their validity limits the steps of more than this fraction of the particles, limited_share_coarse on levels
     * that are refined again, or if it limits any step and they are limited_wait sweeps old. */
    double limited_share, limited_share_coarse;
    int limited_wait;
    /* Verlet skin, over h: the reach of lists beyond the support. skin_steps times the rms step, between the other two. */
    double skin_wide, skin_narrow, skin_steps;

    /* The coarsest level is dropped if more than this fraction of its particles has divergent neighbour normals; divergent_share_start before
     * its first sweep. With one number for both, fog volumes lose up to 0.02 of hex_fraction at 5 000 points
     * (densityAndHeat, monkey_mantaflow, vpt_dragon_fog). */
    double divergent_share, divergent_share_start;

    /* Sweeps of the first particles of a connected part before they join the others. */
    int new_part_sweeps;
} schedule;

extern const schedule schedule_paper;      /* the paper's criterion (section 7); any energy, any minimiser */
extern const schedule schedule_packed;     /* the same, from positions that are a packing */
extern const schedule schedule_multilevel; /* the default: fast steps, sweeps by particle count */
extern const schedule
    schedule_continued; /* fast steps from positions near convergence, as of a frame of a sequence */

/* Position in a solve. */
typedef struct schedule_position {
    int level, levels, stage;
    int sweeps;               /* of the round */
    size_t count;             /* particles of the level */
    bool is_sized;            /* there is a sizing field */
    bool has_many_defects;    /* of the level, see schedule_has_many_defects */
    bool has_patches;         /* it is a mesh that is sampled on its triangles, or the interfaces of labels */
    bool is_divergent;        /* relax_has_divergent_normals */
    bool is_mostly_divergent; /* relax_has_mostly_divergent_normals */
} schedule_position;

static inline bool schedule_is_last_stage(const schedule_position *at)
{
    return at->stage == SCHEDULE_STAGES - 1;
}

static inline bool schedule_is_last_level(const schedule_position *at)
{
    return at->level == at->levels - 1;
}

/* Least sweeps of the level. */
int schedule_level_sweeps(const schedule *s, const schedule_position *at);

/* Whether the level has just completed its least sweeps and its defect fraction decides about more. */
bool schedule_judges_defects(const schedule *s, const schedule_position *at);

/* Whether a level with this defect fraction takes more sweeps. */
bool schedule_has_many_defects(const schedule *s, const schedule_position *at, double defect_fraction);

double schedule_omega(const schedule *s, const schedule_position *at);

/* Whether steps may be long and energies may rise, as in the least sweeps of a paced level. */
bool schedule_is_shaken(const schedule *s, const schedule_position *at);

/* The longest fast step, over h; may be INFINITY. */
double schedule_longest_step(const schedule *s, const schedule_position *at);

/* Results of a sweep. */
typedef struct schedule_evidence {
    double rms_step;          /* over h */
    double mean_log10_lambda; /* used if has_lambda */
    bool has_lambda;          /* false for the gradient minimiser */
    double step_tolerance;    /* of the rms step, from the job */
} schedule_evidence;

/* Whether the round ends, and why: its criterion of convergence holds, or the sweeps of its level or stage are spent. */
typedef enum schedule_end { SCHEDULE_GOES_ON, SCHEDULE_CONVERGED, SCHEDULE_SWEEPS_SPENT } schedule_end;

schedule_end schedule_round_end(const schedule *s, const schedule_position *at,
                                const schedule_evidence *seen);

/* Whether `gain` is to be multiplied by 10 after this sweep of the round. */
bool schedule_is_impatient(const schedule *s, const schedule_position *at, double gain);

/* Whether lists of this age in sweeps are to be rebuilt if their validity limits `limited` particles. */
bool schedule_wants_lists(const schedule *s, const schedule_position *at, size_t limited, int age);

/* The Verlet skin of the next lists, over h. That of the first lists of a level is skin_wide. */
double schedule_skin(const schedule *s, double rms_step);

/* Estimated sweeps of the level in all, at least 1, after `spent` sweeps. `seen`: of the last sweep; NULL of a level that has not begun. */
double schedule_expected_sweeps(const schedule *s, const schedule_position *at, double spent,
                                const schedule_evidence *seen);

#endif

/* schedule: the numbers by which a solve proceeds. A schedule is a constant table: over-relaxation, step limits, convergence criteria, sweeps by
 * particle count, and when neighbour lists are rebuilt. The functions evaluate a table at a position in the solve. Pure functions, any thread.
 *
 * A solve has levels, from the coarsest packing to the finest. The coarsest level has SCHEDULE_STAGES stages, each with a smaller gain. A finer level
 * has the last stage only. A round is the sequence of sweeps until convergence. h is the spacing of the level. */
#ifndef HEXAD_SOLVER_SCHEDULE_H
#define HEXAD_SOLVER_SCHEDULE_H

#include <stdbool.h>
#include <stddef.h>

enum { SCHEDULE_STAGES = 3 };

typedef struct schedule {
    /* Per stage: the gain, the smallest relative decrease of its energy for which a particle moves. The first stage only equalises the density,
     * so that sigma is adapted before much work is done with a wrong sigma. */
    double gain[SCHEDULE_STAGES];
    /* On features smaller than h some particles never converge: each sweep reduces their energy by slightly more than the gain. After `patience` sweeps
     * of a round (per stage), and at least the least sweeps of its level, the gain is multiplied by 10, and again after every `patience_more` sweeps.
     * Steps to a gain above coarsest_gain take `patience_last` sweeps. A solve with such a gain has not converged. */
    int patience[SCHEDULE_STAGES], patience_more, patience_last;
    double coarsest_gain;

    /* Over-relaxation: the factor on the Newton step with the first term of the Hessian (10), which is about twice the true Hessian. is_paced: it is
     * omega_shake (omega_shake_sized with a sizing field) at the start of a level, falls to omega over the least sweeps, and then falls with the
     * inverse number of sweeps to omega_least. Otherwise it is omega. */
    bool is_paced;
    double omega, omega_shake, omega_shake_sized, omega_least;
    /* Maximum length of a fast step over h. is_paced: unlimited during the least sweeps of a level, and during the first shake_sweeps of an earlier
     * stage; then it falls from longest_step with the inverse square of the number of sweeps. */
    double longest_step;
    int shake_sweeps;

    /* Least sweeps of a level of n particles: sweeps (sweeps_count / n)^sweeps_fall, between sweeps_least and sweeps_most. */
    double sweeps, sweeps_count, sweeps_fall, sweeps_least, sweeps_most;
    /* After these sweeps the defect fraction (particles without six neighbours) of a level of at least defects_count particles is compared with the
     * bounds defects_share[p], p = 1 for surfaces with patches (meshes sampled on their triangles, interfaces of labels), else 0. Between the lower
     * and the upper bound the level takes more sweeps, once: defects_sweeps[1] times as many on the last level, defects_sweeps[0] times on others. Above
     * the upper bound the surface is not resolved, and more sweeps do not help. */
    double defects_count, defects_sweeps[2], defects_share[2][2];

    /* Convergence criteria; steps are rms steps over h. rest_lambda > 0: the paper's criterion on the coarsest level, a mean log10 lambda above it.
     * level_step, level_sweeps: with that criterion, a level between the coarsest and the last ends at this step or after these sweeps. rest_lambda = 0: a
     * stage of the coarsest level ends at stage_step or after stage_sweeps_most sweeps; the last level ends at finest_rest times the tolerance of
     * the job, because over-relaxed steps are longer than the Newton steps that are left. */
    double finest_rest, rest_lambda, level_step, stage_step[SCHEDULE_STAGES];
    int level_sweeps, stage_sweeps_most;
    /* Convergence requires that sizes and amplitudes at the present positions differ from those in use by less than this (rms, relative). A round may
     * fail this at most resizes_most times. */
    double size_settled;
    int resizes_most;

    /* Neighbour lists are rebuilt if their validity limits the steps of more than limited_share of the particles (limited_share_coarse on levels before
     * the last), or if it limits any step and the lists are at least limited_wait sweeps old. */
    double limited_share, limited_share_coarse;
    int limited_wait;
    /* Verlet skin over h: the reach of the lists beyond the support. It is skin_steps times the rms step, clamped to skin_narrow .. skin_wide. */
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

/* Whether the level has just completed its least sweeps, and its defect fraction must be tested. */
bool schedule_judges_defects(const schedule *s, const schedule_position *at);

/* Whether a level with this defect fraction takes more sweeps. */
bool schedule_has_many_defects(const schedule *s, const schedule_position *at, double defect_fraction);

/* The over-relaxation factor. */
double schedule_omega(const schedule *s, const schedule_position *at);

/* Whether steps are unlimited: the least sweeps of a paced level, or the first shake_sweeps of an earlier stage. Energies may rise then. */
bool schedule_is_shaken(const schedule *s, const schedule_position *at);

/* The maximum length of a fast step over h; may be INFINITY. */
double schedule_longest_step(const schedule *s, const schedule_position *at);

/* Results of a sweep. */
typedef struct schedule_evidence {
    double rms_step;          /* over h */
    double mean_log10_lambda; /* used if has_lambda */
    bool has_lambda;          /* false for the gradient minimiser */
    double step_tolerance;    /* of the rms step, from the job */
} schedule_evidence;

/* Whether the round ends: CONVERGED, its criterion holds; SWEEPS_SPENT, the sweeps of its level or stage are spent. */
typedef enum schedule_end { SCHEDULE_GOES_ON, SCHEDULE_CONVERGED, SCHEDULE_SWEEPS_SPENT } schedule_end;

schedule_end schedule_round_end(const schedule *s, const schedule_position *at,
                                const schedule_evidence *seen);

/* Whether `gain` is to be multiplied by 10 after this sweep of the round. */
bool schedule_is_impatient(const schedule *s, const schedule_position *at, double gain);

/* Whether lists must be rebuilt. `limited`: number of particles whose step is limited by their validity; `age`: in sweeps. */
bool schedule_wants_lists(const schedule *s, const schedule_position *at, size_t limited, int age);

/* The Verlet skin of the next lists, over h. That of the first lists of a level is skin_wide. */
double schedule_skin(const schedule *s, double rms_step);

/* Estimates the total number of sweeps of the level, at least 1, after `spent` sweeps. `seen`: results of the last sweep; NULL: the level has not begun. */
double schedule_expected_sweeps(const schedule *s, const schedule_position *at, double spent,
                                const schedule_evidence *seen);

#endif

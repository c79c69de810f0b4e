// SPDX-License-Identifier: Apache-2.0
/* schedule: the numbers by which a solve proceeds, a constant table: over-relaxation, step limits,
 * convergence criteria, sweeps of each level, and when neighbour lists are rebuilt. The functions evaluate a
 * table at a position in the solve. Pure functions, any thread.
 *
 * A solve has levels, from the coarsest packing to the finest. The coarsest level has SCHEDULE_STAGES stages,
 * each with a smaller gain; the stages before the last one are called earlier stages. A finer level has the
 * last stage only. A round is the sequence of sweeps until convergence. h is the spacing of the level. There
 * are two convergence criteria: the paper's (mean log10 lambda, if rest_lambda > 0), and the rms step over h
 * (if rest_lambda is 0: the schedule is judged by steps). */
#ifndef HEXAD_SAMPLING_SOLVER_SCHEDULE_H
#define HEXAD_SAMPLING_SOLVER_SCHEDULE_H

#include <stdbool.h>
#include <stddef.h>

enum { SCHEDULE_STAGES = 3 };

typedef struct schedule {
    /* Gain: the smallest decrease of a particle's energy, as a fraction of it, for which the particle moves
     * in the last stage. Each earlier stage has a hundred times the gain of the next stage. Earlier stages
     * only equalise the density: the support sigma is adapted after each of them, and precise sweeps under
     * a wrong sigma would be wasted. */
    double gain;
    /* On features smaller than h some particles never converge: each sweep reduces their energy by slightly
     * more than the gain. After `patience` sweeps of a round (a quarter of it in earlier stages), and not
     * before the least sweeps of its level, the gain is multiplied by 10, and again after every eighth of
     * `patience`. In the last stage a multiplication to a gain above schedule_coarsest_gain takes `patience`
     * sweeps instead. If the schedule is judged by steps, each stage of the coarsest level ends after
     * `patience` sweeps at the latest, except the last stage of a solve with a single level. */
    int patience;

    /* Over-relaxation: the factor omega on the step. Newton's step uses only the first term of the Hessian
     * (10); that term is about twice the true Hessian, so that a factor of 2 gives Newton's full step. If
     * is_paced, a level starts with the factor omega_shake. It falls to omega over the least sweeps of the
     * level, and then with the inverse number of sweeps to half of omega. Otherwise, and in earlier
     * stages, the factor is omega. */
    bool is_paced;
    double omega, omega_shake;
    /* Longest fast step, over h. If is_paced, steps are unlimited during the least sweeps of a level, and
     * during an eighth of sweeps_most of an earlier stage; then the limit falls from longest_step with the
     * inverse square of the sweeps. */
    double longest_step;

    /* Least sweeps of a level of n particles: (one_sweep_count / n)^sweeps_fall, rounded down and clamped to
     * sweeps_least .. sweeps_most. (With sweeps_most = 90, hex_fraction of meshes at 1 000 and 2 000 points is
     * 0.003 lower, and the time a tenth shorter.) The paper's criterion and schedule_continued do not use
     * them. A larger sweeps_fall gives more sweeps, since levels beyond one_sweep_count have sweeps_least. */
    double one_sweep_count, sweeps_fall, sweeps_least, sweeps_most;
    /* After these sweeps the defect fraction (particles without six neighbours) of a level of at least
     * defects_count particles is compared with defects_least and defects_most. Between them the level takes
     * defects_sweeps times as many sweeps, once, but at most defects_sweeps_most more: further sweeps hardly
     * change the result. Above defects_most the surface is not resolved, and more sweeps do not help. With
     * amplitudes it takes graded_sweeps times as many, without a limit: with 3, hex_fraction of meshes at
     * 30 000 points is 0.005 lower. */
    double defects_count, defects_sweeps, defects_sweeps_most, graded_sweeps, defects_least, defects_most;

    /* If the last stage of a level is repeated after a change of the support, the round begins at the
     * position of the level's least sweeps after which this fraction of them is left. The particles are
     * packed already: with 1, hex_fraction of meshes at 2 000 points is at most 0.001 higher. */
    double repeated_share;

    /* Convergence.
     * - rest_lambda > 0: the coarsest level ends by the paper's criterion, a mean log10 lambda above this
     *   value; its last stage also requires an rms step below the job's tolerance. 0: all levels are judged
     *   by steps: the last stage of the coarsest level, and a level that will be refined again, end with an
     *   rms step over h below the tolerance, each earlier stage with three times the value of the next one.
     *   Below a third of the tolerance a level that will be refined ends before its least sweeps. (With half
     *   of   the tolerance, hex_fraction at 20 000 points is 0.0006 lower.)
     * - finest_rest: the last level ends with an rms step over h below finest_rest times the job's tolerance.
     *   It may exceed 1, because over-relaxed steps are longer than the remaining distance to convergence.
     *   With 1 the coverage of a triangle soup of 1 000 points is a tenth larger; between 1.75 and 7 no
     *   case of measurements/packing (sensitivity.csv) changes. */
    double rest_lambda, finest_rest;

    /* Neighbour lists are rebuilt if their validity limits the steps of more than limited_share of the
     * particles, or if it limits any step and the lists are at least limited_wait sweeps old. */
    double limited_share;
    int limited_wait;
    /* Verlet skin over h: the reach of the lists beyond the support. It is skin_steps times the rms step,
     * clamped to skin_narrow .. skin_wide. */
    double skin_wide, skin_narrow, skin_steps;

    /* Amplitudes are renewed before the next sweep, and then each time after one sweep and this fraction of
     * the sweeps of the level. Each renewal builds lists. With 0.25 instead of 0.5 the multilevel schedule
     * takes 3 % longer on meshes. */
    double renewal_share;

    /* The coarsest level is dropped if more than this fraction of its particles has divergent neighbour
     * normals, before its first sweep or after its first stage. With a value of 0.5 or 0.7, hex_fraction of
     * fog volumes at 5 000 points would be up to 0.02 lower. */
    double divergent_share;
} schedule;

extern const schedule schedule_paper;      /* the paper's criterion (section 7); any energy, any minimiser */
extern const schedule schedule_packed;     /* schedule_paper for positions that are already a packing */
extern const schedule schedule_multilevel; /* the default: fast steps, sweeps by particle count */
extern const schedule
    schedule_continued; /* fast steps from positions near convergence, such as those of a frame of a
                         * sequence */
extern const schedule schedule_eased; /* a few sweeps for a packing that the motion of a frame has strained */

/* Position in a solve. */
typedef struct schedule_position {
    int level, levels, stage;
    int sweeps;               /* of the round */
    size_t count;             /* particles of the level */
    bool has_many_defects;    /* of the level, see schedule_has_many_defects */
    bool has_amplitudes;      /* of curvature: solver_params.graded */
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

/* The gain with which a stage begins. */
double schedule_gain(const schedule *s, int stage);

/* The largest gain with which a solve is converged. */
double schedule_coarsest_gain(const schedule *s);

/* Least sweeps of the level. */
int schedule_level_sweeps(const schedule *s, const schedule_position *at);

/* The position in the round at which a repeated last stage begins, see schedule.repeated_share. */
int schedule_repeated_from(const schedule *s, const schedule_position *at);

/* Least sweeps of the round: those of the level in its last stage, if the schedule is paced; otherwise 0. */
int schedule_least_sweeps(const schedule *s, const schedule_position *at);

/* Whether the level has just completed its least sweeps and its defect fraction decides about more. */
bool schedule_judges_defects(const schedule *s, const schedule_position *at);

/* Whether a level with this defect fraction takes more sweeps. */
bool schedule_has_many_defects(const schedule *s, double defect_fraction);

/* The over-relaxation factor. */
double schedule_omega(const schedule *s, const schedule_position *at);

/* Whether steps are unlimited: the least sweeps of a paced level, or the first sweeps of an earlier stage.
 * Energies may rise then. */
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

/* Whether the round ends: CONVERGED, its criterion holds; SWEEPS_SPENT, the sweeps of its level or stage
 * are spent. */
typedef enum schedule_end { SCHEDULE_GOES_ON, SCHEDULE_CONVERGED, SCHEDULE_SWEEPS_SPENT } schedule_end;

schedule_end schedule_round_end(const schedule *s, const schedule_position *at,
                                const schedule_evidence *seen);

/* Whether `gain` is to be multiplied by 10 after this sweep of the round, see schedule.patience. */
bool schedule_is_impatient(const schedule *s, const schedule_position *at, double gain);

/* Whether lists must be rebuilt. `limited`: number of particles whose step is limited by their validity;
 * `age`: in sweeps. */
bool schedule_wants_lists(const schedule *s, const schedule_position *at, size_t limited, int age);

/* The Verlet skin of the next lists, over h. That of the first lists of a level is skin_wide. */
double schedule_skin(const schedule *s, double rms_step);

/* Estimates the total number of sweeps of the level, at least 1, after `spent` sweeps. `seen`: results of the
 * last sweep; NULL: the level has not begun. */
double schedule_expected_sweeps(const schedule *s, const schedule_position *at, double spent,
                                const schedule_evidence *seen);

#endif

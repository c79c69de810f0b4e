/* schedule: how a solve proceeds. A schedule is a constant table of numbers: over-relaxation, longest steps, when a
 * stage or a level is at rest, gains, sweeps by count, when lists are built anew. The functions below answer from a
 * table and from where the solve is; they change nothing. Whoever wants another schedule adds a table.
 *
 * A solve has levels, from the coarsest packing to the finest. The coarsest level goes through all stages, of which
 * each asks for smaller gains; finer levels stay in the last stage. A round is the sweeps until the particles
 * rest. Pure functions, any thread. */
#ifndef HEXAD_SOLVER_SCHEDULE_H
#define HEXAD_SOLVER_SCHEDULE_H

#include <stdbool.h>
#include <stddef.h>

enum { SCHEDULE_STAGES = 3 };

typedef struct schedule {
    /* A round relaxes until no particle can lower its energy by more than this fraction. The first stage evens out
     * the density, so that sigma is adapted before much work is done under a wrong one. */
    double gain[SCHEDULE_STAGES];
    /* On surfaces with features below h some particles creep for ever, each sweep gaining a little more than that. A
     * round that takes longer than `patience` sweeps, and than those its level has at least, asks for ten times the gain, and
     * again after every `patience_more`. A solve that rests only with a gain above `coarsest_gain` is not converged: for that it has to
     * take so many as `patience_last` more. */
    int patience[SCHEDULE_STAGES], patience_more, patience_last;
    double coarsest_gain;

    /* Over-relaxation of the step, which the first-term Hessian makes about half of Newton's. Where `is_paced`, a level
     * begins with `omega_shake` (`omega_shake_sized` with a sizing field) and comes down to `omega` over its sweeps;
     * after these it falls with the number of sweeps, to `omega_least`. Where not, it is `omega` throughout. */
    bool is_paced;
    double omega, omega_shake, omega_shake_sized, omega_least;
    /* The longest fast step, over h. Where `is_paced` every step is allowed over the sweeps of a level, and for
     * `shake_sweeps` in the first stages; then the longest falls from this with the square of the sweeps. */
    double longest_step;
    int shake_sweeps;

    /* The least number of sweeps of a level of n particles: sweeps (sweeps_count / n)^sweeps_fall, between two bounds. */
    double sweeps, sweeps_count, sweeps_fall, sweeps_least, sweeps_most;
    /* A level of at least defects_count particles whose disordered share (particles without six neighbours) is between the two
     * bounds of defects_share after these sweeps is rough and takes more, once: defects_sweeps[0] times as many if it is refined again,
     * [1] times if it is the last level. Beyond the upper bound the surface is not resolved, and more sweeps do not help.
     * defects_share[1] is for surfaces with feature curves. A mostly creased surface is asked on its last level only. */
    double defects_count, defects_sweeps[2], defects_share[2][2];

    /* At rest. `rest_lambda` > 0: the paper's criterion for the coarsest level, that the mean log10 lambda is above it;
     * 0: rms steps alone count. A level that is refined again is left as soon as its rms step (over h) is below
     * level_step or after level_sweeps. stage_step and stage_sweeps_most do the same for the stages of a coarsest level
     * that is judged by steps; stage_step_divergent is that of the last stage of a mostly creased one, where some find no rest. On the last level finest_rest times the tolerance is a step short enough to look what is left:
     * over-relaxed sweeps step farther than particles are from their rest. */
    double finest_rest, rest_lambda, level_step, stage_step[SCHEDULE_STAGES], stage_step_divergent;
    int level_sweeps, stage_sweeps_most;
    /* A rest holds when the sizes at the particles' present places differ by less than size_settled (rms, relative)
     * from those in use; so often in a round it may be broken. */
    double size_settled;
    int resizes_most;

    /* Lists are built anew when more than this share of the particles cannot move as they would, a larger share on
     * levels that are refined again; and for a single one after so many sweeps. */
    double limited_share, limited_share_coarse;
    int limited_wait;
    /* What lists reach beyond the support, over h: wide while particles move far, then so many times the rms step, but
     * not below the narrow one. */
    double skin_wide, skin_narrow, skin_steps;

    /* A coarsest level is dropped when more than this share of its particles see round edges or through sheets; where they start, with
     * lists that reach farther, more than the other share. */
    double divergent_share, divergent_share_first;

    /* Particles that start on a finer level take so many sweeps by themselves first. */
    int new_part_sweeps;
} schedule;

extern const schedule schedule_paper;      /* the paper's criterion (section 7); any energy, any minimiser */
extern const schedule schedule_packed;     /* the same, from places that are a packing already */
extern const schedule schedule_multilevel; /* the default: fast steps, levels paced by their count */
extern const schedule schedule_continued;  /* fast steps from places near rest, as of a frame of a sequence */

/* Where a solve is. */
typedef struct schedule_position {
    int level, levels, stage;
    int sweeps;    /* in this round */
    size_t count;  /* particles of the level */
    bool is_sized; /* there is a sizing field */
    bool has_many_defects; /* the level was found so, see defects_share */
    bool has_curves;
    bool
        is_divergent; /* many of its particles see others turned from them: see relax_has_divergent_normals */
    bool is_mostly_divergent; /* half of them do, see relax_has_mostly_divergent_normals */
} schedule_position;

static inline bool schedule_is_last_stage(const schedule_position *at)
{
    return at->stage == SCHEDULE_STAGES - 1;
}

static inline bool schedule_is_last_level(const schedule_position *at)
{
    return at->level == at->levels - 1;
}

/* Sweeps that the level has at least. */
int schedule_level_sweeps(const schedule *s, const schedule_position *at);

/* Whether the level has just ended its sweeps, and would have taken more if it was rough. */
bool schedule_judges_defects(const schedule *s, const schedule_position *at);

/* Whether a level with this share of disordered particles is rough. */
bool schedule_has_many_defects(const schedule *s, const schedule_position *at, double defect_fraction);

double schedule_omega(const schedule *s, const schedule_position *at);

/* Whether a level with paced sweeps is still shaken: steps may be long, and energies may rise. */
bool schedule_is_shaken(const schedule *s, const schedule_position *at);

/* The longest fast step, over h; may be INFINITY. */
double schedule_longest_step(const schedule *s, const schedule_position *at);

/* What a sweep has shown. */
typedef struct schedule_evidence {
    double rms_step;          /* over h */
    double mean_log10_lambda; /* read where has_lambda */
    bool has_lambda;          /* false for the gradient minimiser */
    double step_tolerance;    /* of the rms step, that the job asks for */
} schedule_evidence;

/* Whether the round ends, and why: its criterion of convergence holds, or the sweeps of its level or stage are spent. */
typedef enum schedule_end { SCHEDULE_GOES_ON, SCHEDULE_CONVERGED, SCHEDULE_SWEEPS_SPENT } schedule_end;

schedule_end schedule_round_end(const schedule *s, const schedule_position *at,
                                const schedule_evidence *seen);

/* Whether the round has taken so long that it is to ask for ten times `gain`; true once each time. */
bool schedule_is_impatient(const schedule *s, const schedule_position *at, double gain);

/* Whether lists are to be built anew, with `limited` particles held back by lists that are `age` sweeps old. */
bool schedule_wants_lists(const schedule *s, const schedule_position *at, size_t limited, int age);

/* The Verlet skin of the next lists, over h. That of the first lists of a level is skin_wide. */
double schedule_skin(const schedule *s, double rms_step);

/* An estimate of the sweeps that the level takes in all, at least 1, from its `spent` sweeps so far and the last evidence; without
 * evidence, NULL, of a level that has not begun. */
double schedule_expected_sweeps(const schedule *s, const schedule_position *at, double spent,
                                const schedule_evidence *seen);

#endif

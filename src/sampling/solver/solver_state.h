// SPDX-License-Identifier: Apache-2.0
/* solver_state: the state of a solve, and functions on it that several files of the solver use.
 *
 * Private to the solver. driver.c decides what is done and when. level.h, adaptation.h and passes/passes.h
 * declare what it calls; those functions act once and decide nothing about the order of a solve. */
#ifndef HEXAD_SAMPLING_SOLVER_SOLVER_STATE_H
#define HEXAD_SAMPLING_SOLVER_SOLVER_STATE_H

#include "sampling/solver/level_plan.h"
#include "sampling/solver/particles/particles.h"
#include "sampling/solver/passes/refine.h"
#include "sampling/solver/passes/relax.h"
#include "sampling/solver/regime.h"
#include "sampling/solver/solver.h"

/* solver_round.ended of a round that max_sweeps interrupted. */
#define ROUND_AT_MAX_SWEEPS "max_sweeps"

enum {
    SOLVER_MAX_ROUNDS = 40, /* rounds that end with an action of global control */
    /* maximum number of rounds after the first projection. Reasons: particles were relocated, or
     * relax_rms_steps_left exceeds the tolerance. Also the maximum number of times that converged particles
     * of a round go on because their sizes have changed */
    SOLVER_CONTINUATIONS_MOST = 5
};

/* The next action of a solve; the values are in the order of a solve. */
typedef enum solver_action {
    ACTION_SWEEP, /* moves every particle once */
    /* after a round: the next level, another support or count, or the end of the relaxation */
    ACTION_CONTROL,
    ACTION_REPAIR,  /* after convergence: repairs defects, then equalises the areas of Voronoi cells */
    ACTION_PROJECT, /* projects onto the surface to rounding; relocates lost particles and fills gaps */
    ACTION_VERIFY   /* tests whether the projected points have converged */
} solver_action;

/* The functions in which the methods (Meyer 2005, Witkin and Heckbert 1994, blue noise) differ. */
typedef struct solver_method {
    bool (*begin)(solver *s, error *e);    /* after the particles are placed */
    bool (*step)(solver *s, error *e);     /* see solver_step */
    bool (*describe)(solver *s, error *e); /* adds to record.out what is specific to the method */
    void (*release)(solver *s);            /* called also if the solve was not begun */
} solver_method;

extern const solver_method solver_meyer;           /* driver.c */
extern const solver_method solver_witkin_heckbert; /* witkin_heckbert_solver.c */
extern const solver_method solver_blue_noise;      /* blue_noise.c */

/* Constant throughout a solve. */
typedef struct solver_setup {
    const solver_method *method;
    const field *field;
    const surface *scan;
    threads *pool;
    solver_params params;
    const fast_kernel *fast; /* NULL: the regime does not use it */
} solver_setup;

typedef struct solver_state {
    const regime *regime;
    solver_action next;
    solver_outcome outcome;

    particles *p;
    double spacing; /* h of the level */
    double sigma;   /* support of particles of size 1 */

    level_plan plan;
    int level;
    bool counts_corrected; /* the plan was corrected by the edges of the coarsest packing */
    bool has_many_defects; /* the level takes extra sweeps, see schedule_has_many_defects */
    /* on patches: an earlier round of the level took extra sweeps, so that later ones do not */
    bool had_extra_sweeps;
    double defect_fraction;   /* last computed defect fraction; 0: never computed */
    size_t level_first_sweep; /* number of sweeps before the level */

    const char *round_cause, *round_ended; /* words of solver_round */
    double round_defect_fraction;          /* member of solver_round */
    int control_rounds;                    /* rounds that ended with ACTION_CONTROL and were not continued */
    int stage;                             /* stage of the schedule */
    /* minimum relative decrease of a particle's energy: that of the stage, multiplied by powers of 10 after
     * too many sweeps (schedule.patience) */
    double gain;
    int sweeps_in_round; /* for the schedule; a continued round does not restart the count */
    int size_renewals;   /* number of times in this round that convergence failed because sizes had changed */

    double skin; /* Verlet skin of the next lists: their reach beyond the support */
    bool lists_stale;
    int list_age;           /* sweeps since the lists were built */
    size_t next_amplitudes; /* the sweep before which amplitudes are renewed */

    int repairs;        /* passes of defect repair */
    int equalisations;  /* passes of solver_equalise_cells */
    int continuations;  /* see SOLVER_CONTINUATIONS_MOST */
    double last_energy; /* mean energy of the previous round of the last stage; 0: there was none */
    bool is_on_target;  /* the particles had the ideal energy when they had last converged */
    bool is_projected;  /* no particle has moved since solver_project */
    bool is_tightened;  /* step_left was too large after projection: convergence requires a smaller one */

    double fraction, updates;                      /* progress; updates of particles so far */
    struct witkin_heckbert_state *witkin_heckbert; /* state of solver_witkin_heckbert */
    struct blue_noise_state *blue_noise;           /* state of solver_blue_noise */
} solver_state;

/* Working memory. */
typedef struct solver_scratch {
    relax *relax;      /* NULL after solver_describe */
    size_t capacity;   /* capacity of state.p and relax */
    refine_mesh *mesh; /* mesh of the coarsest level, from the count of its edges until it is refined */
    double *worst;     /* during projection, per THREADS_GRAIN particles: the largest |F| / |grad F| over h */
    bool *lost;        /* during projection, per particle: it is not on the surface */
} solver_scratch;

/* Results. */
typedef struct solver_record {
    solver_sweep *sweep;
    size_t sweep_count;
    solver_round *round;
    size_t round_count, swept; /* swept: sweeps in the recorded rounds */
    size_t removed;            /* see solver_removed_offsurface */
    solver_points out;
    bool *replaced;   /* per particle, set by solver_project: it was relocated */
    uint32_t *point;  /* with patches, per particle: its point, see solver_patch_points */
    uint8_t *flags;   /* with patches, per particle: flags of sampling/packing/point_flags.h */
    vec3 *normal;     /* per point */
    uint8_t *feature; /* per point */
    double *column;   /* see solver_column */
} solver_record;

struct solver {
    solver_setup setup;
    solver_state state;
    solver_scratch scratch;
    solver_record record;
};

/* ---- solver_state.c */

/* Columns of record.column, with a value for each particle. The last one exists only if curvature is taken
 * over a distance. */
enum {
    COLUMN_KAPPA,
    COLUMN_KAPPA1,
    COLUMN_KAPPA2,
    COLUMN_SPACING,
    COLUMN_ENERGY,
    COLUMN_KAPPA_SCALE,
    COLUMNS
};

static inline double *solver_column(const solver *s, int which)
{
    return s->record.column + (size_t)which * s->state.p->count;
}

/* A relaxation of `capacity` particles. Error: limit_memory. */
relax *solver_new_relax(const solver *s, size_t capacity, error *e);

/* Increases the capacity of the particles and of the relaxation; the lists must be rebuilt then. Error:
 * limit_memory, also above params.count_limit. */
bool solver_reserve(solver *s, size_t capacity, error *e);

/* Whether the particles started at given positions, such as those of the previous frame. */
bool solver_is_continued(const solver *s);

/* Whether near curve samples were merged (surface/field/patches.h), as on meshes. */
bool solver_merges_near_curves(const solver *s);

/* Particle i was relocated: convergence requires that it and its neighbours converge (relax_mark_displaced).
 * Does nothing on patches whose near curves are not merged, such as interfaces of labels: on small patches a
 * relocated particle is pushed out of its patch and relocated again and again, so that the solve would not
 * converge. */
void solver_mark_displaced(solver *s, size_t i);

/* The number of points: copies of a point for several patches count once. */
size_t solver_point_count(const solver *s);

/* Whether F is so smooth that a projection may omit the check of its last Newton step. Then description.c
 * computes the residuals and the normals, together with the curvatures. */
bool solver_ends_smoothly(const solver *s);

/* ---- lagged.c: sizes, amplitudes and lists, constant between two renewals */

/* The amplitude (14) at a place x of the surface, or of a patch with the field f. `normal`: unit.
 * False, *alpha unchanged: F has no curvature there. */
bool solver_amplitude_at(const solver *s, const field *f, uint32_t patch, vec3 x, vec3 normal, double *alpha);

/* Compute the amplitudes, or sizes, at the present positions. Return the rms of their relative change; 0
 * if the solve has none. */
double solver_renew_amplitudes(solver *s);
double solver_renew_sizes(solver *s);

/* Whether amplitudes have to be renewed before the next sweep. */
bool solver_amplitudes_are_due(const solver *s);

/* Computes the requested spacing of each particle from its present size. `out`: one value for each
 * particle. */
void solver_spacings(const solver *s, double *out);

/* Whether a mean energy over mean alpha is the ideal one within energy_tolerance. */
bool solver_is_on_target(const solver *s, double energy);

/* Renews the amplitudes if they are due, and the sizes; marks particles near boundaries; builds lists for the
 * present support and skin. Error: limit_memory. */
bool solver_build_lists(solver *s, error *e);

/* Makes lists that are valid for energies at the present positions, not for sweeps. Error: limit_memory. */
bool solver_refresh_lists(solver *s, error *e);

/* The Newton steps that are left at the present positions, see relax_rms_steps_left. The second function
 * renews sizes and lists first, for use after solver_project. NAN with the Gaussian energy. Error:
 * limit_memory. */
relax_steps solver_steps_left(const solver *s, bool watch);
bool solver_steps_after_projection(solver *s, relax_steps *left, error *e);

/* ---- driver.c */

/* Records the sweeps since the last recorded round as a round. */
void solver_note_round(solver *s, const char *ended, double energy, double gain);

/* ---- description.c */

/* Computes record.out. Errors: limit_memory, cancelled. */
bool solver_describe(solver *s, error *e);

/* Frees the arrays of record.out. */
void solver_release_description(solver *s);

#endif

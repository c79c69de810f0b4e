/* sampler_internal: what a sampler is made of. Private to sampler.c, which runs it, control.c, which acts between
 * rounds, finalize.c, which ends it, and swarm.c, which is the other method. */
#ifndef HEXAD_SAMPLER_SAMPLER_INTERNAL_H
#define HEXAD_SAMPLER_SAMPLER_INTERNAL_H

#include "sampler/levels.h"
#include "particles/particles.h"
#include "particles/refine.h"
#include "particles/relax.h"
#include "sampler/sampler.h"
#include "sampler/schedule.h"

enum { SAMPLER_MAX_ROUNDS = 40 };

/* A way to solve: what differs between the method of 2005 and that of 1994. */
typedef struct sampler_method {
    bool (*begin)(sampler *s, error *e);    /* the particles are placed */
    bool (*step)(sampler *s, error *e);     /* see sampler_step */
    bool (*describe)(sampler *s, error *e); /* the particles are final: completes record.out */
    void (*release)(sampler *s);            /* of what was begun, or was not */
} sampler_method;

extern const sampler_method sampler_meyer;           /* sampler.c */
extern const sampler_method sampler_witkin_heckbert; /* swarm.c */

/* What a solve is given and never changes. */
typedef struct sampler_setup {
    const sampler_method *method;
    const field *field;
    const surface *scan;
    threads *pool;
    sampler_params params;
    const schedule *schedule;
    const fast_kernel *fast; /* of relax; NULL: the energy, amplitudes or minimiser need the general way */
} sampler_setup;

/* How often a solve that has ended goes on, at most. */
enum { SAMPLER_RECALLS = 5 };

/* Where it is. */
typedef struct sampler_state {
    particles *p;
    double spacing; /* h */
    double sigma;
    double skin;
    levels plan;
    int level;
    bool is_rough;           /* the level was found to be, see schedule_is_rough */
    double disordered_share; /* when that was asked the last time */
    bool calmed;             /* a round of the level with curves has ended: what is rough had its sweeps */
    bool planned;            /* its counts were corrected by what the coarsest packing showed */
    int stage;               /* of the schedule */
    double gain;             /* in force: that of the stage, or more when it does not come to rest */
    bool lists_stale;
    int list_age;           /* sweeps since they were built */
    size_t next_amplitudes; /* the sweep before which they are renewed */
    int sweeps_in_round;
    int resizes;   /* in the round: rests that new sizes ended */
    int recalls;   /* ends that particles on new places ended */
    int mends;     /* passes of sampler_mend */
    int evened;    /* how often, by sampler_even_out */
    bool loosened; /* a solve from given points has gone on with long steps */
    bool settled;  /* no particle has moved since sampler_settle */
    bool pressed;  /* points have come to rest, but as they would be delivered they do not */
    bool coarse;   /* the spacing resolves nothing of the surface: pairs count whatever their normals */
    double fraction;
    double updates;     /* of particles so far, for the fraction */
    size_t level_began; /* sweeps before those of the level at hand */
    sampler_outcome outcome;
    struct swarm *swarm; /* of sampler_witkin_heckbert */
} sampler_state;

/* What it works with; nothing here outlives a solve. */
typedef struct sampler_scratch {
    relax *relax;      /* NULL once energies are known */
    size_t capacity;   /* of state.p and relax */
    refine_mesh *mesh; /* of the coarsest level, from when its edges are counted until it is refined */
    double
        *worst; /* while the particles are finalized: the largest |F| / |grad F| over h of a chunk of them */
    bool *lost; /* likewise: it is not on the surface, and has no residual */
} sampler_scratch;

/* What it has come to. */
typedef struct sampler_record {
    sampler_sweep *sweep;
    size_t sweep_count;
    sampler_round round[SAMPLER_MAX_ROUNDS];
    size_t round_count;
    size_t removed; /* particles put on a new place */
    sampler_points out;
    bool *replaced;   /* of each particle, from sampler_settle on */
    uint32_t *point;  /* of each particle of a surface with patches, which point it is; see sampler_stands */
    uint8_t *flags;   /* likewise */
    vec3 *normal;     /* of each point */
    uint8_t *feature; /* likewise */
    double *column;   /* sampler_column tells where each begins */
} sampler_record;

struct sampler {
    sampler_setup setup;
    sampler_state state;
    sampler_scratch scratch;
    sampler_record record;
};

/* What is described of each particle; the last only where curvature is over a distance. */
enum {
    COLUMN_KAPPA,
    COLUMN_KAPPA1,
    COLUMN_KAPPA2,
    COLUMN_SPACING,
    COLUMN_ENERGY,
    COLUMN_KAPPA_SCALE,
    COLUMNS
};

static inline double *sampler_column(const sampler *s, int which)
{
    return s->record.column + (size_t)which * s->state.p->count;
}

/* (14) at a place of the surface, or of a patch whose field is f, with its normal. False, *alpha untouched, where the field has no curvature. */
bool sampler_amplitude_at(const sampler *s, const field *f, uint32_t patch, vec3 x, vec3 normal,
                          double *alpha);

/* Amplitudes of the particles where they are; returns the rms of their relative change. */
double sampler_renew_amplitudes(sampler *s);

/* Sizes of the particles where they are; returns the rms of their relative change. */
double sampler_resize(sampler *s);

/* The spacing of each particle, by its size as it is: room for all of them. */
void sampler_tell_spacings(const sampler *s, double *out);

/* What moves so many particles. The fast kernel knows no amplitudes, and is left once cells are evened out. Error: limit_memory. */
relax *sampler_new_relax(const sampler *s, size_t capacity, error *e);

/* Whether a mean energy over mean alpha is the ideal one, within the tolerance asked for. */
bool sampler_is_on_target(const sampler *s, double energy);

/* Whether the start is given by the caller, as of a frame that follows another. */
bool sampler_is_given(const sampler *s);

/* Puts particles on the coarsest level, where they start; `support` is over the spacing. Errors: limit_memory,
 * no_surface. */
bool sampler_begin(sampler *s, double support, error *e);

/* Whether the amplitudes have to be renewed before the next sweep. */
bool sampler_amplitudes_are_due(const sampler *s);

/* From the level at hand to the next, without relaxing it. Errors: limit_memory, no_surface. */
bool sampler_refine(sampler *s, error *e);

/* Amplitudes, if they are due, boundaries, and lists for the support at hand. Error: limit_memory. */
bool sampler_build_lists(sampler *s, error *e);

/* The coarsest packing shows, after its first round, whether it resolves the surface at all, and after each
 * later one how many particles its refinement will give. When another count would have been better it begins
 * again with that, *again; unless it is mostly creased (relax_is_mostly_creased). Errors: limit_memory, no_surface. */
bool sampler_replan(sampler *s, bool *again, error *e);

/* Room for `capacity` particles, in whatever holds one entry for each; lists are to be built anew. Error:
 * limit_memory, also when the count is beyond params.count_limit. */
bool sampler_reserve(sampler *s, size_t capacity, error *e);

/* Of the particles where they are, see sampler_points. */
relax_steps sampler_steps_left(const sampler *s, bool watch);

/* Whether near curve samples were merged (field/patches.h), as on meshes. */
bool sampler_merges_rows(const sampler *s);

/* Particle i is put elsewhere, and is to come to rest itself (relax_stir). Not on small patches, as of labels: they push points out
 * again and again, and there is no such rest. */
void sampler_stir(sampler *s, size_t i);

/* What is left of the particles as sampler_settle has put them, which sweeps may not have seen. Error: limit_memory. */
bool sampler_steps_settled(sampler *s, relax_steps *left, error *e);

/* The last round of a solve that has ended goes on: particles are in other places. Always true, for callers that return
 * it. */
bool sampler_go_on(sampler *s);

/* Frees what sampler_finalize has made of the particles. */
void sampler_take_back(sampler *s);

/* How many points the particles are: those on a curve count once for all patches there. */
size_t sampler_point_count(const sampler *s);

/* Takes disorder out of particles at rest by local changes, within what the count allows; *changed: they have to come to rest
 * again. Same result for any number of threads. Errors: limit_memory, cancelled. */
bool sampler_mend(sampler *s, bool *changed, error *e);

/* Of particles that were mended: amplitudes under which their cells become as large as they are to be, in a few steps. *changed:
 * there was one, and they have to come to rest again. Errors: limit_memory. */
bool sampler_even_out(sampler *s, bool *changed, error *e);

/* *x near the zero set of f onto it to rounding, no farther than `farthest`; `h` is the scale of what is meant by rounding. False,
 * outputs untouched, when it has no way there. */
bool sampler_land(const field *f, double h, double farthest, vec3 *x, vec3 *normal);

/* Whether particles that are nearly at rest, with lists of about where they are, will be a coarse answer: state.coarse. From
 * then on pairs count whatever their normals. Error: limit_memory. */
bool sampler_judge_coarse(sampler *s, error *e);

/* Particles that crowd go to bare places (relocation.h), and all are settled again. Error: limit_memory. */
bool sampler_relocate(sampler *s, error *e);

/* Of a surface with patches: places farther than the spacing from all points get one of those that crowd, of whatever patch,
 * which becomes one of theirs; of a surface of many parts, where none of these goes, one of those that have another nearest. *changed is
 * set where there are such, and unchanged else. Error: limit_memory. */
bool sampler_cover_patches(sampler *s, bool *changed, error *e);

/* The same of a surface without patches, where the last level begins, or the only one is near its rest: parts that have no point get
 * some, though their share of the coarser levels' was less than one. Lists are stale where there are such. Error: limit_memory. */
bool sampler_cover_parts(sampler *s, error *e);

/* Every particle onto the surface to rounding, or onto a new place there, which adds to record.removed. Errors:
 * limit_memory, cancelled. */
bool sampler_settle(sampler *s, error *e);

/* A round has come to rest: adapts the support and looks closer, refines, or ends. Errors: limit_memory,
 * no_surface. */
bool sampler_control(sampler *s, error *e);

#endif

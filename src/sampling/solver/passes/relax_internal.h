// SPDX-License-Identifier: Apache-2.0
/* relax_internal: shared declarations of the relaxation. Files: relax.c the sweep, relax_lists.c neighbour
 * lists, relax_damped.c damped steps in double precision, relax_fast.c fast steps, relax_guarded.c guarded
 * steps in SIMD lanes, relax_measures.c measures of particles that do not move. A guarded step is taken
 * only if the energy decreases; a fast step is taken without an energy test. */
#ifndef HEXAD_SAMPLING_SOLVER_PASSES_RELAX_INTERNAL_H
#define HEXAD_SAMPLING_SOLVER_PASSES_RELAX_INTERNAL_H

#include "base/core/isa.h"
#include "sampling/packing/neighbours.h"
#include "sampling/packing/pair.h"
#include "sampling/solver/passes/relax.h"

/* Cosine of divergent normals (60 degrees). If the normals of a pair diverge by less when the lists are
 * built, its weight stays 1 while they are valid: weights fall from 120 degrees on (sampling/packing/pair.h),
 * so that both normals would have to turn by 30 degrees within skin / 2. */
#define RELAX_FLAT_COSINE 0.5
/* The same on patches with the fast kernel (90 degrees). On rough meshes many neighbours' normals diverge by more
 * than 60 degrees, and a damped step takes five times as long as a fast one. Down to -0.3, hex_fraction is the
 * same, but near folds more rounds are repeated. */
#define RELAX_FLAT_COSINE_OF_PATCHES 0.0
/* Cosine of normals without an edge between them (37 degrees). Normals at an edge diverge by at least 45
 * degrees. */
#define RELAX_SMOOTH_COSINE 0.8

/* Whether two particles are nearer to each other than `reach` times the mean of their sizes. */
static inline bool relax_are_within(const particles *p, size_t i, size_t j, double reach)
{
    const double most = 0.5 * reach * (particles_size(p, i) + particles_size(p, j));
    return vec3_norm2(vec3_sub(p->position[i], p->position[j])) < most * most;
}

/* Gathered neighbours of one particle. */
typedef struct gather {
    double *memory;
    pair_list list;
} gather;

/* Sums over the particles of a group of blocks, stored at the first block of the group; other entries are 0.
 * They are added in the order of the blocks, so that the result does not depend on the number of threads. */
typedef struct block_sums {
    double energy, lambda, squares, max_step, displaced_squares;
    size_t rejected, limited, displaced_limited;
} block_sums;

/* Cached results of relax_rms_steps_left. */
typedef struct cached_steps {
    double sigma, spacing; /* arguments; 0: nothing is cached */
    relax_steps left;
    bool energies; /* p->energy is that of all particles */
    double pairs;  /* if so: number of neighbours within the support, sum over the particles */
} cached_steps;

/* Flags of a particle. */
enum {
    /* It takes guarded steps only, because its Newton step was long. Facets and features below the spacing
     * have kinks; the Newton step of a particle converged on a kink remains long. */
    RELAX_GUARDED = 1,
    RELAX_DISPLACED = 2, /* relax_mark_displaced; never set for fixed particles */
    RELAX_RELOCATED = 4  /* it was relocated: the next list build marks its neighbours as displaced */
};

/* Determines whether a sweep skips a particle. */
typedef struct skip_state {
    float step;      /* its last step over its size */
    float around;    /* sum of the path lengths of its neighbours at that step */
    float energy;    /* at that step */
    bool is_skipped; /* in this sweep */
} skip_state;

struct relax {
    threads *pool;
    const energy_function *energy;
    const fast_kernel *fast; /* NULL: every particle takes damped steps */
    neighbours *near;
    /* 0: divergent neighbour normals (RELAX_FLAT_COSINE); 2: no edge near (RELAX_SMOOTH_COSINE); 1:
     * between */
    uint8_t *flat;
    uint8_t *flags;
    size_t flag_count; /* number of particles with flags */
    size_t displaced_count, relocated_count;
    float *moved;         /* path length of a particle since the list build */
    skip_state *skipping; /* NULL: no particle is skipped */
    bool skip_known;      /* `skipping` holds for the current lists */
    block_sums *parts;    /* of the sweep */
    size_t part_capacity;
    double sigma, skin;   /* of the lists */
    bool ignores_normals; /* relax_ignore_normals */
    cached_steps cached;
    bool guards_in_lanes;  /* guarded steps are taken in SIMD lanes */
    bool uses_normals;     /* the kernel uses the normals of all particles in sweeps */
    bool mostly_divergent; /* if so: at least half of the particles have divergent neighbour normals */
    bool has_amplitudes;   /* amplitudes differ from 1, and the fast kernel is used */
    /* with uses_normals or has_amplitudes: factors for the kernel, set by relax_copy_factors. Sweeps update
     * the normals if uses_normals is set. */
    fast_kernel_factors *factors;
    gather *scratch; /* per worker thread */
    size_t scratch_entries;
};

typedef struct sweep_job {
    relax *r;
    particles *p;
    const relax_params *params;
    int colour;
    skip_state *skipping; /* NULL: no particle is skipped */
    double sigma;
} sweep_job;

/* The weighted neighbours of particle i. */
pair_list *relax_gather_list(const relax *r, const particles *p, int worker, size_t i);

/* Moves particle i by a damped step in double precision, if one decreases its energy. */
void relax_update_particle(const sweep_job *job, int worker, size_t i, block_sums *sums);

/* Moves a set of independent particles by the fast kernel. `has_divergent`: some have divergent neighbour
 * normals; pairs have facing weights, which do not turn with the step. Particles whose step fails do not move:
 * `items` receives them. Returns their number. */
size_t relax_fast_step(const sweep_job *job, uint32_t *items, size_t count, bool has_divergent,
                       block_sums *sums);

/* (11)(12) in the tangent frame: the step along the two axes. Returns the decrease of energy by the
 * quadratic model. */
double relax_damped_step(const pair_forces *f, double lambda, double *s1, double *s2);

/* Fills the lanes of the kernel with particles. Unused lanes repeat the first particle with an empty list. */
void relax_fill_lanes(const relax *r, const particles *p, const uint32_t *items, size_t count,
                      fast_kernel_particles *out);

/* Adds the energy of particle i before its step. */
static inline void relax_add_energy(const sweep_job *job, size_t i, double energy, block_sums *sums)
{
    sums->energy += energy;
    if (job->skipping) job->skipping[i].energy = (float)energy;
}

static inline fast_kernel_factors relax_factors(const particles *p, size_t i)
{
    return (fast_kernel_factors){(float)p->normal[i].x, (float)p->normal[i].y, (float)p->normal[i].z,
                                 (float)particles_amplitude(p, i)};
}

/* Copies the normals and amplitudes of all particles for the kernel, if it uses them. */
void relax_copy_factors(relax *r, const particles *p);

/* Copies the factors of particle i after it has moved, if the kernel uses normals. */
static inline void relax_copy_normal(relax *r, const particles *p, size_t i)
{
    if (r->uses_normals) r->factors[i] = relax_factors(p, i);
}

/* Distance that particle i may move while the lists remain valid. */
double relax_allowed_step(const relax *r, const particles *p, size_t i);

/* Counts particle i, whose step is limited by the validity of the lists. */
static inline void relax_count_limited(const sweep_job *job, size_t i, block_sums *sums)
{
    sums->limited++;
    sums->displaced_limited += (job->r->flags[i] & RELAX_DISPLACED) != 0;
}

/* A step of at least this fraction of the allowed distance counts as limited: too little remains for the
 * next step. */
#define RELAX_LIMITED_STEP 0.8

/* Moves particle i to x; `length`, at most allowed_step, is the distance. */
ISA_INLINE void relax_take_step(const sweep_job *job, size_t i, vec3 x, vec3 normal, double length,
                                double allowed_step, block_sums *sums)
{
    particles *p = job->p;
    double step = length / particles_size(p, i);
    sums->squares += step * step;
    sums->max_step = step > sums->max_step ? step : sums->max_step;
    if (job->r->flags[i] & RELAX_DISPLACED) sums->displaced_squares += step * step;
    if (length >= RELAX_LIMITED_STEP * allowed_step) relax_count_limited(job, i, sums);
    job->r->moved[i] += (float)length;
    if (job->skipping) job->skipping[i].step = (float)step;
    p->position[i] = x;
    p->normal[i] = normal;
    relax_copy_normal(job->r, p, i);
    neighbours_move(job->r->near, i, x);
}

/* If a trial is nearer to the surface than this, over h, its projection takes one more Newton step without
 * a check. */
#define RELAX_TRIAL_SHORTCUT 0.02
/* A particle whose lists allow a step of less than this over h waits for the next list build. */
#define RELAX_STEP_FLOOR 1e-3
/* Minimum log10 of the damping; smaller damping has no effect. */
#define RELAX_LAMBDA_FLOOR (-3.0)

/* Fast steps of the lanes `first` .. `count` - 1 with given forces. stays[l]: the step of lane l failed;
 * it has not moved. */
void relax_fast_steps(const sweep_job *job, const uint32_t *items, size_t first, size_t count,
                      const fast_kernel_particles *own, const fast_kernel_forces *forces,
                      bool stays[FAST_KERNEL_LANES], block_sums *sums);

/* Steps of a set of independent particles away from boundaries, on a surface without patches, in SIMD lanes
 * in single precision. The first `divergent` particles have divergent neighbour normals and take guarded
 * steps (section 5). The others take fast steps; if a fast step fails, a guarded step. */
void relax_guarded_steps(const sweep_job *job, const uint32_t *items, size_t divergent, size_t count,
                         block_sums *sums);

#endif

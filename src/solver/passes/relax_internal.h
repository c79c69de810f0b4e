/* relax_internal: what a relaxation is made of. relax_lists.c has its lists, relax_damped.c and relax_fast.c the two kinds of steps,
 * relax_guarded.c guarded steps in lanes, relax.c the sweep, and relax_measures.c what is computed of particles at rest. */
#ifndef HEXAD_SOLVER_RELAX_INTERNAL_H
#define HEXAD_SOLVER_RELAX_INTERNAL_H

#include "base/isa.h"
#include "packing/neighbours.h"
#include "packing/pair.h"
#include "solver/passes/relax.h"

/* Where all normals agree to within 60 degrees the weights are 1, and are taken to stay so while the lists
 * are valid; it would take a turn of 30 degrees within skin / 2 to make that untrue. */
#define RELAX_FLAT_COSINE 0.5
/* Where normals within the support agree to 37 degrees there is no edge: across one they part by 45 at least. */
#define RELAX_SMOOTH_COSINE 0.8

/* Whether two particles are nearer to each other than `reach` times the mean of their sizes. */
static inline bool relax_are_within(const particles *p, size_t i, size_t j, double reach)
{
    const double most = 0.5 * reach * (particles_size(p, i) + particles_size(p, j));
    return vec3_norm2(vec3_sub(p->position[i], p->position[j])) < most * most;
}

/* One particle's neighbours, gathered. */
typedef struct gather {
    double *memory;
    pair_list list;
} gather;

/* Sums over the particles of a few blocks, stored at the first of them; the entries of the others are 0. They are
 * added up in the order of the blocks, so that the number of threads does not show. */
typedef struct block_sums {
    double energy, lambda, squares, max_step, displaced_squares;
    size_t rejected, limited, displaced_limited;
} block_sums;

/* What relax_rms_steps_left has found of the particles where they are. */
typedef struct known_steps {
    double sigma, spacing; /* 0: nothing, or they have moved since */
    relax_steps left;
    bool energies; /* they have that of each, too */
    double pairs;  /* and so many others are within the support of one, in all */
} known_steps;

/* What is noted of a particle. */
enum {
    /* It had a long way left, and takes no step without a look at the energy from then on. Facets and surfaces below the
     * spacing have kinks, and a particle that rests on one has its Newton step left for ever. */
    RELAX_WATCHED = 1,
    RELAX_DISPLACED = 2, /* see relax_mark_displaced; never of fixed particles */
    RELAX_RELOCATED = 4  /* it was relocated: its neighbours are marked displaced when lists are built */
};

/* Decides whether a sweep skips a particle. */
typedef struct skip_state {
    float step;      /* its last, over its size */
    float around;    /* the sum of its neighbours' ways then */
    float energy;    /* then */
    bool is_skipped; /* in this sweep */
} skip_state;

struct relax {
    threads *pool;
    const energy_function *energy;
    const fast_kernel *fast; /* NULL: every particle goes the general way */
    neighbours *near;
    uint8_t *flat; /* 1: all of a particle's neighbours face its way, clearly; 2: and no sharp edge is near */
    uint8_t *notes;
    size_t noted_count; /* of the particles that these are about */
    size_t displaced_count, relocated_count;
    float *moved;         /* length of a particle's way since the lists were built */
    skip_state *skipping; /* NULL: no particle is ever skipped */
    bool skip_known;      /* for the present lists */
    block_sums *parts;    /* of the sweep */
    size_t part_capacity;
    double sigma, skin;   /* of the lists */
    bool ignores_normals; /* pairs count whatever their normals */
    known_steps seen;
    bool guards_in_lanes;  /* guarded steps are taken side by side */
    bool mostly_divergent; /* and more than half of the particles take such */
    /* Of a guards_in_lanes surface the normals once more, for the kernel; up to date in a sweep, and after relax_note_normals. */
    fast_kernel_normal *normal;
    gather *scratch; /* one per worker */
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

/* The neighbours of particle i, with the weights that they have for it. */
pair_list *relax_gather_list(const relax *r, const particles *p, int worker, size_t i);

/* Moves particle i in the general way, or leaves it where no step makes its energy less. */
void relax_update_particle(const sweep_job *job, int worker, size_t i, block_sums *sums);

/* Moves a set of independent particles without divergent neighbour normals by the fast kernel. Particles whose step does not end well
 * stay where they are: `items` receives them. Returns their number. */
size_t relax_fast_step(const sweep_job *job, uint32_t *items, size_t count, block_sums *sums);

/* (11)(12) in the tangent frame: the step along the two axes, and the decrease of energy that the quadratic model expects of
 * it. */
double relax_damped_step(const pair_forces *f, double lambda, double *s1, double *s2);

/* Particles side by side for the kernel. What is left over of the lanes repeats the first, with an empty list. */
void relax_fill_lanes(const relax *r, const particles *p, const uint32_t *items, size_t count,
                      fast_kernel_particles *out);

/* Counts the energy that particle i has as its turn comes. */
static inline void relax_note_energy(const sweep_job *job, size_t i, double energy, block_sums *sums)
{
    sums->energy += energy;
    if (job->skipping) job->skipping[i].energy = (float)energy;
}

/* Notes the normals of all, where pairs are weighed by them side by side. */
void relax_note_normals(relax *r, const particles *p);

static inline void relax_note_normal(relax *r, const particles *p, size_t i)
{
    if (!r->guards_in_lanes) return;
    r->normal[i] =
        (fast_kernel_normal){(float)p->normal[i].x, (float)p->normal[i].y, (float)p->normal[i].z, 0};
}

/* How far particle i may still go while the lists stay valid. */
double relax_allowed_step(const relax *r, const particles *p, size_t i);

/* Counts particle i, which waits for new lists. */
static inline void relax_count_limited(const sweep_job *job, size_t i, block_sums *sums)
{
    sums->limited++;
    sums->displaced_limited += (job->r->notes[i] & RELAX_DISPLACED) != 0;
}

/* A step that used this share of what the lists allow leaves too little for the next. */
#define RELAX_LIMITED_STEP 0.8

/* A particle that goes to x, `length` away, which is no farther than it is allowed. */
ISA_INLINE void relax_take_step(const sweep_job *job, size_t i, vec3 x, vec3 normal, double length,
                                double allowed_step, block_sums *sums)
{
    particles *p = job->p;
    double step = length / particles_size(p, i);
    sums->squares += step * step;
    sums->max_step = step > sums->max_step ? step : sums->max_step;
    if (job->r->notes[i] & RELAX_DISPLACED) sums->displaced_squares += step * step;
    if (length >= RELAX_LIMITED_STEP * allowed_step) relax_count_limited(job, i, sums);
    job->r->moved[i] += (float)length;
    if (job->skipping) job->skipping[i].step = (float)step;
    p->position[i] = x;
    p->normal[i] = normal;
    relax_note_normal(job->r, p, i);
    neighbours_move(job->r->near, i, x);
}

/* Of h: a Newton step from there is the last of a trial's. A particle whose lists allow less than the second waits for new
 * ones. */
#define RELAX_TRIAL_SHORTCUT 0.02
#define RELAX_STEP_FLOOR 1e-3
#define RELAX_LAMBDA_FLOOR (-3.0) /* log10; below it the damping is nothing */

/* Fast steps of the lanes from `first` up to `count`, whose forces are known. Who stays, since its step would not end well, is
 * told. */
void relax_fast_steps(const sweep_job *job, const uint32_t *items, size_t first, size_t count,
                      const fast_kernel_particles *own, const fast_kernel_forces *forces,
                      bool stays[FAST_KERNEL_LANES], block_sums *sums);

/* Steps of a set of independent particles that are away from boundaries, of a surface without patches: fast ones of those after the
 * first `divergent`, whose neighbours all face their way, and guarded ones (section 5) of the others and of whose step would not end
 * well, side by side, in single precision. */
void relax_guarded_steps(const sweep_job *job, const uint32_t *items, size_t divergent, size_t count,
                         block_sums *sums);

#endif

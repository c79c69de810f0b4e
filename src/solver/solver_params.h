/* solver_params: what a solver is asked for. */
#ifndef HEXAD_SOLVER_SOLVER_PARAMS_H
#define HEXAD_SOLVER_SOLVER_PARAMS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/isa.h"
#include "packing/energy.h"
#include "solver/witkin_heckbert.h"
#include "sizing/scaled_curvature.h"
#include "sizing/sizing_field.h"

typedef enum solver_start {
    SOLVER_START_SURFACE, /* in proportion to the area */
    SOLVER_START_RANDOM,  /* uniform in the domain (formulas) or in the crossing cells (volumes) */
    SOLVER_START_GIVEN    /* where `given` has them */
} solver_start;

typedef struct solver_params {
    size_t count; /* exactly this many particles at the end, >= 4; see max_sigma */
    solver_start start;
    bool random_in_cells; /* with SOLVER_START_RANDOM: in the crossing cells instead of the domain */
    /* with SOLVER_START_GIVEN: `count` places on the surface and their unit normals, along a curve that
     * fills space (geometry/morton), as the particles keep this order. They are near their rest, and are
     * brought there without haste: no coarse levels, no long steps. Only looked at by solver_new. */
    const vec3 *given, *given_normal;
    /* with SOLVER_START_GIVEN: a solve that rests with a mean energy above 1 + this, of the ideal, goes on once with the
     * long steps of a last level, which take out more disorder and move the points farther. 0: it never does */
    double excess_most;
    /* of a surface with patches: solver_patch_points of a solve of the same count and spacing, all of them */
    const uint32_t *given_patch, *given_place;
    uint64_t seed;
    bool graded; /* (13)(14) */
    double d, gamma, nu, kappa_max;
    const scaled_curvature *curvature; /* of (14), stays the caller's; NULL: the field's own */
    const sizing_field *sizing;        /* spacing by place, stays the caller's; NULL: even */
    double sigma;                      /* initial support, world units; 0: that of the ideal packing */
    /* the control of 6.1, not with coarse_to_fine: from `count` on particles are inserted until the support
     * is at most max_sigma, and deleted while it is so with fewer, but for min_count. 0: the count is
     * exact */
    double max_sigma;
    size_t min_count;
    bool unbiased;      /* insertion and deletion at random instead of biased by energy */
    size_t count_limit; /* more than this many particles are more than memory holds; 0: no limit */
    bool
        coarse_to_fine; /* solve a quarter of the count first, and so on down, then refine (method "sized") */
    /* with coarse_to_fine, and either `sizing` or patches: disorder that sweeps leave is taken out by local changes, where a
     * particle goes and another comes (method.md) */
    bool mend;
    const energy_function *energy; /* NULL: cotangent */
    /* not NULL: this method, from `count` particles on, of which there are in the end as many as it comes to;
     * graded: its target radii go with the amplitudes (14) */
    const witkin_heckbert_params *witkin_heckbert;
    isa isa;       /* what the kernels run on */
    bool gradient; /* steepest descent by `step` (of sigma^2) instead of Levenberg-Marquardt */
    double step;
    size_t list_limit; /* bytes that neighbour lists may take */
    int max_sweeps;
    double step_tolerance;   /* of the rms step over h */
    double energy_tolerance; /* of |E / E_ideal - 1| */
} solver_params;

#endif

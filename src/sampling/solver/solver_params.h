// SPDX-License-Identifier: Apache-2.0
/* solver_params: parameters of a solve. */
#ifndef HEXAD_SAMPLING_SOLVER_SOLVER_PARAMS_H
#define HEXAD_SAMPLING_SOLVER_SOLVER_PARAMS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/isa.h"
#include "sampling/packing/energy.h"
#include "sampling/solver/witkin_heckbert.h"
#include "sampling/sizing/scaled_curvature.h"
#include "sampling/sizing/sizing_field.h"

typedef enum solver_start {
    SOLVER_START_SURFACE, /* on the surface, in proportion to the area */
    SOLVER_START_RANDOM,  /* uniform in the domain, or with random_in_cells in the crossing grid cells; then
                           * projected */
    SOLVER_START_GIVEN,   /* at `given` */
    SOLVER_START_COARSEST /* at `given`, which are the particles of the coarsest level */
} solver_start;

/* Bounds of blue noise: the least distance of two points in spacings, and coverage over that distance. */
#define SOLVER_BLUE_NOISE_LEAST 0.74
#define SOLVER_BLUE_NOISE_COVERAGE 1.05

typedef struct solver_params {
    size_t count; /* >= 4; the exact number of points, unless max_sigma > 0 or witkin_heckbert is set */
    solver_start start;
    bool random_in_cells; /* see SOLVER_START_RANDOM; callers set it for volumes */
    /* With SOLVER_START_GIVEN, required: positions on the surface, nearly converged, and their unit normals.
     * The solve has no coarse levels and short steps only. The arrays, and given_patch
     * and given_place, are read by solver_new only.
     * - Without patches they have `count` entries, in the order of a space-filling curve
     *   (geometry/space/morton). The particles keep this order, so that neighbours are near each other in
     *   memory.
     * - With patches they are those of all solver_patch_points of an earlier solve of the same surface, count
     *   and spacing: one entry for each patch of a point on a curve, thus more than `count`. */
    const vec3 *given, *given_normal;
    /* With SOLVER_START_GIVEN: if the mean energy over the ideal energy exceeds 1 + max_excess at
     * convergence, the solve continues once, with a few of the long steps that a solve from
     * SOLVER_START_SURFACE takes on its last level. They remove defects and move the points farther. 0: never. */
    double max_excess;
    /* With SOLVER_START_GIVEN and patches, required: patch and place of these solver_patch_points, see
     * `given`. With SOLVER_START_COARSEST and patches, required: given_patch, the patch of each position. Without
     * patches given_place is NULL, or PARTICLES_PINNED for particles that never move. */
    const uint32_t *given_patch, *given_place;
    /* With SOLVER_START_COARSEST: the number of positions on the surface in `given`, with unit normals unless
     * the surface has patches; at most `count`, in any order. No two are equal. Refinement inserts the
     * others. On patches, curve samples replace points near curves, and each patch has its quota: surplus
     * points are left out, missing ones are drawn. */
    size_t given_count;
    uint64_t seed;
    bool graded; /* amplitudes by curvature, (13) and (14) */
    double d, gamma, nu, kappa_max;
    const scaled_curvature *curvature; /* curvature of (14), owned by the caller; NULL: that of the field */
    const sizing_field *sizing;        /* requested spacing, owned by the caller; NULL: uniform */
    double sigma;                      /* initial support, world units; 0: that of the ideal packing */
    /* Control of section 6.1, not with coarse_to_fine. Particles are inserted until the support is at most
     * max_sigma (world units). They are deleted while the support stays below it, down to min_count. 0:
     * the count is exact. */
    double max_sigma;
    size_t min_count;
    bool unbiased;      /* insertion and deletion at random instead of biased by energy */
    size_t count_limit; /* maximum number of particles that the memory limit permits; 0: no limit */
    /* solve for a quarter of the count first, recursively, then refine (method `sized`) */
    bool coarse_to_fine;
    /* With coarse_to_fine and either `sizing` or patches: repair defects that sweeps leave
     * (solver_repair_defects). */
    bool repair_defects;
    const energy_function *energy; /* NULL: cotangent */
    /* Not NULL: the method of Witkin and Heckbert, which starts with `count` particles; the final count
     * follows from its parameters. Not on surfaces with patches (not_supported). With `graded`, its target
     * radii are proportional to the amplitudes (14). */
    const witkin_heckbert_params *witkin_heckbert;
    /* Blue noise instead of a packing: points without regular order, whose least distance and coverage have
     * bounds. Starts on the surface, without coarse_to_fine, graded, max_sigma and witkin_heckbert. Curves
     * have no samples of their own. */
    bool blue_noise;
    isa isa;           /* instruction set of the kernels */
    bool gradient;     /* steepest descent by `step` instead of Levenberg-Marquardt */
    double step;       /* in units of sigma^2 per energy */
    size_t list_limit; /* maximum size of the neighbour lists, bytes */
    int max_sweeps;    /* at least 1, of all levels together; then the solve ends with SOLVER_OUT_OF_SWEEPS */
    double step_tolerance;   /* convergence: maximum rms step, in spacings h (see schedule.finest_rest) */
    double energy_tolerance; /* convergence: maximum of |E / E_ideal - 1| */
} solver_params;

#endif

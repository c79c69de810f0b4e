/* curve_chains: the points along the curves of a solved surface, in their order. */
#ifndef HEXAD_SOLVER_CURVE_CHAINS_H
#define HEXAD_SOLVER_CURVE_CHAINS_H

#include "field/patches.h"
#include "solver/solver.h"

/* Of curve c: point[first[c]] .. point[first[c + 1]], from its start to its end, corners with them; of a closed one the first
 * once. A corner that had no point of its own is the one at the other end of its shortest curve. Where rows of points became
 * one (merges_near_rows) a chain lacks what stands for its places in another row. */
typedef struct curve_chains {
    size_t *first;
    uint32_t *point;
    size_t points, corners; /* that lie on curves; of them those on corners */
} curve_chains;

void curve_chains_make(const field_patches *patches, const solver_points *solved, curve_chains *out);
void curve_chains_free(curve_chains *c); /* a zeroed one will do */

/* Whether a step between points of these spacings is none: it passes places that stand in another row. */
bool curve_chains_jumps(const field_patches *patches, double step, double one, double other);

/* The steps along the chains but for these, once for each patch that ends there, as pairs of the stands of that patch; to be
 * freed. */
uint32_t (*curve_chains_sides(const curve_chains *c, const field_patches *patches,
                              const solver_patch_points *stands, size_t *count))[2];

/* The same of a solved surface whose chains are not needed otherwise. */
uint32_t (*curve_chains_steps(const field_patches *patches, const solver_points *solved, size_t *count))[2];

double curve_chains_length(const field_patches *patches, const field_curve *curve);

#endif

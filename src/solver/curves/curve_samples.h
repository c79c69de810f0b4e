/* curve_samples: places for particles along the curves of a surface with patches, and at its corners.
 *
 * A curve between corners takes as many equal steps as fit best, each of about the requested spacing; a curve shorter than half
 * of that takes none, and of its two corners one, at which the patches of both end. A place counts once for the surface and stands once for each patch that
 * ends there, with that patch's normal. Where patches ask for it rows that come near each other become one (near_curves). World
 * space.
 */
#ifndef HEXAD_SOLVER_CURVE_ROWS_H
#define HEXAD_SOLVER_CURVE_ROWS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "solver/curves/boundary.h"
#include "field/patches.h"

typedef struct curve_samples {
    size_t count;    /* of places: corners first */
    vec3 *position;  /* of each, on the curve */
    uint32_t *curve; /* of each; of a corner one of those that end there */
    size_t corners;  /* how many places are corners */
    size_t stands;
    uint32_t *place, *patch; /* of each stand, ascending by place */
    vec3 *normal;            /* of each stand: unit, of the patch there */
    /* Of each patch how many cells of its packing the halves behind its rows make up: a patch that takes n cells of the
     * spacing holds n less this many other particles (a polygon's angles sum up so, or Gauss and Bonnet). */
    double *border;
} curve_samples;

/* Along the curves of `f`, which has patches. At most request->most places: where there would be more, they are farther apart.
 * Deterministic. Release also after failure. Error: limit_memory. */
bool curve_samples_make(const field *f, const boundary_request *request, curve_samples *out, error *e);
void curve_samples_free(curve_samples *r);

#endif

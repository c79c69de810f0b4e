/* rims: the curves along which faces of the domain cut an open surface, and first places of particles on
 * them.
 *
 * A face cuts the triangles of the scan in segments, which join into curves: closed ones, and ones that end
 * at another face. Particles that start on a rim in a row stay there, since nothing pushes them inwards;
 * those that start nearby may come to rest beside it and leave a gap.
 */
#ifndef HEXAD_SAMPLER_RIMS_H
#define HEXAD_SAMPLER_RIMS_H

#include <stddef.h>

#include "base/error.h"
#include "sampler/surface.h"

typedef struct rims {
    size_t count;
    vec3 *position, *normal; /* on the surface and in a face, exactly; unit normals of the surface */
} rims;

/* Places along the rims about `spacing` apart, no more than `most`: then farther apart. Nothing for a closed
 * surface. Deterministic. Release also after failure. Errors: limit_memory. */
bool rims_find(const surface *s, double spacing, size_t most, rims *out, error *e);
void rims_free(rims *r);

#endif

/* rims: the curves along which faces of the domain cut an open surface, and first places of particles on
 * them.
 *
 * A face cuts the triangles of the scan in segments, which join into curves: closed ones, and ones that end
 * at another face. Particles that start on a rim in a row stay there, since nothing pushes them inwards;
 * those that start nearby may come to rest beside it and leave a gap.
 */
#ifndef HEXAD_SURFACE_RIMS_H
#define HEXAD_SURFACE_RIMS_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"
#include "surface/grading.h"
#include "surface/surface.h"

typedef struct rims {
    size_t count;
    vec3 *position, *normal; /* on the surface and in a face, exactly; unit normals of the surface */
} rims;

/* How far apart places are to be: `spacing`, times what a grading requests there over `even`. */
typedef struct rims_request {
    double spacing;
    const grading *grading; /* NULL: even */
    double even;
    size_t most; /* places; where more would be needed, all are farther apart */
} rims_request;

double rims_spacing(const rims_request *request, vec3 x);

/* Nothing for a closed surface. Deterministic. Release also after failure. Errors: limit_memory. */
bool rims_find(const surface *s, const rims_request *request, rims *out, error *e);
void rims_free(rims *r);

#endif

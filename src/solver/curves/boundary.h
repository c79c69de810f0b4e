/* boundary: the curves along which faces of the domain cut an open surface, and first places of particles on
 * them.
 *
 * A face cuts the triangles of the scan in segments, which join into curves: closed ones, and ones that end
 * at another face. Particles that start in a row on the boundary stay there, since nothing pushes them
 * inwards. Particles that start near it may come to rest beside it and leave a gap.
 */
#ifndef HEXAD_SOLVER_BOUNDARY_H
#define HEXAD_SOLVER_BOUNDARY_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"
#include "sizing/sizing_field.h"
#include "surface/surface.h"

typedef struct boundary {
    size_t count;
    vec3 *position, *normal; /* on the surface and in a face, exactly; unit normals of the surface */
} boundary;

/* How far apart places are to be: `spacing`, times what a grading requests there over `even`. */
typedef struct boundary_request {
    double spacing;
    const sizing_field *sizing; /* NULL: even */
    double even;
    size_t most; /* places; where more would be needed, all are farther apart */
} boundary_request;

double boundary_spacing(const boundary_request *request, vec3 x);

/* Nothing for a closed surface. Deterministic. Release also after failure. Errors: limit_memory. */
bool boundary_find(const surface *s, const boundary_request *request, boundary *out, error *e);
void boundary_free(boundary *r);

#endif

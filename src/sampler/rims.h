/* rims: the curves along which faces of the domain cut an open surface, and first places of particles on
 * them.
 *
 * A face cuts the triangles of the scan in segments, which join into curves: closed ones, and ones that end
 * at another face. Particles that start on a rim in a row stay there, since nothing pushes them inwards;
 * those that start nearby may come to rest beside it and leave a gap.
 */
#ifndef HEXAD_SAMPLER_RIMS_H
#define HEXAD_SAMPLER_RIMS_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"
#include "sampler/grading.h"
#include "sampler/particles.h"
#include "sampler/surface.h"

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

/* Whether x lies within two spacings of a face of the box that rims are in: neighbours of a particle are missing
 * there, or not where they would be. */
static inline bool rims_are_near(bbox faces, vec3 x, double spacing)
{
    return !bbox_contains(bbox_grow(faces, -2 * spacing), x);
}

/* Sets p->rim of all particles, whose spacing is h times their size; on a closed surface it stays as it is. */
void rims_mark(const field *f, double h, particles *p);

#endif

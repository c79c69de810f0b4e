/* projection: moves points onto the surface, by Newton's method along the gradient (9).
 *
 * Distances are |F| / |grad F|, world units. On an open surface a point that leaves the domain is
 * put back on the face it crossed and the iteration goes on within that face, so that it ends on the
 * boundary, if anywhere; so does a point that begins in such a face. Pure functions, safe in any thread.
 */
#ifndef HEXAD_FIELD_PROJECTION_H
#define HEXAD_FIELD_PROJECTION_H

#include "field/field.h"

typedef struct projection_limits {
    int max_steps;
    double accept;   /* a sample this close to the surface ends the iteration */
    double shortcut; /* a step from this close ends it unseen: the error left is quadratic in it */
    double reject;   /* farther than this after the last step is failure */
} projection_limits;

/* Limits for positions that are moved again or only searched: to a thousandth of a length such as the spacing, from any distance. */
projection_limits projection_draft(double length);

/* What tolerances are fractions of: the spacing, but at most 5 cells. A coarse spacing is many cells, and within so many a field
 * may come near zero without a surface. */
double projection_scale(const field *f, double spacing);

/* The axes (bit k) of the faces that cut the surface and that x lies in, exactly: a particle on a boundary has some. */
unsigned projection_boundary_axes(const field *f, vec3 x);

/* Moves *x onto the surface and gives the unit normal there (of the last sample). False, outputs
 * untouched, when the field is not defined on the way, its gradient vanishes, or the limit is missed. */
bool projection_find(const field *f, const projection_limits *limits, vec3 *x, vec3 *normal);

/* The same with a hint, see `sample_near` in field_ops. */
bool projection_find_near(const field *f, const projection_limits *limits, uint32_t *hint, vec3 *x,
                          vec3 *normal);

/* The same of places one a lane, with limits in units of each lane's own: on patches, where the surface has `sample_patch_lanes`, which
 * hints are of; or, with NULL for both, on a surface without that is not open, in single precision (`sample_lanes`). Lanes that are `defined` before count; those that fail become undefined, with outputs untouched. */
void projection_find_lanes(const field *f, const projection_limits *limits, const double unit[VEC3_LANES],
                           const uint32_t patch[VEC3_LANES], bool defined[VEC3_LANES],
                           uint32_t hint[VEC3_LANES], vec3_lanes *x, vec3_lanes *normal);

/* The same as projection_find_near, with the sample at the place where *x ends. False also where there is none. */
bool projection_land(const field *f, const projection_limits *limits, uint32_t *hint, vec3 *x,
                     field_sample *sample);

/* For points where Newton's method runs in circles, near a vanishing gradient: looks for a change of sign
 * along the unit vector `along`, both ways and no farther than `reach`, and halves the interval until it is
 * as short as doubles allow. False, outputs untouched, when there is none or no normal there. */
bool projection_bisect(const field *f, vec3 along, double reach, vec3 *x, vec3 *normal);

#endif

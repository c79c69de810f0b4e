// SPDX-License-Identifier: Apache-2.0
/* projection: moves points onto the surface by Newton's method along the gradient (9).
 *
 * Distances are |F| / |grad F|, world units. On an open surface a point that leaves the domain is clamped to
 * the face that it crossed, and the iteration continues within that face: it ends on the boundary or fails. A
 * point that starts in such a face is treated alike. Pure functions, any thread.
 */
#ifndef HEXAD_SURFACE_FIELD_PROJECTION_H
#define HEXAD_SURFACE_FIELD_PROJECTION_H

#include "surface/field/field.h"

typedef struct projection_limits {
    int max_steps;
    double accept; /* distance at which the iteration ends */
    /* distance from which one step, without a further sample, ends the iteration: the error is quadratic
     * in it */
    double shortcut;
    double reject; /* distance after the last step that is a failure */
} projection_limits;

/* Limits for places that are moved again or only searched, from any distance: a tolerance of a thousandth of
 * `length`, such as the spacing. */
projection_limits projection_draft(double length);

/* The length that tolerances are relative to: the spacing, but at most 5 cells. Over more cells, a field may
 * approach zero without a surface. */
double projection_scale(const field *f, double spacing);

/* The axes (bit k) of the faces that cut the surface and that contain x exactly. 0 for a point that is not on
 * the boundary. */
unsigned projection_boundary_axes(const field *f, vec3 x);

/* Moves *x onto the surface. *normal: the unit normal of the last sample. False, with outputs unchanged: the
 * field is not defined on the way, the gradient vanishes, or the limits are exceeded. */
bool projection_find(const field *f, const projection_limits *limits, vec3 *x, vec3 *normal);

/* projection_find with a hint; see `sample_near` in field_ops. */
bool projection_find_near(const field *f, const projection_limits *limits, uint32_t *hint, vec3 *x,
                          vec3 *normal);

/* projection_find for one place per lane, with limits in units of `unit`. With `patch` and `hint`: on the
 * fields of patches; the surface has `sample_patch_lanes`. With NULL for both: on a surface without patches
 * that is not open, in single precision (`sample_lanes`). Lanes with `defined` false are ignored; lanes that
 * fail become undefined, with outputs unchanged. */
void projection_find_lanes(const field *f, const projection_limits *limits, const double unit[VEC3_LANES],
                           const uint32_t patch[VEC3_LANES], bool defined[VEC3_LANES],
                           uint32_t hint[VEC3_LANES], vec3_lanes *x, vec3_lanes *normal);

/* projection_find_near that also returns the sample at the final *x. False also if the field is not
 * defined there. */
bool projection_sample(const field *f, const projection_limits *limits, uint32_t *hint, vec3 *x,
                       field_sample *sample);

/* For points at which Newton's method does not converge, near a vanishing gradient. Searches for a change of
 * sign along the unit vector `along`, in both directions up to `reach`, and bisects to the precision of
 * doubles. False, with outputs unchanged: there is no change of sign, or no normal at it. */
bool projection_bisect(const field *f, vec3 along, double reach, vec3 *x, vec3 *normal);

#endif

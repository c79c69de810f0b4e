// SPDX-License-Identifier: Apache-2.0
/* attributes: values that the points of a job carry in addition to their own properties.
 *
 * They are located when the job opens its inputs, and read when the points are final. On a surface with
 * patches the first ones are `feature` (solver_feature) and `patch`. On a surface with a mesh the last one is
 * `kappa_defined` (point_curvature.h), if results have the curvature. The place of the points on the meshes of
 * the surface (`source`) is one attribute of the spec and several of the points
 * (job/attributes/attachment.h). One thread at a time.
 */
#ifndef HEXAD_JOB_PHASES_ATTRIBUTES_H
#define HEXAD_JOB_PHASES_ATTRIBUTES_H

#include "job/attributes/attribute.h"
#include "io/points/points.h"
#include "base/json/json.h"
#include "job/source/point_curvature.h"
#include "job/source/source.h"
#include "job/phases/surface_meshes.h"
#include "sampling/solver/solver.h"
#include "spec/spec.h"

typedef struct attributes_entry attributes_entry;

typedef struct attributes {
    size_t count;
    attributes_entry *entries;
    point_attribute *values; /* one per attribute; arrays of values are NULL before attributes_read */
    vec3 *color;             /* values of the first color attribute, or NULL */
    double *uv;              /* values of the first texture coordinates, or NULL */
    surface_meshes meshes;   /* if places on them are requested */
    /* per point, set by the job before attributes_read: its curvature; NULL: no part of the surface is a mesh, or no
     * result has the curvature */
    const point_curvature *curvature;
    bool has_own_defined; /* a spec's attribute is called kappa_defined: that of hexad is left out */
    const bool *kept; /* per point, set by the job before attributes_read: it was given (sampling.points, mode
                       * keep) */
    const double *weight; /* the same: its quadrature weight, if that is requested */
} attributes;

/* Whether a result has the curvature of the points, or a quantity that follows from it. */
bool attributes_have_curvature(const spec *s);

/* Checks that the points have the attributes that pictures and instances name. Errors: attribute_missing,
 * spec_invalid. */
bool attributes_check_named(const spec *s, const points *set, error *e);

/* Locates all attributes of the spec (`from` may be a source that is not open, but for its roots), and checks
 * the columns of output.ply.properties. Errors: attribute_missing, spec_invalid (a name occurs twice or is
 * one of the points' own properties), those of attribute_find and source_open_file. Free *out after
 * failure, too. */
bool attributes_find(const spec *s, source *from, size_t memory_limit, attributes *out, error *e);

/* Adds attributes whose values are known, before all others and in the order of the list, except `kappa_defined`,
 * which becomes the last one. One that *a has located under the same name replaces a given one. Takes ownership of the names and values. */
void attributes_adopt(attributes *a, const point_attribute *given, size_t count);

/* Reads the values at the points of `set`, which are those of `solved`, and sets its attributes, color and
 * uv; `a` owns these arrays. Errors: limit_memory and those of the readers of each file. */
bool attributes_read(attributes *a, const source *from, const solver_points *solved, size_t memory_limit,
                     points *set, error *e);

/* Puts the values in another order: point k gets those of point order[k]. Sets the attributes of the set
 * again. Error: limit_memory. */
bool attributes_permute(attributes *a, const uint32_t *order, points *set, error *e);

/* The member `attributes` of the report, which the caller frees; NULL: there are none. Adds warnings. */
json *attributes_describe(const attributes *a, json *warnings);

/* Bytes per point for its attributes. */
double attributes_bytes_per_point(const attributes *a);
void attributes_free(attributes *a);

#endif

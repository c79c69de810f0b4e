/* attributes: what a job's points carry beside their own properties: found when the job opens its inputs, filled in
 * when the points are final. Of a surface with patches they begin with `feature` (solver_feature) and `patch`. One thread
 * at a time. */
#ifndef HEXAD_RUN_ATTRIBUTES_H
#define HEXAD_RUN_ATTRIBUTES_H

#include "attribute/attribute.h"
#include "formats/points.h"
#include "json/json.h"
#include "source/source.h"
#include "solver/solver.h"
#include "spec/spec.h"

typedef struct attributes_entry attributes_entry;

typedef struct attributes {
    size_t count;
    attributes_entry *entries;
    point_attribute *values; /* of each; those of its points are NULL before attributes_read */
    vec3 *color;             /* of the first color, or NULL */
    double *uv;              /* of the first texture coordinates, or NULL */
} attributes;

/* Looks for all attributes of the spec, and for the columns that output.ply.properties names. Errors:
 * attribute_missing, spec_invalid (two of one name, or a name that the points have of their own), those of
 * attribute_find and source_open_file. Free after failure, too. */
bool attributes_find(const spec *s, source *from, size_t memory_limit, attributes *out, error *e);

/* Fills in the values at the points of `set`, which are those of `solved`, and sets its attributes, color and uv. */
bool attributes_read(attributes *a, const source *from, const solver_points *solved, size_t memory_limit,
                     points *set, error *e);

/* Adds the member `attributes` to the report, and warnings. */
void attributes_describe(const attributes *a, json *report, json *warnings);

/* Bytes that the attributes of a point take. */
double attributes_bytes_per_point(const attributes *a);
void attributes_free(attributes *a);

#endif

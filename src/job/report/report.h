// SPDX-License-Identifier: Apache-2.0
/* report: builds report.json, which doc/report.md describes. */
#ifndef HEXAD_JOB_REPORT_REPORT_H
#define HEXAD_JOB_REPORT_REPORT_H

#include "base/json/json.h"
#include "sampling/measures/measures.h"
#include "job/source/plan.h"
#include "job/source/source.h"
#include "job/report/outcome.h"
#include "sampling/sizing/clearance.h"
#include "sampling/solver/solver.h"
#include "sampling/voronoi/triangulation.h"
#include "spec/spec.h"
#include "surface/scan/surface.h"

/* The files of points and meshes. */
typedef struct report_outputs {
    /* Maximum and rms of |F| / (|grad F| h) at the positions in points.ply, without points that are kept. For
     * meshes and labels: the distance from the triangles over h. */
    double max_residual, rms_residual;
    bool widened;    /* float was requested, double was written */
    vec3 origin;     /* of floats in glTF and USD; 0 if floats represent the positions without an origin */
    double rounding; /* largest error of floats relative to the origin, over h; 0 without an origin */
    bool y_up;       /* y, not z, points up in pictures and scenes */
    bool has_mesh;
    triangulation_facts mesh;
    double chord_error; /* largest distance of the triangles of the mesh from the surface, if a chord error is
                         * requested; world units */
    json *label_meshes; /* report_fill takes ownership; or NULL */
} report_outputs;

/* The phases of a job and their times, monotonic. */
typedef struct report_timing {
    int64_t start_ms; /* of the job */
    size_t count;
    const char *const *phase;
    const int64_t *phase_ms;
} report_timing;

typedef struct report_facts {
    const spec *spec;
    const source *source;
    json *attributes;               /* the member `attributes`, which report_fill takes over; or NULL */
    const json *attribute_warnings; /* an array of texts */
    const surface *scan;
    const sizing_field *sizing;        /* or NULL */
    const scaled_curvature *curvature; /* curvature for sampling.alpha, or NULL */
    const solver *solver;
    size_t count; /* points of the result */
    const measures *measures;
    const clearance *walls; /* if report_needs_walls; otherwise NULL */
    double landed;          /* largest distance by which a point was projected onto a mesh, world units */
    const double *farthest; /* coverage of each patch */
    int64_t peak_memory;    /* bytes */
    double memory_limit;    /* limit of the job, bytes */
    double most_memory;     /* the largest limit that the job may have, bytes; 0: unknown */
    double particle_memory; /* limit for particles, bytes */
    plan_particles particles;
    const report_outputs *outputs;
    const outcome_result *result;
    threads *pool;
    isa isa;
    report_timing timing;
} report_facts;

/* Whether the report needs the distances of opposite walls. On curved walls the distance of two points from their
 * tangent planes differs from the thickness. Therefore rays between the walls measure it, as before the job. They can
 * take longer than the job, and are traced only if the points indicate thin walls, or are too few. */
bool report_needs_walls(const measures *m, size_t count, outcome_kind outcome);

/* Adds all members except `outputs`, which the caller has added. */
void report_fill(json *report, const report_facts *facts);

/* Adds the seconds of each phase. */
void report_put_timing(json *report, const report_timing *t);

/* Adds a warning when the build has no pictures and therefore the default preview is not written. */
void report_warn_of_build(json *warnings, const spec *s);

/* Adds the member `bounding_box`. */
void report_put_box(json *object, bbox box);

#endif

/* report: builds report.json, which doc/report.md describes. */
#ifndef HEXAD_JOB_PHASES_REPORT_H
#define HEXAD_JOB_PHASES_REPORT_H

#include "base/json/json.h"
#include "sampling/measures/measures.h"
#include "job/phases/progress.h"
#include "job/phases/results.h"
#include "job/phases/attributes.h"
#include "job/source/source.h"
#include "job/phases/outcome.h"
#include "sampling/solver/solver.h"
#include "spec/spec.h"
#include "surface/scan/surface.h"

typedef struct report_facts {
    const spec *spec;
    const source *source;
    const attributes *attributes;
    const surface *scan;
    const sizing_field *sizing;        /* or NULL */
    const scaled_curvature *curvature; /* of sampling.alpha, or NULL */
    const solver *solver;
    size_t count; /* points of the result */
    const measures *measures;
    double landed;          /* largest distance by which a point was projected onto a mesh, world units */
    const double *farthest; /* coverage of each patch */
    int64_t peak_memory;    /* bytes */
    double memory_limit;    /* limit of the job, bytes */
    double particle_memory; /* limit for particles, and bytes per particle */
    double bytes_per_particle;
    const results_facts *results;
    const outcome_result *result;
    threads *pool;
    isa isa;
    const progress *progress; /* ended */
} report_facts;

/* Adds all members except `outputs`, which the caller has added. */
void report_fill(json *report, const report_facts *facts);

/* Adds the seconds of each phase. */
void report_put_timing(json *report, const progress *p);

/* Adds a warning when the build has no pictures and therefore the default preview is not written. */
void report_warn_of_build(json *warnings, const spec *s);

/* Adds the member `bounding_box`. */
void report_put_box(json *object, bbox box);

#endif

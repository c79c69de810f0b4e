/* report: builds report.json, which doc/report.md describes. */
#ifndef HEXAD_RUN_REPORT_H
#define HEXAD_RUN_REPORT_H

#include "json/json.h"
#include "packing/quality.h"
#include "run/progress.h"
#include "run/results.h"
#include "run/source.h"
#include "run/verdict.h"
#include "sampler/sampler.h"
#include "spec/spec.h"
#include "surface/surface.h"

typedef struct report_facts {
    const spec *spec;
    const source *source;
    const surface *scan;
    const sizing_field *sizing; /* or NULL */
    const sampler *sampler;
    const quality *quality;
    const results_facts *results;
    const verdict *verdict;
    int threads;
    isa isa;
    const progress *progress; /* ended */
} report_facts;

/* Fills in all members except `outputs`, which the caller has added. */
void report_fill(json *report, const report_facts *facts);

/* Adds the member `bounding_box`. */
void report_put_box(json *object, bbox box);

#endif

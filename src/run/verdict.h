/* verdict: the outcome of a job, judged from the points that it delivers.
 *
 * not_converged: the particles did not come to rest, or missed a target. unresolved: they are at rest, but not in order,
 * most often because the surface has features below the spacing. converged: at rest and in order. Each criterion
 * compares one number with its bound; those that fail are the reasons. Pure functions, any thread.
 */
#ifndef HEXAD_RUN_VERDICT_H
#define HEXAD_RUN_VERDICT_H

#include "base/words.h"
#include "json/json.h"
#include "voronoi/quality.h"
#include "sampler/sampler.h"

#define VERDICT_LIST(ENTRY, prefix)         \
    ENTRY(prefix, CONVERGED, "converged")   \
    ENTRY(prefix, UNRESOLVED, "unresolved") \
    ENTRY(prefix, NOT_CONVERGED, "not_converged")

typedef enum verdict_outcome { VERDICT_LIST(WORDS_ENUMERATOR, VERDICT) VERDICT_OUTCOMES } verdict_outcome;

extern const char *const verdict_names[VERDICT_OUTCOMES];

/* Of the points that are not near a boundary. With more than that the measures speak for too little of the surface. */
#define VERDICT_UNRESOLVED_SHARE 0.02

/* Points this far from the surface, in spacings, are not on it. */
#define VERDICT_RESIDUAL 1e-3

typedef struct verdict_input {
    const sampler *sampler; /* finalized */
    const quality *quality; /* of its points */
    size_t count;           /* requested; 0: the count is not a target */
    double step_tolerance, energy_tolerance;
    double missing;   /* share of a mesh's area that is not sampled */
    double residual;  /* the largest distance of a point from the surface, in spacings */
    double coverage;  /* the farthest place of the surface from the points, in spacings */
    bool thin_labels; /* some of the labels are one voxel thin */
} verdict_input;

enum { VERDICT_MOST_REASONS = 15 };

/* A criterion that failed. Texts are constants. */
typedef struct verdict_reason {
    const char *criterion; /* stable name */
    double value, bound;   /* the value is on the wrong side of the bound */
    const char *message;   /* what it means and what to do */
    bool of_thin_parts;    /* thin parts of a surface may be the cause */
} verdict_reason;

typedef struct verdict {
    verdict_outcome outcome;
    size_t reason_count; /* 0 when converged */
    verdict_reason reason[VERDICT_MOST_REASONS];
} verdict;

/* Whether so many points lie near boundaries that no measure speaks for the surface. */
bool verdict_is_near_boundaries(const quality *q, const sampler_points *p);

/* Whether a reason is one that thin parts of a surface may be the cause of. */
bool verdict_is_of_thin_parts(const verdict *v);

verdict verdict_judge(const verdict_input *in);

/* Adds `outcome` and `outcome_reasons` to a report. */
void verdict_describe(const verdict *v, json *report);

#endif

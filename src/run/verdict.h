/* verdict: the outcome of a job, from the measures of the delivered points.
 *
 * not_converged: the solve was cut off, still moves, or missed a target. unresolved: the points do not represent the surface. converged:
 * neither. Each criterion compares one number with its bound, and each catches a bad result that no other does; those that fail are the
 * reasons. doc/report.md has the table. How regular the packing is, is rated, and decides no outcome unless outcome.require names it. Pure
 * functions, any thread.
 */
#ifndef HEXAD_RUN_VERDICT_H
#define HEXAD_RUN_VERDICT_H

#include "base/words.h"
#include "json/json.h"
#include "measures/measures.h"
#include "spec/spec.h"

#define VERDICT_LIST(ENTRY, prefix)         \
    ENTRY(prefix, CONVERGED, "converged")   \
    ENTRY(prefix, UNRESOLVED, "unresolved") \
    ENTRY(prefix, NOT_CONVERGED, "not_converged")

typedef enum verdict_outcome { VERDICT_LIST(WORDS_ENUMERATOR, VERDICT) VERDICT_OUTCOMES } verdict_outcome;

extern const char *const verdict_names[VERDICT_OUTCOMES];

/* Points this far from the surface, in spacings, are not on it. */
#define VERDICT_RESIDUAL 1e-3

typedef struct verdict_input {
    const measures *measures; /* of the delivered points */
    bool stopped;             /* the solve ended before it had converged, or ran out of sweeps */
    double rms_step;          /* of its last sweep, in spacings */
    double step_left;         /* of the delivered points, in spacings; NAN: unknown */
    double step_tolerance;
    double gain, gain_tolerance; /* the largest relative decrease of energy that a point can still achieve */
    double energy_error, energy_tolerance; /* relative; 0: the energy is not a target */
    size_t count_error; /* points more or fewer than requested; 0: the count is not a target */
    size_t lost;        /* points that are not on the surface */
    double lost_area; /* share of the area of a mesh or combination that is not part of the sampled surface */
    double residual,
        rms_residual; /* the largest and the rms distance of the points from the surface, in spacings */
    const spec_requirement *require; /* SPEC_REQUIRE_COUNT bounds */
} verdict_input;

enum { VERDICT_MOST_REASONS = 32 };

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

/* Whether a reason is one that thin parts of a surface may be the cause of. */
bool verdict_is_of_thin_parts(const verdict *v);

verdict verdict_judge(const verdict_input *in);

/* Adds `outcome` and `outcome_reasons` to a report. */
void verdict_describe(const verdict *v, json *report);

#endif

// SPDX-License-Identifier: Apache-2.0
/* outcome: the outcome of a job, from the measures of the delivered points.
 *
 * not_converged: the solve was stopped, still moves, or missed a target. unresolved: the points do not
 * represent the surface. converged: neither. Each criterion compares one number with its bound; the failed
 * ones are the reasons. doc/report.md has the table. The regularity of the packing is rated, and does not
 * affect the outcome unless outcome.require names it. Pure functions, any thread.
 */
#ifndef HEXAD_JOB_REPORT_OUTCOME_H
#define HEXAD_JOB_REPORT_OUTCOME_H

#include "base/core/words.h"
#include "base/json/json.h"
#include "sampling/measures/measures.h"
#include "spec/spec.h"

#define OUTCOME_LIST SPEC_OUTCOME_LIST

typedef enum outcome_kind { OUTCOME_LIST(WORDS_ENUMERATOR, OUTCOME) OUTCOME_KINDS } outcome_kind;

extern const char *const outcome_names[OUTCOME_KINDS];

/* Distance from the surface, in spacings, beyond which a point is not on it. */
#define OUTCOME_RESIDUAL 1e-3

typedef struct outcome_input {
    const measures *measures; /* of the delivered points */
    bool stopped;             /* the solve ended before it had converged */
    double rms_step;          /* of its last sweep, in spacings */
    double step_left;         /* of the delivered points, in spacings; NAN: unknown */
    double step_tolerance;
    bool is_blue_noise;          /* least distance and coverage have the bounds of that pattern */
    double gain, gain_tolerance; /* largest relative decrease of energy that one point can still achieve */
    double energy_error, energy_tolerance; /* relative; 0: the energy is not a target */
    size_t count_error; /* points more or fewer than requested; 0: the count is not a target */
    size_t lost;        /* points that are not on the surface */
    /* Fraction of the area of a mesh or combination that the sampled surface does not represent. */
    double lost_area;
    double ringing;                /* fraction of the cells of volumes, see source_ringing */
    double lost_walls;             /* fraction of the area of a dense volume that lies between its samples */
    double residual, rms_residual; /* Maximum and rms distance of the points from the surface, in spacings. */
    const spec_requirement *require; /* SPEC_REQUIRE_COUNT bounds */
} outcome_input;

enum { OUTCOME_MOST_REASONS = 32 };

/* A criterion that failed. */
typedef struct outcome_reason {
    const char *criterion; /* stable name, a constant */
    double value, bound;   /* the value is on the wrong side of the bound */
    char message[320];     /* what was found, with value and bound, and what to do */
    bool of_thin_parts;    /* thin parts of a surface may be the cause */
} outcome_reason;

typedef struct outcome_result {
    outcome_kind outcome;
    size_t reason_count; /* 0 when converged */
    outcome_reason reason[OUTCOME_MOST_REASONS];
} outcome_result;

/* Whether thin parts of the surface may be the cause of a reason. */
bool outcome_is_of_thin_parts(const outcome_result *v);

outcome_result outcome_evaluate(const outcome_input *in);

/* Adds `outcome` and `outcome_reasons` to a report. */
void outcome_describe(const outcome_result *v, json *report);

#endif

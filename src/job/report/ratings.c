// SPDX-License-Identifier: Apache-2.0
#include "job/report/ratings.h"

#include <math.h>
#include <stddef.h>

#include "sampling/solver/solver_params.h"

/* A value equal to a bound has the better rating. */
typedef struct rated_measure {
    const char *name;
    size_t offset; /* in struct measures */
    double good, fair;
} rated_measure;

/* Good: reached by converged runs on scans and CAD models with 10 000 points. Poor: visibly irregular, as
 * after a few sweeps. */
static const rated_measure rated[] = {
    {"hex_fraction", offsetof(measures, hex_fraction), 0.85, 0.6},
    {"edge_cv", offsetof(measures, edge_cv), 0.08, 0.13},
    {"area_cv", offsetof(measures, area_cv), 0.06, 0.12},
    {"energy_excess", offsetof(measures, energy_excess), 0.03, 0.1},
    {"disorder", offsetof(measures, disorder), 0.04, 0.1},
    {"defect_share", offsetof(measures, defect_share), 0.15, 0.4},
};

/* Bounds of blue noise. Good: those of the solve. Fair: sample elimination has 0.65 to 0.7 and 1.5. */
static const rated_measure least_distance = {"min_spacing_ratio", 0, SOLVER_BLUE_NOISE_LEAST, 0.65},
                           relative_coverage = {"relative_coverage", 0, SOLVER_BLUE_NOISE_COVERAGE, 1.5};

static const char *rating_of(const rated_measure *r, double value)
{
    const double sign = r->good > r->fair ? -1 : 1; /* -1 if larger values are better */
    return isnan(value)                     ? NULL
           : sign * value <= sign * r->good ? "good"
           : sign * value <= sign * r->fair ? "fair"
                                            : "poor";
}

static void describe(json *ratings, const rated_measure *r, double value)
{
    json *object = json_put_object(ratings, r->name);
    json_put_number(object, "value", value);
    json_put_string(object, "rating", rating_of(r, fabs(value))); /* energies can be below the ideal 0 */
}

void ratings_describe(const measures *m, bool is_blue_noise, json *report)
{
    json *ratings = json_put_object(report, "ratings");
    if (is_blue_noise) {
        describe(ratings, &least_distance, m->min_spacing_ratio);
        describe(ratings, &relative_coverage, m->coverage / m->min_spacing_ratio);
        return;
    }
    for (size_t k = 0; k < sizeof rated / sizeof *rated; k++)
        describe(ratings, &rated[k], *(const double *)((const char *)m + rated[k].offset));
}

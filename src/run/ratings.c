#include "run/ratings.h"

#include <math.h>
#include <stddef.h>

/* A value equal to a bound has the better rating. */
typedef struct rated_measure {
    const char *name;
    size_t offset; /* in struct measures */
    double good, fair;
} rated_measure;

/* Good: reached by converged runs on scans and CAD models with 10 000 points. Poor: visibly irregular, as after a few
 * sweeps. */
static const rated_measure rated[] = {
    {"hex_fraction", offsetof(measures, hex_fraction), 0.85, 0.6},
    {"edge_cv", offsetof(measures, edge_cv), 0.08, 0.13},
    {"area_cv", offsetof(measures, area_cv), 0.06, 0.12},
    {"energy_excess", offsetof(measures, energy_excess), 0.03, 0.1},
    {"disorder", offsetof(measures, disorder), 0.04, 0.1},
    {"defect_share", offsetof(measures, defect_share), 0.15, 0.4},
};

static const char *rating_of(const rated_measure *r, double value)
{
    const double sign = r->good > r->fair ? -1 : 1; /* -1 if larger values are better */
    return isnan(value)                     ? NULL
           : sign * value <= sign * r->good ? "good"
           : sign * value <= sign * r->fair ? "fair"
                                            : "poor";
}

void ratings_describe(const measures *m, json *report)
{
    json *ratings = json_put_object(report, "ratings");
    for (size_t k = 0; k < sizeof rated / sizeof *rated; k++) {
        const double value = *(const double *)((const char *)m + rated[k].offset);
        json *object = json_put_object(ratings, rated[k].name);
        json_put_number(object, "value", value);
        json_put_string(object, "rating", rating_of(&rated[k], value));
    }
}

// SPDX-License-Identifier: Apache-2.0
#include "job/report/advice.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "geometry/space/packing.h"
#include "job/source/plan.h"

/* Factor of the spacing that is tried if the required factor is unknown. */
static const double BLIND_FACTOR = 0.5;

/* The value rounded up to two digits. */
static double rounded_up(double value)
{
    double unit = elementary_pow(10, floor(elementary_log10(value)) - 1);
    return ceil(value / unit * (1 - 1e-12)) * unit;
}

advice_resolution advice_resolve(double area, size_t count, double factor, double thinnest)
{
    const double least = clearance_spacing(thinnest) / packing_spacing(area, (double)count),
                 by = factor < 1 && fmax(factor, least) > 0 ? factor : BLIND_FACTOR;
    if (least >= 1)
        return (advice_resolution){packing_spacing(area, (double)count), (double)count, true, true};
    const double applied = fmax(by, least), points = rounded_up((double)count / (applied * applied));
    return (advice_resolution){packing_spacing(area, points), points, by <= least, false};
}

double advice_factor(const clearance *walls, double thinnest)
{
    return thinnest > 0 && walls->factor <= walls->least_factor ? 0 : walls->factor;
}

/* The format of the end of messages about a resolution that no permitted count has. */
#define BEYOND_THE_MAXIMUM "more than the maximum of %.0f points: %s"

/* What to do if no permitted count has the resolution. */
static const char *other_remedy(const spec *s)
{
    return s->surface.kind == SPEC_SURFACE_LABELS
               ? "smooth the labels with surface.labels.majority, or merge thin labels with surface.labels.groups"
               : "smooth the input, or sample a region of it";
}

json *advice_append(json *list, const char *code, const char *message)
{
    json *item = json_append_object(list);
    json_put_string(item, "code", code);
    json_put_string(item, "message", message);
    return json_put_object(item, "set");
}

void advice_put_walls(json *advice, json *warnings, const spec *s, double share, bool of_surface,
                      advice_resolution to)
{
    char *how =
        to.reached ? mem_printf("They are thinner than half a voxel, which the data do not determine: %s",
                                other_remedy(s))
        : to.count > PLAN_COUNT_MAX
            ? mem_printf(
                  "The two sides of these walls are distinguished at a spacing of %.3g, which takes " BEYOND_THE_MAXIMUM,
                  to.spacing, PLAN_COUNT_MAX, other_remedy(s))
            : mem_printf("To distinguish the two sides of %s, ask for %.0f points (spacing %.3g)",
                         to.of_voxels ? "walls of half a voxel, the thinnest that the data determine"
                                      : "these walls",
                         to.count, to.spacing);
    char *text = mem_printf(
        of_surface
            ? "About %.3g %% of the surface are walls thinner than 1.2 spacings. This matters only if triangles "
              "are made from the points alone. %s."
            : "%.3g %% of the points are on walls thinner than 1.2 spacings. %s.",
        100 * share, how);
    if (of_surface)
        advice_append(advice, "thin_walls", text);
    else
        json_append_string(warnings, text);
    free(how);
    free(text);
}

/* The value rounded down to three digits. */
static double rounded_down(double value)
{
    double unit = elementary_pow(10, floor(elementary_log10(value)) - 2);
    return floor(value / unit * (1 + 1e-12)) * unit;
}

/* The member of the spec that determines the number of points, and its value at this resolution. */
static const char *choose_target(const spec *s, double area, advice_resolution to, double *value)
{
    *value = s->spacing > 0   ? rounded_down(to.spacing)
             : s->density > 0 ? rounded_up(to.count / area)
             : s->has_control ? rounded_down(packing_support(to.spacing))
                              : to.count;
    return s->spacing > 0   ? "/sampling/spacing"
           : s->density > 0 ? "/sampling/density"
           : s->has_control ? "/sampling/control/max_sigma"
                            : "/sampling/count";
}

void advice_append_resolution(json *list, const spec *s, double area, advice_resolution to,
                              const advice_memory *of)
{
    static const char code[] = "unresolved";
    double value, memory = of->most > 0 && of->needed <= of->most ? fmin(rounded_up(of->needed), of->most)
                                                                  : rounded_up(of->needed);
    const char *target = choose_target(s, area, to, &value);
    char *message,
        *more = memory > of->limit ? mem_printf(" and /limits/memory_mb to %.0f", memory) : mem_strdup("");
    if (to.reached) {
        message = mem_printf("walls are thinner than half a voxel, which the data do not determine: %s",
                             other_remedy(s));
        advice_append(list, code, message);
    } else if (to.count > PLAN_COUNT_MAX) {
        message = mem_printf(
            "the spacing is too large to distinguish the two sides of thin walls, which takes a spacing of "
            "%.3g and " BEYOND_THE_MAXIMUM,
            to.spacing, PLAN_COUNT_MAX, other_remedy(s));
        advice_append(list, code, message);
    } else if (of->most > 0 && memory > of->most) {
        message = mem_printf(
            "the spacing is too large to distinguish the two sides of thin walls, which takes %.0f points (spacing "
            "%.3g) and about %.0f MiB, more than the %.0f MiB that a job may have: %s",
            to.count, to.spacing, memory, of->most, other_remedy(s));
        advice_append(list, code, message);
    } else {
        message = mem_printf(
            "the spacing is too large to distinguish the two sides of thin walls: set %s to %.10g%s, "
            "which gives %.0f points (spacing %.3g)%s",
            target, value, more, to.count, to.spacing,
            to.of_voxels ? " and separates walls of half a voxel, the thinnest that the data determine" : "");
        json *set = advice_append(list, code, message);
        json_put_number(set, target, value);
        if (memory > of->limit) json_put_number(set, "/limits/memory_mb", memory);
    }
    free(message);
    free(more);
}

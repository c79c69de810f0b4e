#include "run/advice.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "packing/packing.h"
#include "run/plan.h"

/* Where points are unresolved and the rays of the clearance see no reason, this spacing is tried next. */
static const double BLIND_FACTOR = 0.5;

/* Up to two digits. */
static double rounded_up(double value)
{
    double unit = pow(10, floor(log10(value)) - 1);
    return ceil(value / unit * (1 - 1e-12)) * unit;
}

advice_resolution advice_resolve(double area, size_t count, const clearance *c)
{
    double factor = c->factor < 1 ? c->factor : BLIND_FACTOR;
    double points = rounded_up((double)count / (factor * factor));
    return (advice_resolution){packing_spacing(area, points), points};
}

json *advice_append(json *list, const char *code, const char *message)
{
    json *item = json_append_object(list);
    json_put_string(item, "code", code);
    json_put_string(item, "message", message);
    return json_put_object(item, "set");
}

/* The value with three digits, and not above it. */
static double rounded_down(double value)
{
    double unit = pow(10, floor(log10(value)) - 2);
    return floor(value / unit * (1 + 1e-12)) * unit;
}

void advice_append_resolution(json *list, const spec *s, double area, advice_resolution to, double memory_mb,
                              double limit_mb)
{
    bool possible = to.count <= PLAN_COUNT_MAX;
    char *message =
        possible
            ? mem_printf("%.0f points, a spacing of %.3g, resolve the surface", to.count, to.spacing)
            : mem_printf("resolving the surface takes a spacing of %.3g, which is %.2g points: smooth the "
                         "input, or sample a region of it",
                         to.spacing, to.count);
    json *set = advice_append(list, "unresolved", message);
    free(message);
    if (!possible) return;
    if (s->spacing > 0)
        json_put_number(set, "/sampling/spacing", rounded_down(to.spacing));
    else if (s->density > 0)
        json_put_number(set, "/sampling/density", rounded_up(to.count / area));
    else if (s->has_control)
        json_put_number(set, "/sampling/control/max_sigma", rounded_down(packing_support(to.spacing)));
    else if (s->time_s > 0)
        ; /* the count is what the time allows */
    else
        json_put_integer(set, "/sampling/count", (int64_t)to.count);
    if (memory_mb > limit_mb) json_put_integer(set, "/limits/memory_mb", (int64_t)rounded_up(memory_mb));
}

// SPDX-License-Identifier: Apache-2.0
#include "job/phases/weights.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "job/report/patch_report.h"
#include "sampling/voronoi/triangulation.h"
#include "sampling/weights/quadrature.h"

static const char what[] = "the quadrature weights";

/* Word for why the surface does not permit weights of high order; NULL: it does. */
static const char *obstacle(const weights_input *in)
{
    const source *from = in->source;
    const source_part *leaf = &from->whole;
    while (leaf->part_count == 1) leaf = leaf->parts;
    return leaf->mesh || leaf->labels || (leaf->volume && volume_faces(leaf->volume)) ? "mesh"
           : leaf->part_count > 0                                                     ? "combination"
           : in->spec->has_region                                                     ? "region"
           : from->field->sharp || from->field->patches                               ? "crease"
           : from->field->open                                                        ? "border"
           : in->measures->coincident > 0                                             ? "coincident"
                                                                                      : NULL;
}

/* Maximum sum of the magnitudes of weights of high order over their sum. Errors of values grow by this factor. */
static const double MOST_MAGNITUDE = 1.5;
/* Relative error of the area of a scan. */
static const double AREA_ACCURACY = 1e-5;

/* Word for why weights of high order are worse than areas of cells; NULL: they are not. `cells`: the sum of the cells
 * as they are measured, before they are multiplied by factors. */
static const char *shortcoming(const double *weight, size_t count, double area, double cells)
{
    double sum = 0, magnitude = 0;
    for (size_t i = 0; i < count; i++) {
        sum += weight[i];
        magnitude += fabs(weight[i]);
    }
    return !(magnitude <= MOST_MAGNITUDE * sum)                                ? "unstable"
           : fabs(sum - area) > fmax(fabs(cells - area), AREA_ACCURACY * area) ? "area"
                                                                               : NULL;
}

/* Sets the weights of high order, or a word for why there are none. */
static bool take_high_order(const weights_input *of, threads *pool, weights *w, error *e)
{
    const solver_points *p = of->points;
    const measures *m = of->measures;
    static const char *const reasons[] = {[QUADRATURE_COMPLETE] = NULL,
                                          [QUADRATURE_FEW_NODES] = "few_nodes",
                                          [QUADRATURE_SINGULAR] = "singular"};
    const triangulation_input sites = {
        .count = p->count, .position = p->position, .normal = p->normal, .spacing = p->spacing};
    triangulation made = {0};
    quadrature_end end;
    bool ok = triangulation_make(&sites, pool, &made, e);
    if (ok && !triangulation_is_closed(&made.facts))
        w->reason = "triangulation";
    else if (ok) {
        const quadrature_input in = {p->count, p->position, p->normal, made.facts.triangles,
                                     (const uint32_t(*)[3])made.corner};
        const bool narrow = threads_narrow(pool, false); /* few points have many systems */
        ok = quadrature_make(&in, pool, w->value, &w->lower_area, &end, e);
        threads_narrow(pool, narrow);
        w->reason = reasons[end];
        if (ok && !w->reason)
            w->reason = shortcoming(w->value, p->count, of->area - m->area_without_points, m->cell_area);
    }
    triangulation_free(&made);
    return ok;
}

static bool take_cells(const measures_input *cells, threads *pool, weights *w, error *e)
{
    measures_input in = *cells;
    measures found;
    double *local = mem_array(in.count, sizeof *local, what, e),
           *farthest = mem_array(in.surface.patch_count, sizeof *farthest, what, e);
    in.exact = true;
    in.out_weight = w->value;
    const bool ok = local && farthest && measures_take(&in, pool, local, NULL, farthest, &found, e);
    w->lower_area = NAN;
    free(local);
    free(farthest);
    return ok;
}

static bool sum_up(const field_patches *patches, const solver_points *p, weights *w, error *e)
{
    w->patches = patches ? patches->count : 1;
    w->patch_sum = mem_array(w->patches, sizeof *w->patch_sum, what, e);
    w->least = INFINITY;
    for (size_t i = 0; w->patch_sum && i < p->count; i++) {
        w->area += w->value[i];
        w->least = fmin(w->least, w->value[i]);
        w->normal_sum = vec3_axpy(w->value[i], p->normal[i], w->normal_sum);
        w->patch_sum[p->patch ? p->patch[i] : 0] += w->value[i];
    }
    return w->patch_sum != NULL;
}

bool weights_find(const weights_input *in, threads *pool, weights *out, error *e)
{
    const solver_points *p = in->points;
    weights w = {.reason = obstacle(in),
                 .value = mem_array(p->count, sizeof *w.value, what, e),
                 .area_without_points = in->measures->area_without_points};
    const bool ok = w.value && (w.reason || take_high_order(in, pool, &w, e)) &&
                    (!w.reason || take_cells(in->cells, pool, &w, e)) &&
                    sum_up(in->source->field->patches, p, &w, e);
    weights_free(out);
    *out = w;
    return ok;
}

/* Warns that the weights are areas of cells although the surface permits weights of high order. */
static void warn_of_points(const weights *w, json *report)
{
    static const struct {
        const char *reason, *found;
    } rows[] = {
        {"few_nodes", "the surface bends too much between the points, or a piece of it has too few points"},
        {"triangulation", "the triangles between the points do not form a closed surface"},
        {"singular", "points around a triangle do not determine them"},
        {"unstable",
         "the points are so unevenly spread that the magnitudes of weights would exceed their sum by half"},
        {"area", "their sum would differ from the area by more than that of the cells"},
    };
    json *warnings = json_find(report, "/surface/warnings");
    for (size_t k = 0; w->reason && warnings && k < sizeof rows / sizeof *rows; k++) {
        if (strcmp(w->reason, rows[k].reason) != 0) continue;
        char *text =
            mem_printf("the weights are areas of cells and not of high order: %s. Increase the number of "
                       "points, or set a smaller spacing.",
                       rows[k].found);
        json_append_string(warnings, text);
        free(text);
    }
}

void weights_describe(const weights *w, json *report)
{
    if (!w->value) return;
    warn_of_points(w, report);
    json *object = json_put_object(report, "weights");
    json_put_string(object, "kind", w->reason ? "cells" : "high_order");
    json_put_string(object, "reason", w->reason);
    json_put_number(object, "sum", w->area);
    json *list = json_put_array(object, "patches");
    for (size_t k = 0; k < w->patches && k < PATCH_REPORT_LISTED; k++)
        json_append_number(list, w->patch_sum[k]);
    json_put_number(object, "area_without_points", w->area_without_points);
    json_put_number(object, "least", w->least);
    json_put_number(object, "degree_difference", w->lower_area / w->area - 1);
    json_put_number(object, "normal_integral", vec3_norm(w->normal_sum) / w->area);
}

void weights_free(weights *w)
{
    free(w->value);
    free(w->patch_sum);
    *w = (weights){0};
}

// SPDX-License-Identifier: Apache-2.0
#include "job/report/patch_report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "sampling/solver/curves/curve_chains.h"

/* Maximum number of patches at a curve whose labels are listed. */
enum { MOST_AROUND = 8 };

/* The input of the report. */
typedef struct rows {
    const field_patches *patches;
    const solver_points *solved;
    const label_surface *labels; /* or NULL */
    curve_chains chains;
} rows;

/* Measures of a curve. A step is the distance between consecutive points over the requested spacing. */
typedef struct row {
    size_t points, steps;
    double sum, square, gap;
    uint32_t last; /* the last point visited, if there is one */
} row;

static void visit(const rows *r, uint32_t point, row *out)
{
    const solver_points *solved = r->solved;
    if (out->points++ > 0) {
        const double length = vec3_norm(vec3_sub(solved->position[point], solved->position[out->last])),
                     one = solved->spacing[point], other = solved->spacing[out->last],
                     step = length / (0.5 * (one + other));
        if (!curve_chains_jumps(r->patches, length, one, other)) {
            out->steps++;
            out->sum += step;
            out->square += step * step;
            out->gap = fmax(out->gap, step);
        }
    }
    out->last = point;
}

static row measure_curve(const rows *r, size_t c, double length, double h)
{
    const size_t begin = r->chains.first[c], end = r->chains.first[c + 1];
    row out = {0};
    for (size_t k = begin; k < end; k++) visit(r, r->chains.point[k], &out);
    if (r->patches->curve[c].closed && out.points > 1) {
        visit(r, r->chains.point[begin], &out);
        out.points--; /* the first point was counted twice */
    }
    const double spacing = out.points > 0 ? r->solved->spacing[out.last] : h;
    if (out.steps == 0 && !curve_chains_jumps(r->patches, length, spacing, spacing))
        out.gap = length / spacing;
    return out;
}

/* Coefficient of variation of the steps; NaN for fewer than two. */
static double variation(const row *r)
{
    double mean = r->sum / (double)r->steps;
    return r->steps < 2 ? NAN : sqrt(fmax(r->square / (double)r->steps - mean * mean, 0)) / mean;
}

/* Adds the labels that meet at a curve, each once. */
static void put_labels(const label_surface *labels, const field_patches *p, const field_curve *c,
                       json *object)
{
    int64_t known[2 * MOST_AROUND];
    size_t count = 0;
    json *list = json_put_array(object, "labels");
    for (size_t k = 0; k < 2 * c->patch_count && count < 2 * MOST_AROUND; k++) {
        int64_t sides[2];
        bool is_first = true;
        label_surface_sides(labels, p->curve_patch[c->patch_first + k / 2], sides);
        for (size_t i = 0; i < count; i++) is_first &= known[i] != sides[k % 2];
        if (!is_first) continue;
        known[count++] = sides[k % 2];
        json_append_number(list, (double)sides[k % 2]);
    }
}

static void put_curve(json *list, const rows *all, const field_curve *c, const row *r, double length)
{
    const field_patches *p = all->patches;
    json *object = json_append_object(list);
    json_put_number(object, "length", length);
    json_put_bool(object, "closed", c->closed);
    json_put_integer(object, "points", (int64_t)r->points);
    json_put_number(object, "edge_cv", variation(r));
    json_put_number(object, "gap", r->gap);
    json *patches = json_put_array(object, "patches");
    for (size_t k = 0; k < c->patch_count; k++)
        json_append_number(patches, p->curve_patch[c->patch_first + k]);
    if (all->labels) put_labels(all->labels, p, c, object);
}

static void put_curves(const rows *r, double h, json *report)
{
    const field_patches *p = r->patches;
    json *object = json_put_object(report, "curves"), *list = NULL;
    double total = 0, worst = NAN, gap = 0;
    size_t points = r->chains.points - r->chains.corners;
    json_put_integer(object, "count", (int64_t)p->curve_count);
    list = json_put_array(object, "list");
    for (size_t c = 0; c < p->curve_count; c++) {
        double length = curve_chains_length(p, &p->curve[c]);
        const row found = measure_curve(r, c, length, h);
        total += length;
        worst = fmax(worst, variation(&found)); /* fmax ignores NaN */
        gap = fmax(gap, found.gap);
        if (c < PATCH_REPORT_LISTED) put_curve(list, r, &p->curve[c], &found, length);
    }
    json_put_number(object, "length", total);
    json_put_integer(object, "points", (int64_t)points);
    json_put_integer(object, "corners", (int64_t)r->chains.corners);
    json_put_number(object, "edge_cv", worst);
    json_put_number(object, "gap", gap);
}

static void put_patches(const rows *r, const double *farthest, json *report)
{
    const field_patches *p = r->patches;
    const solver_patch_points *stands = &r->solved->patch_points;
    json *object = json_put_object(report, "patches");
    size_t *points = mem_alloc(p->count * sizeof *points);
    double gap = 0;
    for (size_t k = 0; k < stands->count; k++) points[stands->patch[k]]++;
    json_put_integer(object, "count", (int64_t)p->count);
    json *list = json_put_array(object, "list");
    for (size_t k = 0; k < p->count; k++) {
        gap = fmax(gap, farthest[k]);
        if (k >= PATCH_REPORT_LISTED) continue;
        json *item = json_append_object(list);
        json_put_number(item, "area", p->patch[k].area);
        json_put_integer(item, "points", (int64_t)points[k]);
        json_put_number(item, "gap", farthest[k]);
        if (r->labels) {
            int64_t sides[2];
            label_surface_sides(r->labels, (uint32_t)k, sides);
            json *labels = json_put_array(item, "labels");
            for (int i = 0; i < 2; i++) json_append_number(labels, (double)sides[i]);
        }
    }
    json_put_number(object, "gap", gap);
    free(points);
}

void patch_report_put(const field_patches *patches, const solver_points *solved, const double *farthest,
                      double h, const label_surface *labels, json *report)
{
    rows r = {.patches = patches, .solved = solved, .labels = labels};
    curve_chains_make(patches, solved, &r.chains);
    put_patches(&r, farthest, report);
    put_curves(&r, h, report);
    curve_chains_free(&r.chains);
}

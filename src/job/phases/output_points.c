// SPDX-License-Identifier: Apache-2.0
#include "job/phases/output_points.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "base/core/precision.h"
#include "job/phases/chord_error.h"
#include "job/phases/points_mesh.h"
#include "job/report/outcome.h"
#include "sampling/solver/curves/curve_chains.h"
#include "surface/field/patches.h"

static vec3 as_floats(vec3 x)
{
    return vec3_make(precision_as_float(x.x), precision_as_float(x.y), precision_as_float(x.z));
}

/* Points in a chunk of work. */
enum { GRAIN = 4096 };

typedef struct residual_job {
    const field *field;
    const points *set;
    const bool *kept;
    bool as_float;
    double *worst, *sum2; /* per chunk: maximum and sum of squares of |F| / |grad F| */
} residual_job;

static void residual_chunk(void *context, int worker, size_t begin, size_t end)
{
    const residual_job *job = context;
    double worst = 0, sum2 = 0;
    uint32_t hint = FIELD_NO_HINT;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        vec3 x = job->set->position[i];
        if (job->kept && job->kept[i]) continue;
        if (job->as_float) x = as_floats(x);
        field_sample s = {0};
        double length =
            field_sample_near(job->field, x, FIELD_GRADIENT, &hint, &s) ? vec3_norm(s.gradient) : 0;
        const double off = length > 0 ? fabs(s.value) / length : INFINITY;
        worst = fmax(worst, off);
        sum2 += off * off;
    }
    job->worst[begin / GRAIN] = worst;
    job->sum2[begin / GRAIN] = sum2;
}

/* Measures the residuals of the positions, rounded to floats or not, over h. */
static void measure_residuals(const results_input *in, bool as_float, threads *pool, report_outputs *out)
{
    if (!in->field) return;
    const size_t chunks = in->set->count / GRAIN + 1;
    size_t measured = in->set->count;
    for (size_t i = 0; in->kept && i < in->set->count; i++) measured -= in->kept[i];
    residual_job job = {in->field,
                        in->set,
                        in->kept,
                        as_float,
                        mem_alloc(chunks * sizeof *job.worst),
                        mem_alloc(chunks * sizeof *job.sum2)};
    double worst = 0, sum2 = 0;
    threads_run(pool, in->set->count, GRAIN, residual_chunk, &job);
    for (size_t k = 0; k < chunks; k++) {
        worst = fmax(worst, job.worst[k]);
        sum2 += job.sum2[k];
    }
    free(job.worst);
    free(job.sum2);
    out->max_residual = worst / in->h;
    out->rms_residual = sqrt(sum2 / (double)measured) / in->h;
}

typedef struct rounding_job {
    const points *set;
    vec3 origin;
    double *worst; /* maximum of each chunk */
} rounding_job;

static void rounding_chunk(void *context, int worker, size_t begin, size_t end)
{
    const rounding_job *job = context;
    double worst = 0;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const vec3 x = vec3_sub(job->set->position[i], job->origin);
        worst = fmax(worst, vec3_norm(vec3_sub(x, as_floats(x))));
    }
    job->worst[begin / GRAIN] = worst;
}

/* The largest error of floats relative to the origin, over h. */
static double largest_rounding(const points *set, vec3 origin, double h, threads *pool)
{
    const size_t chunks = set->count / GRAIN + 1;
    rounding_job job = {set, origin, mem_alloc(chunks * sizeof *job.worst)};
    double worst = 0;
    threads_run(pool, set->count, GRAIN, rounding_chunk, &job);
    for (size_t k = 0; k < chunks; k++) worst = fmax(worst, job.worst[k] / h);
    free(job.worst);
    return worst;
}

vec3 output_points_origin(const points *set)
{
    bbox box = bbox_empty();
    for (size_t i = 0; i < set->count; i++) box = bbox_include(box, set->position[i]);
    vec3 middle = vec3_scale(vec3_add(box.min, box.max), 0.5);
    const double step = bbox_longest(box) > 0 ? elementary_exp2(ceil(elementary_log2(bbox_longest(box)))) : 0;
    for (int k = 0; step > 0 && k < 3; k++) vec3_set(&middle, k, step * round(vec3_get(middle, k) / step));
    return middle;
}

quantity_look output_points_look(const spec *s)
{
#define SHOWN(prefix, name, word) [SPEC_COLOR_##name] = prefix##_##name,
    static const quantity shown[] = {SPEC_COLOR_LIST(SHOWN, QUANTITY)};
#undef SHOWN
#define MAP(prefix, name, word) [SPEC_MAP_COLORS_##name] = prefix##_##name,
    static const colormap_map maps[] = {SPEC_MAP_COLORS_LIST(MAP, COLORMAP)};
#undef MAP
    quantity_look look = {.which = shown[s->preview_color], .map = maps[s->preview_map]};
    if (s->preview_range_count > 0) {
        look.low = s->preview_range[0];
        look.high = s->preview_range[1];
    } else if (look.which == QUANTITY_SPACING && s->frame_count > 0 && s->min_spacing < s->max_spacing) {
        look.low = s->min_spacing; /* the same scale for all frames, from the spec alone */
        look.high = s->max_spacing;
    }
    return look;
}

/* The look of the points' own colours: the pictures' map, and their range if both show the same quantity. */
static quantity_look look_of_points(const spec *s)
{
    quantity_look look = {.which = s->has_alpha ? QUANTITY_ALPHA : QUANTITY_CURVATURE};
    if (!s->has_preview) return look;
    const quantity_look pictures = output_points_look(s);
    if (pictures.which == look.which) return pictures;
    look.map = pictures.map;
    return look;
}

bool output_points_make(const results_input *in, bool has_color, threads *pool, output_points *out,
                        report_outputs *facts, error *e)
{
    const spec *s = in->spec;
    *out = (output_points){.set = *in->set, .as_float = s->ply_precision == SPEC_PRECISION_FLOAT};
    *facts = (report_outputs){.y_up = in->y_up, .has_mesh = s->has_mesh};
    measure_residuals(in, out->as_float, pool, facts);
    const bool is_coarse = largest_rounding(in->set, (vec3){0, 0, 0}, in->h, pool) > OUTCOME_RESIDUAL;
    if (is_coarse) {
        facts->origin = output_points_origin(in->set);
        facts->rounding = largest_rounding(in->set, facts->origin, in->h, pool);
    }
    if (out->as_float && (is_coarse || !(facts->max_residual <= OUTCOME_RESIDUAL))) {
        out->as_float = false;
        measure_residuals(in, false, pool, facts);
        facts->widened = true;
    }
    if (!instances_make(s, in->set, &out->turned, e)) return false;
    if (s->has_orient) out->set.orient = out->turned.orient;
    const quantity_look look = look_of_points(s);
    if (out->set.color || !has_color || !quantity_values(&out->set, &look)) return true;
    out->color = mem_array(out->set.count, sizeof *out->color, "colors", e);
    if (!out->color || !quantity_colors(&out->set, &look, out->color, e)) return false;
    out->set.color = out->color;
    return true;
}

void output_points_free(output_points *o)
{
    free(o->color);
    instances_free(&o->turned);
    *o = (output_points){0};
}

/* ---- the mesh */

static bool is_within_patch(const void *context, uint32_t label, vec3 x)
{
    return field_is_within(field_of_patch(context, label), x);
}

/* The labels on both sides of each triangle; the caller frees them. */
static int64_t (*labels_of(const triangulation *made, const label_surface *labels, error *e))[2]
{
    int64_t(*out)[2] = mem_array(made->facts.triangles, sizeof *out, "the labels of triangles", e);
    for (size_t k = 0; out && k < made->facts.triangles; k++)
        label_surface_sides(labels, made->label[k], out[k]);
    return out;
}

static bool copy_known(const results_input *in, const triangulation_input *sites, threads *pool,
                       triangulation *out, error *e)
{
    *out = (triangulation){.corner = mem_array(in->corners, sizeof *out->corner, "mesh.ply", e),
                           .facts.triangles = in->corners};
    if (!out->corner) return false;
    memcpy(out->corner, in->corner, in->corners * sizeof *out->corner);
    return triangulation_survey(sites, pool, out, NULL, e);
}

/* Uses the known triangles. Otherwise triangulates by the points and their normals alone and, if that is not
 * a manifold, repairs it along the triangles of the surface. */
static bool triangulate(const results_input *in, const triangulation_input *sites, threads *pool,
                        triangulation *out, error *e)
{
    error why = {0};
    if (in->corner) return copy_known(in, sites, pool, out, e);
    if (!triangulation_make(sites, pool, out, e)) return false;
    const mesh_patches *patches = in->labels && in->sampled == label_surface_field(in->labels)
                                      ? label_surface_patches(in->labels)
                                      : NULL;
    if (!(in->triangles || patches) || triangulation_is_manifold(&out->facts)) return true;
    if (points_mesh_repair(sites, in->triangles, patches, pool, out, &why) || why.code == ERROR_LIMIT_MEMORY)
        return true; /* keep the present triangulation */
    if (e) *e = why;
    return false;
}

/* Replaces indices in the order of the solver by indices in the order of the outputs. The lowest index of a
 * triangle comes first, as in triangulation.h. */
static void renumber(triangulation *made, const uint32_t *place)
{
    for (size_t k = 0; k < made->facts.triangles; k++) {
        uint32_t *c = made->corner[k];
        const uint32_t to[3] = {place[c[0]], place[c[1]], place[c[2]]};
        const int first = to[0] < to[1] ? (to[0] < to[2] ? 0 : 2) : to[1] < to[2] ? 1 : 2;
        for (int corner = 0; corner < 3; corner++) c[corner] = to[(first + corner) % 3];
    }
}

bool output_mesh_make(const results_input *in, const points *set, threads *pool, output_mesh *out,
                      report_outputs *facts, error *e)
{
    const solver_patch_points *stands = &in->solved->patch_points;
    const field_patches *patches = in->sampled->patches;
    size_t side_count = 0;
    *out = (output_mesh){.vertices = *set};
    out->side = patches ? curve_chains_steps(patches, in->solved, &side_count) : NULL;
    const triangulation_input sites = {.count = stands->count,
                                       .position = stands->position,
                                       .normal = stands->normal,
                                       .spacing = stands->spacing,
                                       .open = in->sampled->open,
                                       .domain = in->sampled->boundary_box,
                                       .label = stands->patch,
                                       .flags = stands->flags,
                                       .point = stands->point,
                                       .points = set->count,
                                       .side = (const uint32_t(*)[2])out->side,
                                       .side_count = side_count,
                                       .is_within = is_within_patch,
                                       .context = in->sampled};
    if (!triangulate(in, &sites, pool, &out->made, e)) return false;
    if (in->place) renumber(&out->made, in->place);
    out->vertices.triangle_count = out->made.facts.triangles;
    out->vertices.triangle = (const uint32_t(*)[3])out->made.corner;
    if (in->labels && !(out->labels = labels_of(&out->made, in->labels, e))) return false;
    out->vertices.triangle_labels = (const int64_t(*)[2])out->labels;
    facts->mesh = out->made.facts;
    if (in->field && in->spec->curvature.chord_error > 0)
        facts->chord_error = chord_error_largest(in->field, set->position, out->vertices.triangle,
                                                 out->vertices.triangle_count, in->h, pool);
    return true;
}

void output_mesh_free(output_mesh *m)
{
    free(m->labels);
    triangulation_free(&m->made);
    free(m->side);
    *m = (output_mesh){0};
}

// SPDX-License-Identifier: Apache-2.0
#include "job/phases/results.h"

#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "base/core/precision.h"
#include "surface/field/patches.h"
#include "io/points/column.h"
#include "io/points/ply.h"
#include "io/points/property.h"
#include "io/points/quantity.h"
#include "io/points/writers.h"
#include "job/phases/chord_error.h"
#include "job/phases/instances.h"
#include "job/phases/label_meshes.h"
#include "job/phases/layout.h"
#include "job/phases/fault_repair.h"
#include "job/phases/patch_meshes.h"
#include "job/phases/outputs.h"
#include "job/phases/pictures.h"
#include "job/phases/snapshot.h"
#include "job/report/outcome.h"
#include "sampling/solver/curves/curve_chains.h"
#include "files/file.h"
#include "files/late_commit.h"
#include "io/vdb/vdb.h"

#define LABEL_NAME "mesh_label_%lld.ply"

/* Names of results other than those of the table of formats and of turntables. */
static const char *const names[] = {
    "report.json",       WORKER_SUMMARY_NAME, "points.ply",      "points.vdb",         "mesh.ply",
    WORKER_PREVIEW_NAME, "preview.exr",       "convergence.png", WORKER_SNAPSHOT_NAME, SNAPSHOT_PART_NAME};
enum { NAMES = sizeof names / sizeof names[0] };

/* Voxel size of points.vdb, in spacings. */
static const double POINTS_VOXEL = 3;

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

/* An origin near the centre, rounded to steps of about the longest side. Frames of a sequence that move less
 * mostly have the same origin, so that programs that interpolate translations between frames do not change
 * it. */
static vec3 origin_of(const points *set)
{
    bbox box = bbox_empty();
    for (size_t i = 0; i < set->count; i++) box = bbox_include(box, set->position[i]);
    vec3 middle = vec3_scale(vec3_add(box.min, box.max), 0.5);
    const double step = bbox_longest(box) > 0 ? exp2(ceil(log2(bbox_longest(box)))) : 0;
    for (int k = 0; step > 0 && k < 3; k++) vec3_set(&middle, k, step * round(vec3_get(middle, k) / step));
    return middle;
}

/* Writes points.ply or a mesh; `job` has the points, and is completed here. With `beside` it is written by
 * another thread while other outputs are written, if it is large enough and binary: text uses all threads. */
static late_commit *begin_ply(const char *directory, const char *name, const spec *s, bool as_float,
                              threads *pool, bool beside, ply_job *job, error *e)
{
    char *path = mem_printf("%s/%s", directory, name);
    store_file file = {0};
    job->format = s->ply_format == SPEC_PLY_ASCII ? PLY_ASCII : PLY_BINARY_LITTLE_ENDIAN;
    job->precision = as_float ? PLY_FLOAT : PLY_DOUBLE;
    beside = beside && job->format != PLY_ASCII && job->set->count > GRAIN && threads_count(pool) > 1;
    job->pool = beside ? threads_beside(pool) : pool;
    const char *const *wanted = (const char *const *)s->ply_properties;
    const bool ok = columns_choose(job->set, wanted, s->ply_property_count, &job->what, e) &&
                    store_file_begin_hashed(path, &file, e);
    free(path);
    return ok ? late_commit_begin(&file, ply_write_job, job, beside) : NULL;
}

static bool write_ply(const char *directory, const char *name, const spec *s, const points *set,
                      bool as_float, threads *pool, json *outputs, error *e)
{
    ply_job job = {.set = set};
    store_facts facts;
    late_commit *begun = begin_ply(directory, name, s, as_float, pool, false, &job, e);
    if (!begun || !late_commit_end(begun, &facts, e)) return false;
    outputs_put_facts(outputs_add(outputs, name), &facts);
    return true;
}

static bool write_format(const char *directory, file_format format, writer_part part, const points *set,
                         const scene *place, bool of_mesh, json *outputs, error *e)
{
    const writer *w = &writers[format];
    char *name = writers_name(format, part, of_mesh), *path = mem_printf("%s/%s", directory, name);
    store_file file = {0};
    const bool ok = store_file_begin_hashed(path, &file, e) && w->write[part](file.stream, set, place, e) &&
                    outputs_commit(&file, name, outputs, e);
    store_file_abort(&file);
    free(path);
    free(name);
    return ok;
}

/* Writes the formats of points, or of their mesh. A file of a whole sequence is written by the frame
 * listed first. */
static bool write_formats(const char *directory, const results_input *in, const points *set, bool of_mesh,
                          vec3 origin, json *outputs, error *e)
{
    const spec *s = in->spec;
    layout frames = {0};
    bool ok =
        s->frame_count == 0 || layout_make(s->directory, s->frame, s->frame_count, in->frame, &frames, e);
    const scene place = {in->y_up,  origin,        NULL,           frames.count,
                         in->frame, frames.frames, frames.folders, frames.below};
    scene instanced = place; /* instances always have an origin: that of the scene, or origin_of */
    if (in->instancer) {
        instanced.instancer = in->instancer;
        if (vec3_norm(origin) == 0) instanced.origin = origin_of(set);
    }
    const bool *asked = of_mesh ? s->mesh_in : s->points_in;
    const int parts = s->frame_count > 0 && s->frame[0] == in->frame ? WRITER_PARTS : WRITER_SEQUENCE;
    for (int k = 0; k < FILE_FORMATS; k++)
        for (int part = 0; ok && asked[k] && part < parts; part++)
            ok =
                !writers[k].write[part] ||
                write_format(directory, (file_format)k, (writer_part)part, set,
                             writers[k].has_instances && !of_mesh ? &instanced : &place, of_mesh, outputs, e);
    layout_free(&frames);
    return ok;
}

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

static void describe_label_mesh(json *list, int64_t label, const char *name, const label_mesh_part *part)
{
    json *told = json_append_object(list);
    json_put_integer(told, "label", label);
    json_put_string(told, "name", name);
    json_put_integer(told, "triangles", (int64_t)part->set.triangle_count);
    json_put_integer(told, "open_edges", (int64_t)part->open_edges);
    json_put_integer(told, "nonmanifold_edges", (int64_t)part->nonmanifold_edges);
    json_put_number(told, "volume", part->volume);
}

/* Writes a mesh for each label that has triangles. */
static bool write_label_meshes(const char *directory, const results_input *in, const points *whole,
                               bool as_float, threads *pool, json *outputs, json *told, error *e)
{
    static const char *const properties[] = {"x", "y", "z", "point"};
    spec how = *in->spec;
    int64_t labels[LABEL_MESHES_MOST];
    const size_t count = label_surface_labels(in->labels, LABEL_MESHES_MOST, labels);
    bool ok = true;
    how.ply_properties = (char **)properties;
    how.ply_property_count = sizeof properties / sizeof *properties;
    for (size_t k = 0; ok && k < count; k++) {
        label_mesh_part part;
        char *name = mem_printf(LABEL_NAME, (long long)labels[k]);
        ok = label_mesh_part_make(whole, labels[k], &part, e);
        if (ok && part.set.triangle_count > 0) {
            ok = write_ply(directory, name, &how, &part.set, as_float, pool, outputs, e);
            describe_label_mesh(told, labels[k], name, &part);
        }
        label_mesh_part_free(&part);
        free(name);
    }
    return ok;
}

/* Maximum points of a segmentation for a repair of its patches: the pieces of the mesh would take
 * gigabytes. */
static const size_t most_of_patches = 200000;

static bool copy_known(const results_input *in, const triangulation_input *sites, threads *pool,
                       triangulation *out, error *e)
{
    *out = (triangulation){.corner = mem_array(in->corners, sizeof *out->corner, "mesh.ply", e),
                           .facts.triangles = in->corners};
    if (!out->corner) return false;
    memcpy(out->corner, in->corner, in->corners * sizeof *out->corner);
    return triangulation_survey(sites, pool, out, e);
}

/* Uses the known triangles. Otherwise triangulates by the points and their normals alone and, if that is not
 * a manifold, repairs it along the mesh. */
static bool triangulate(const results_input *in, const triangulation_input *sites, threads *pool,
                        triangulation *out, error *e)
{
    error why = {0};
    if (in->corner) return copy_known(in, sites, pool, out, e);
    if (!triangulation_make(sites, pool, out, e)) return false;
    const bool on_patches =
        in->labels && in->sampled == label_surface_field(in->labels) && sites->count <= most_of_patches;
    if (!(in->triangles || on_patches) || triangulation_is_manifold(&out->facts)) return true;
    const bool ok = on_patches
                        ? patch_meshes_repair(sites, label_surface_patches(in->labels), pool, out, &why)
                        : fault_repair_along(sites, in->triangles, pool, out, &why);
    if (ok || why.code == ERROR_LIMIT_MEMORY) return true; /* keep the present triangulation */
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

static bool write_mesh(const char *directory, const results_input *in, bool as_float, threads *pool,
                       json *outputs, report_outputs *out, error *e)
{
    const points *set = in->set;
    const solver_patch_points *stands = &in->solved->patch_points;
    const field_patches *patches = in->sampled->patches;
    size_t side_count = 0;
    uint32_t(*side)[2] = patches ? curve_chains_steps(patches, in->solved, &side_count) : NULL;
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
                                       .side = (const uint32_t(*)[2])side,
                                       .side_count = side_count,
                                       .is_within = is_within_patch,
                                       .context = in->sampled};
    triangulation made;
    int64_t(*labels)[2] = NULL;
    points vertices = *set;
    bool ok = triangulate(in, &sites, pool, &made, e);
    if (ok && in->place) renumber(&made, in->place);
    vertices.triangle_count = made.facts.triangles;
    vertices.triangle = (const uint32_t(*)[3])made.corner;
    if (ok && in->labels) {
        ok = (labels = labels_of(&made, in->labels, e)) != NULL;
        vertices.triangle_labels = (const int64_t(*)[2])labels;
    }
    ok = ok && write_ply(directory, "mesh.ply", in->spec, &vertices, as_float, pool, outputs, e);
    ok = ok && write_formats(directory, in, &vertices, true, out->origin, outputs, e);
    if (ok && in->spec->has_label_meshes)
        ok = write_label_meshes(directory, in, &vertices, as_float, pool, outputs,
                                out->label_meshes = json_new_array(), e);
    if (ok) out->mesh = made.facts;
    if (ok && in->field && in->spec->curvature.chord_error > 0)
        out->chord_error = chord_error_largest(in->field, set->position, vertices.triangle,
                                               vertices.triangle_count, in->h, pool);
    free(labels);
    triangulation_free(&made);
    free(side);
    return ok;
}

static bool has_attribute(const points *set, const char *name)
{
    return property_find_attribute(set->attributes, set->attribute_count, name) != NULL;
}

/* Renames attributes for readers of VDB points: v is the velocity (an attribute of a file takes precedence
 * over the velocity between frames), Cd the color. */
static vdb_point_values *name_values(const points *set, bool *has_velocity)
{
    /* one more: the row numbers */
    vdb_point_values *values = mem_alloc((set->attribute_count + 1) * sizeof *values);
    bool has_color = has_attribute(set, "Cd");
    *has_velocity = has_attribute(set, "v");
    for (size_t k = 0; k < set->attribute_count; k++) {
        const point_attribute *a = &set->attributes[k];
        const char *name = a->name;
        if (!*has_velocity && property_is_velocity(a)) {
            name = "v";
            *has_velocity = true;
        } else if (!has_color && a->kind == POINT_ATTRIBUTE_COLOR) {
            name = "Cd";
            has_color = true;
        }
        values[k] =
            (vdb_point_values){name, a->components, a->kind == POINT_ATTRIBUTE_INT, a->is_double, a->values};
    }
    return values;
}

/* The row of each point in the other outputs: a points grid is ordered by voxels, and the ids of a sequence
 * are not rows. The caller frees the array. */
static double *rows_of(const points *set, error *e)
{
    double *rows = mem_array(set->count, sizeof *rows, "points.vdb", e);
    for (size_t i = 0; rows && i < set->count; i++) rows[i] = (double)i;
    return rows;
}

/* A voxel contains about ten points where the spacing is uniform. */
static bool write_points_vdb(const char *directory, const results_input *in, json *outputs, error *e)
{
    const points *set = in->set;
    bool has_velocity;
    vdb_point_values *values = name_values(set, &has_velocity);
    size_t value_count = set->attribute_count;
    double *rows = NULL;
    const bool needs_rows = in->spec->has_order && set->id;
    if (needs_rows && (rows = rows_of(set, e)))
        values[value_count++] = (vdb_point_values){"row", 1, true, false, rows};
    const vdb_points grid = {.count = set->count,
                             .position = &set->position[0].x,
                             .normal = &set->normal[0].x,
                             .spacing = set->spacing_local,
                             .voxel_size = POINTS_VOXEL * in->h,
                             .id = set->id,
                             .orient = set->orient,
                             .velocity = set->velocity && !has_velocity ? &set->velocity[0].x : NULL,
                             .value_count = value_count,
                             .values = values};
    char *path = mem_printf("%s/points.vdb", directory);
    store_file file = {0};
    const bool ok = (rows || !needs_rows) && store_file_begin_hashed(path, &file, e) &&
                    vdb_write_points(file.stream, &grid, e) &&
                    outputs_commit(&file, "points.vdb", outputs, e);
    store_file_abort(&file);
    free(values);
    free(rows);
    free(path);
    return ok;
}

/* The look of pictures; values of an attribute are added later. */
static quantity_look look_of(const spec *s)
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
    const quantity_look pictures = look_of(s);
    if (pictures.which == look.which) return pictures;
    look.map = pictures.map;
    return look;
}

static bool write_pictures(const char *directory, const results_input *in, threads *pool, json *outputs,
                           error *e)
{
    const quantity_look look = look_of(in->spec);
    return pictures_write_preview(directory, in, &look, pool, outputs, e);
}

/* Whether a requested format has colors even without a color attribute. */
static bool needs_color(const spec *s)
{
    for (int k = 0; k < FILE_FORMATS; k++)
        if (writers[k].has_colors && (s->points_in[k] || s->mesh_in[k])) return true;
    return columns_need_color((const char *const *)s->ply_properties, s->ply_property_count);
}

bool results_write(const char *directory, const results_input *in, threads *pool, json *outputs,
                   report_outputs *out, error *e)
{
    const spec *s = in->spec;
    bool as_float = s->ply_precision == SPEC_PRECISION_FLOAT;
    report_outputs facts = {.y_up = in->y_up, .has_mesh = s->has_mesh};
    measure_residuals(in, as_float, pool, &facts);
    const bool is_coarse = largest_rounding(in->set, (vec3){0, 0, 0}, in->h, pool) > OUTCOME_RESIDUAL;
    if (is_coarse) {
        facts.origin = origin_of(in->set);
        facts.rounding = largest_rounding(in->set, facts.origin, in->h, pool);
    }
    if (as_float && (is_coarse || !(facts.max_residual <= OUTCOME_RESIDUAL))) {
        as_float = false;
        measure_residuals(in, false, pool, &facts);
        facts.widened = true;
    }
    points colored = *in->set;
    results_input with_color = *in;
    store_facts ply;
    ply_job job = {.set = &colored, .comments = in->comments};
    json *const told = outputs_add(outputs, "points.ply");
    vec3 *color = NULL;
    instances turned = {0};
    with_color.set = &colored;
    if (!instances_make(s, in->set, &turned, e)) {
        instances_free(&turned);
        return false;
    }
    if (s->has_orient) colored.orient = turned.orient;
    if (s->has_instancer) with_color.instancer = &turned.scene;
    if (!colored.color && needs_color(s)) {
        colored.color = color = mem_array(colored.count, sizeof *color, "colors", e);
        const quantity_look look = look_of_points(s);
        if (!color || !quantity_colors(&colored, &look, color, e)) {
            free(color);
            instances_free(&turned);
            return false;
        }
    }
    late_commit *late =
        begin_ply(directory, "points.ply", s, as_float, pool, spec_has_other_outputs(s), &job, e);
    bool ok = late &&
              (!s->points_in[FILE_FORMAT_VDB] || write_points_vdb(directory, &with_color, outputs, e)) &&
              write_formats(directory, &with_color, &colored, false, facts.origin, outputs, e) &&
              (!s->has_mesh || write_mesh(directory, &with_color, as_float, pool, outputs, &facts, e)) &&
              (!s->has_preview || write_pictures(directory, &with_color, pool, outputs, e)) &&
              (!s->has_convergence || pictures_write_convergence(directory, in, outputs, e));
    if (late) ok = late_commit_end(late, &ply, e) && ok && store_directory_sync(directory, e);
    if (job.pool != pool) threads_free(job.pool);
    free(color);
    instances_free(&turned);
    if (ok) {
        outputs_put_facts(told, &ply);
        *out = facts;
        return true;
    }
    json_free(facts.label_meshes);
    return false;
}

/* Copies members that exist from one object to another. */
static void copy_members(json *from, const char *const *keys, size_t count, json *to)
{
    json_at at = json_root(from);
    for (size_t k = 0; k < count; k++) {
        json_at member = json_member(&at, keys[k]);
        if (member.node) json_put(to, keys[k], json_copy(member.node));
    }
}

/* The summary: the report without its long members. */
static json *new_summary(const json *report)
{
    static const char *const members[] = {"outcome", "count",           "outputs", "inputs",
                                          "ratings", "outcome_reasons", "advice"},
                             *const of_surface[] = {"warnings"};
    json *whole = (json *)(uintptr_t)report, *summary = json_new_object();
    copy_members(whole, members, sizeof members / sizeof *members, summary);
    copy_members(json_find(whole, "/surface"), of_surface, 1, json_put_object(summary, "surface"));
    return summary;
}

static bool write_summary(const char *directory, const json *report, size_t report_bytes, error *e)
{
    char *path = mem_printf("%s/" WORKER_SUMMARY_NAME, directory);
    json *summary = new_summary(report);
    json_put_integer(summary, "report_bytes", (int64_t)report_bytes);
    char *text = json_print(summary);
    FILE *file = fopen(path, "we");
    bool ok = file && fputs(text, file) >= 0;
    if (file) ok &= fclose(file) == 0;
    if (!ok) error_set(e, error_code_of_errno(errno), "cannot write %s: %m", path);
    json_free(summary);
    free(text);
    free(path);
    return ok;
}

bool results_write_report(const char *directory, const json *report, error *e)
{
    char *path = mem_printf("%s/report.json", directory), *text = json_print_pretty(report);
    size_t length = strlen(text);
    store_file file = {0};
    bool ok = write_summary(directory, report, length, e) && store_file_begin_hashed(path, &file, e);
    if (ok) {
        fwrite(text, 1, length, file.stream); /* the flush checks the stream's error flag */
        ok = store_file_place_verified(&file, NULL, e) && store_directory_sync(directory, e);
    }
    free(text);
    free(path);
    return ok;
}

/* Length of the prefix of a name that is a turntable's frame or a label's mesh; 0: none. */
static int numbered_name_length(const char *name)
{
    int number, length = 0;
    long long label;
    if (sscanf(name, "preview.%4d.png%n", &number, &length) == 1 && length > 0) return length;
    return sscanf(name, LABEL_NAME "%n", &label, &length) == 1 ? length : 0;
}

/* Calls `act` for each file in the directory whose name is, or starts with, that of a result. */
static bool for_each_result(const char *directory, bool (*act)(const char *path, error *e), error *e)
{
    bool ok = true;
    for (size_t k = 0; ok && k < NAMES; k++) {
        char *path = mem_printf("%s/%s", directory, names[k]);
        ok = act(path, e);
        free(path);
    }
    for (int k = 0; ok && k < FILE_FORMATS * WRITER_PARTS * 2; k++) {
        const file_format format = (file_format)(k / 2 / WRITER_PARTS);
        const writer_part part = (writer_part)(k / 2 % WRITER_PARTS);
        if (!writers[format].write[part] || (k % 2 == 1 && !writers[format].has_mesh)) continue;
        char *name = writers_name(format, part, k % 2 == 1), *path = mem_printf("%s/%s", directory, name);
        ok = act(path, e);
        free(path);
        free(name);
    }
    DIR *listing = opendir(directory);
    for (struct dirent *entry; listing && ok && (entry = readdir(listing));) {
        int length = numbered_name_length(entry->d_name);
        char *path = mem_printf("%s/%.*s", directory, length, entry->d_name);
        if (length > 0) ok = act(path, e);
        free(path);
    }
    if (listing) closedir(listing);
    return ok;
}

bool results_remove(const char *directory, error *e)
{
    return for_each_result(directory, store_remove, e);
}

static bool clear_unfinished(const char *path, error *e)
{
    (void)e;
    store_file_clear(path);
    return true;
}

void results_clear(const char *directory)
{
    for_each_result(directory, clear_unfinished, NULL);
}

// SPDX-License-Identifier: Apache-2.0
#include "job/phases/results.h"

#include <dirent.h>
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "io/points/column.h"
#include "io/points/ply.h"
#include "io/points/property.h"
#include "io/points/writers.h"
#include "job/phases/label_meshes.h"
#include "job/phases/layout.h"
#include "job/phases/output_points.h"
#include "job/phases/outputs.h"
#include "job/phases/pictures.h"
#include "job/phases/snapshot.h"
#include "files/file.h"
#include "files/late_commit.h"
#include "io/vdb/vdb.h"

#define LABEL_NAME "mesh_label_%lld.ply"
#define CONVERGENCE_NAME "convergence.csv"

/* Names of results other than those of the table of formats and of turntables. */
static const char *const names[] = {
    "report.json",       WORKER_SUMMARY_NAME, "points.ply",     "points.vdb",         "mesh.ply",
    WORKER_PREVIEW_NAME, "preview.exr",       CONVERGENCE_NAME, WORKER_SNAPSHOT_NAME, SNAPSHOT_PART_NAME};
enum { NAMES = sizeof names / sizeof names[0] };

/* A file of at most this many points is written by the calling thread: starting another one takes as long. */
enum { FEW_POINTS = 4096 };

/* Voxel size of points.vdb, in spacings. */
static const double POINTS_VOXEL = 3;

/* Writes points.ply or a mesh; `job` has the points, and is completed here. With `beside` it is written by
 * another thread while other outputs are written, if it is large enough and binary: text uses all threads. */
static late_commit *begin_ply(const char *directory, const char *name, const spec *s, bool as_float,
                              threads *pool, bool beside, ply_job *job, error *e)
{
    char *path = mem_printf("%s/%s", directory, name);
    store_file file = {0};
    job->format = s->ply_format == SPEC_PLY_ASCII ? PLY_ASCII : PLY_BINARY_LITTLE_ENDIAN;
    job->precision = as_float ? PLY_FLOAT : PLY_DOUBLE;
    beside = beside && job->format != PLY_ASCII && job->set->count > FEW_POINTS && threads_count(pool) > 1;
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
    scene instanced = place; /* instances always have an origin: that of the scene, or output_points_origin */
    if (in->instancer) {
        instanced.instancer = in->instancer;
        if (vec3_norm(origin) == 0) instanced.origin = output_points_origin(set);
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

static bool write_mesh(const char *directory, const results_input *in, bool as_float, threads *pool,
                       json *outputs, report_outputs *out, error *e)
{
    output_mesh made;
    bool ok = output_mesh_make(in, in->set, pool, &made, out, e);
    ok = ok && write_ply(directory, "mesh.ply", in->spec, &made.vertices, as_float, pool, outputs, e);
    ok = ok && write_formats(directory, in, &made.vertices, true, out->origin, outputs, e);
    if (ok && in->spec->has_label_meshes)
        ok = write_label_meshes(directory, in, &made.vertices, as_float, pool, outputs,
                                out->label_meshes = json_new_array(), e);
    output_mesh_free(&made);
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

static bool write_pictures(const char *directory, const results_input *in, threads *pool, json *outputs,
                           error *e)
{
    const quantity_look look = output_points_look(in->spec);
    return pictures_write_preview(directory, in, &look, pool, outputs, e);
}

/* Writes a row for each sweep, with the members of `sweeps` of the report. */
static bool write_convergence(const char *directory, const results_input *in, json *outputs, error *e)
{
    char *path = mem_printf("%s/" CONVERGENCE_NAME, directory);
    store_file file = {0};
    bool ok = store_file_begin_hashed(path, &file, e);
    if (ok)
        fputs("sweep,energy,mean_log10_lambda,rms_step,count,sigma,rejected,inserted,deleted\n", file.stream);
    for (size_t k = 0; ok && k < in->sweep_count; k++) {
        const solver_sweep *s = &in->sweeps[k];
        fprintf(file.stream, "%zu,%.17g,%.17g,%.17g,%zu,%.17g,%" PRIu64 ",%zu,%zu\n", k + 1, s->energy,
                s->mean_log10_lambda, s->rms_step, s->count, s->sigma, s->rejected, s->inserted, s->deleted);
    }
    ok = ok && outputs_commit(&file, CONVERGENCE_NAME, outputs, e);
    store_file_abort(&file);
    free(path);
    return ok;
}

/* Whether a requested format has colors even without a color attribute. */
static bool needs_color(const spec *s)
{
    for (int k = 0; k < FILE_FORMATS; k++)
        if (writers[k].has_colors && (s->points_in[k] || s->mesh_in[k])) return true;
    return columns_need_color((const char *const *)s->ply_properties, s->ply_property_count);
}

static bool write_points(void *context, const results_input *in, threads *pool, json *outputs,
                         report_outputs *out, error *e)
{
    const char *directory = context;
    const spec *s = in->spec;
    output_points final;
    report_outputs facts;
    store_facts ply;
    late_commit *late = NULL;
    bool ok = output_points_make(in, needs_color(s), pool, &final, &facts, e);
    ply_job job = {.set = &final.set, .comments = in->comments, .pool = pool};
    results_input whole = *in;
    whole.set = &final.set;
    if (s->has_instancer) whole.instancer = &final.turned.scene;
    json *const told = outputs_add(outputs, "points.ply");
    if (ok)
        late =
            begin_ply(directory, "points.ply", s, final.as_float, pool, spec_has_other_outputs(s), &job, e);
    ok = late && (!s->points_in[FILE_FORMAT_VDB] || write_points_vdb(directory, &whole, outputs, e)) &&
         write_formats(directory, &whole, &final.set, false, facts.origin, outputs, e) &&
         (!s->has_mesh || write_mesh(directory, &whole, final.as_float, pool, outputs, &facts, e)) &&
         (!s->has_preview || write_pictures(directory, &whole, pool, outputs, e)) &&
         (!s->has_convergence || write_convergence(directory, in, outputs, e));
    if (late) ok = late_commit_end(late, &ply, e) && ok && store_directory_sync(directory, e);
    if (job.pool != pool) threads_free(job.pool);
    output_points_free(&final);
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
    static const char *const members[] = {"outcome", "count",   "spacing",         "outputs",
                                          "inputs",  "ratings", "outcome_reasons", "advice"},
                             *const of_surface[] = {"warnings"};
    json *whole = (json *)(uintptr_t)report, *summary = json_new_object();
    copy_members(whole, members, sizeof members / sizeof *members, summary);
    copy_members(json_find(whole, "/surface"), of_surface, 1, json_put_object(summary, "surface"));
    return summary;
}

static bool write_summary(const char *directory, const json *report, const char *printed, error *e)
{
    char *path = mem_printf("%s/" WORKER_SUMMARY_NAME, directory), hex[STORE_HASH_SIZE];
    json *summary = new_summary(report);
    store_hash(printed, strlen(printed), hex);
    json_put_integer(summary, "report_bytes", (int64_t)strlen(printed));
    json_put_string(summary, "report_sha256", hex);
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

static bool write_report(void *context, const json *report, error *e)
{
    const char *directory = context;
    char *path = mem_printf("%s/report.json", directory), *text = json_print_pretty(report);
    size_t length = strlen(text);
    store_file file = {0};
    bool ok = write_summary(directory, report, text, e) && store_file_begin_hashed(path, &file, e);
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

static bool remove_earlier(void *context, error *e)
{
    return store_directory_create(context, e) && for_each_result(context, store_remove, e);
}

static bool clear_unfinished(const char *path, error *e)
{
    (void)e;
    store_file_clear(path);
    return true;
}

static void clear_directory(void *context)
{
    for_each_result(context, clear_unfinished, NULL);
}

delivery results_in_directory(const char *directory)
{
    return (delivery){(void *)(uintptr_t)directory, remove_earlier, write_points, write_report,
                      clear_directory};
}

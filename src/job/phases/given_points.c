// SPDX-License-Identifier: Apache-2.0
#include "job/phases/given_points.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "surface/field/projection.h"
#include "io/meshes/mesh_file.h"
#include "job/source/mesh_projection.h"
#include "sampling/packing/point_flags.h"

/* Maximum distance of a given point from the surface, in spacings: a point of a coarser file, or on the
 * triangles of a level set, is nearer. A point farther away belongs to another surface, or has other
 * units. */
static const double MAX_DISTANCE = 0.1;
/* Minimum number of points of a solve: fewer do not form a packing. */
enum { START_LEAST = 4 };
/* Maximum displacement, in spacings, by the projection onto the sampled surface: the level set of a mesh may
 * lack thin parts. */
static const double MAX_DISPLACEMENT = 1;
/* Distances from patches that differ by less than this, in spacings, are equal: the point is on an edge. */
static const double SAME_DISTANCE = 1e-6;
enum { GRAIN = 256 };

static const char what[] = "the given points";

static bool read_input(const spec *s, source *from, size_t memory_limit, given_points *out, error *e)
{
    const source_array *given = source_arrays_find(from->arrays, s->points.path);
    if (given)
        return source_array_check(given, SOURCE_ARRAY_POINTS, e) &&
               (mesh_array_read_points(&given->points, memory_limit, &out->world, &out->count, e) ||
                error_prefix(e, "%s", s->points.path));
    const int fd = source_open_file(from, s->points.path, e);
    if (fd < 0) return false;
    const mesh_file file = {.fd = fd, .path = s->points.path, .memory_limit = memory_limit};
    const bool ok = mesh_file_read_points(&file, &out->world, &out->count, e);
    close(fd);
    return ok || error_prefix(e, "%s", s->points.path);
}

bool given_points_read(const spec *s, source *from, size_t memory_limit, given_points *out, error *e)
{
    *out = (given_points){0};
    if (!s->has_points) return true;
    if (!read_input(s, from, memory_limit, out, e)) return false;
    out->position = mem_array(out->count, sizeof *out->position, what, e);
    if (!out->position) return false;
    for (size_t i = 0; i < out->count; i++)
        out->position[i] = from->turned ? placement_to_part(from->turned, out->world[i]) : out->world[i];
    return true;
}

/* ---- on the surface */

typedef struct place_job {
    const field *field;               /* onto which points are projected */
    const field_patches *patches;     /* of the sampled surface; or NULL */
    const mesh_surface *mesh;         /* triangles on which the surface is sampled; or NULL */
    const mesh_projection *triangles; /* triangles on which points are delivered; or NULL */
    given_points *g;
    double h;
    double *distance; /* per row, over h; INFINITY: unknown */
    bool *is_placed;  /* per row */
} place_job;

static bool place_on_mesh(const place_job *job, size_t i)
{
    given_points *g = job->g;
    mesh_surface_place at[MESH_SURFACE_PLACES];
    if (mesh_surface_places(job->mesh, g->position[i], at) == 0) return false;
    g->projected[i] = g->position[i];
    g->normal[i] = at[0].normal;
    g->patch[i] = at[0].patch;
    job->distance[i] = at[0].distance / job->h;
    return true;
}

/* Sets the patch and the normal of point i: of the patches that contain its place, the nearest one; at equal
 * distances the first. */
static void find_patch(const place_job *job, size_t i)
{
    given_points *g = job->g;
    double least = INFINITY;
    bool is_within = false;
    for (uint32_t k = 0; k < job->patches->count; k++) {
        const field *f = job->patches->patch[k].field;
        field_sample s;
        if (!field_sample_at(f, g->position[i], FIELD_GRADIENT, &s) || !(vec3_norm(s.gradient) > 0)) continue;
        const double distance = fabs(s.value) / vec3_norm(s.gradient);
        const bool contains = field_is_within(f, g->position[i]);
        if (contains < is_within || (contains == is_within && !(distance < least - SAME_DISTANCE * job->h)))
            continue;
        is_within = contains;
        least = distance;
        g->patch[i] = k;
        g->normal[i] = vec3_unit(s.gradient);
    }
}

static bool place_on_field(const place_job *job, size_t i)
{
    given_points *g = job->g;
    const projection_limits limits = projection_draft(job->h);
    field_sample s;
    vec3 x = g->position[i];
    const bool is_found = projection_find(job->field, &limits, &x, &g->normal[i]);
    const double moved = is_found ? vec3_norm(vec3_sub(x, g->position[i])) / job->h : INFINITY;
    if (g->patch) find_patch(job, i);
    g->projected[i] = x;
    job->distance[i] = moved;
    if (!job->triangles) return is_found;
    if (field_sample_at(&job->triangles->base, g->world[i], FIELD_GRADIENT, &s))
        job->distance[i] = fabs(s.value) / job->h;
    return moved < MAX_DISPLACEMENT;
}

static void place_chunk(void *context, int worker, size_t begin, size_t end)
{
    const place_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        job->distance[i] = INFINITY;
        job->is_placed[i] = job->mesh ? place_on_mesh(job, i) : place_on_field(job, i);
    }
}

static bool refuse_row(const given_points *g, const spec *s, size_t i, double distance, error *e)
{
    const vec3 x = g->world[i];
    char where[160], by[48];
    snprintf(where, sizeof where, "row %zu (from 0), at (%.9g, %.9g, %.9g),", i, x.x, x.y, x.z);
    snprintf(by, sizeof by, isfinite(distance) ? "%.3g" : "more than %g",
             isfinite(distance) ? distance : MAX_DISTANCE);
    if (distance <= MAX_DISTANCE)
        return error_set(
            e, ERROR_INPUT_UNSUPPORTED,
            "%s: %s lies on a part of the mesh that its level set does not represent: remove the "
            "row, or make the voxels of surface.mesh smaller",
            s->points.path, where);
    return error_set(e, ERROR_INPUT_UNSUPPORTED,
                     "%s: %s is %s spacings from the surface, and given points must be within %g spacings: "
                     "remove the row, or compare units and surface",
                     s->points.path, where, by, MAX_DISTANCE);
}

static bool check_distances(const place_job *job, const spec *s, error *e)
{
    given_points *g = job->g;
    for (size_t i = 0; i < g->count; i++) {
        g->farthest = fmax(g->farthest, job->distance[i]);
        if (!job->is_placed[i] || !(job->distance[i] <= MAX_DISTANCE))
            return refuse_row(g, s, i, job->distance[i], e);
    }
    return true;
}

static int compare_places(const void *a, const void *b, void *context)
{
    const vec3 *place = context;
    const uint32_t i = *(const uint32_t *)a, j = *(const uint32_t *)b;
    const int order = vec3_compare(place[i], place[j]);
    return order ? order : (i > j) - (i < j);
}

/* Removes points at the position of an earlier one: no force would separate their particles. */
static bool drop_equal(given_points *g, error *e)
{
    uint32_t *order = mem_array(g->count, sizeof *order, what, e);
    bool *drops = order ? mem_array(g->count, sizeof *drops, what, e) : NULL;
    for (size_t i = 0; drops && i < g->count; i++) order[i] = (uint32_t)i;
    if (drops) qsort_r(order, g->count, sizeof *order, compare_places, g->projected);
    for (size_t k = 1; drops && k < g->count; k++)
        drops[order[k]] = vec3_compare(g->projected[order[k - 1]], g->projected[order[k]]) == 0;
    for (size_t i = 0; drops && i < g->count; i++) {
        if (drops[i]) continue;
        g->projected[g->start_count] = g->projected[i];
        if (g->patch) g->patch[g->start_count] = g->patch[i];
        g->normal[g->start_count++] = g->normal[i];
    }
    const bool ok = drops != NULL;
    free(order);
    free(drops);
    return ok &&
           (g->start_count >= START_LEAST ||
            error_set(
                e, ERROR_INPUT_UNSUPPORTED,
                "/sampling/points: mode refine requires %d different points or more, and %zu are given: "
                "add points, or remove this member",
                START_LEAST, g->start_count));
}

static bool check_count(const given_points *g, const spec *s, size_t count, error *e)
{
    const bool is_kept = s->points.mode == SPEC_POINTS_KEEP;
    if (s->points.mode == SPEC_POINTS_AVOID || (is_kept ? g->count < count : g->count <= count)) return true;
    return error_set(
        e, ERROR_SPEC_INVALID,
        "/sampling/points: %zu points are given, and the count of all points is %zu: ask for %s %zu",
        g->count, count, is_kept ? "more than" : "at least", g->count);
}

bool given_points_place(given_points *g, const spec *s, const source *from, double h, size_t count,
                        threads *pool, error *e)
{
    mesh_projection triangles;
    if (g->count == 0) return true;
    if (!check_count(g, s, count, e)) return false;
    g->normal = mem_array(g->count, sizeof *g->normal, what, e);
    g->projected = mem_array(g->count, sizeof *g->projected, what, e);
    const field_patches *patches = from->field->patches;
    place_job job = {.field = patches ? from->whole.field : from->field,
                     .patches = patches,
                     .mesh = source_triangles(from),
                     .triangles = mesh_projection_find_distance(from, &triangles) ? &triangles : NULL,
                     .g = g,
                     .h = h,
                     .distance = mem_array(g->count, sizeof *job.distance, what, e),
                     .is_placed = mem_array(g->count, sizeof *job.is_placed, what, e)};
    if (patches) g->patch = mem_array(g->count, sizeof *g->patch, what, e);
    bool ok = g->normal && g->projected && job.distance && job.is_placed && (g->patch || !patches);
    if (ok) threads_run(pool, g->count, GRAIN, place_chunk, &job);
    ok = ok && threads_may_go_on(pool, e);
    ok = ok && check_distances(&job, s, e) && (s->points.mode != SPEC_POINTS_REFINE || drop_equal(g, e));
    free(job.distance);
    free(job.is_placed);
    return ok;
}

/* ---- in the result */

bool given_points_note(given_points *g, const uint32_t *row, size_t count, error *e)
{
    g->row = mem_array(count, sizeof *g->row, what, e);
    g->kept = mem_array(count, sizeof *g->kept, what, e);
    if (!g->row || !g->kept) return false;
    memcpy(g->row, row, count * sizeof *row);
    for (size_t i = 0; i < count; i++) g->kept[i] = row[i] != GIVEN_POINTS_NEW;
    return true;
}

void given_points_restore(const given_points *g, const uint32_t *point, size_t count, bool world,
                          vec3 *position)
{
    const vec3 *given = world ? g->world : g->position;
    for (size_t k = 0; g->row && k < count; k++) {
        const size_t i = point ? point[k] : k;
        if (g->kept[i]) position[k] = given[g->row[i]];
    }
}

/* ---- in the measures */

static void set_wall(given_walls *w, size_t copy, const solver_patch_points *from, size_t at)
{
    w->normal[copy] = from->normal[at];
    w->point[copy] = from->point[at];
    w->patch[copy] = from->patch[at];
    w->flags[copy] = from->flags[at];
}

/* Sets the walls of kept point i: the first in the place of the point, the others at the end, from *count on. */
static void set_kept(given_walls *w, const given_points *g, const mesh_surface *on, uint32_t i, size_t *count)
{
    mesh_surface_place at[MESH_SURFACE_PLACES];
    const field_patches *patches = mesh_surface_field(on)->patches;
    const size_t walls = mesh_surface_places(on, g->position[g->row[i]], at);
    const uint8_t flags = (uint8_t)((w->flags[i] & ~PACKING_ONE_SIDED) | (walls > 1 ? PACKING_FIXED : 0));
    for (size_t k = 0; k < walls; k++) {
        const uint8_t sign = patches->patch[at[k].patch].one_sided ? PACKING_ONE_SIDED : 0,
                      all = flags | sign;
        set_wall(w, k == 0 ? i : (*count)++,
                 &(solver_patch_points){
                     .normal = &at[k].normal, .point = &i, .patch = &at[k].patch, .flags = &all},
                 0);
    }
}

bool given_points_walls(const given_points *g, const source *from, size_t points, solver_patch_points *copies,
                        given_walls *out, error *e)
{
    const mesh_surface *on = source_triangles(from);
    size_t most = copies->count, count = points;
    *out = (given_walls){0};
    if (!g->kept || !on) return true;
    for (size_t i = 0; i < points; i++) most += g->kept[i] ? MESH_SURFACE_PLACES : 0;
    out->normal = mem_array(most, sizeof *out->normal, what, e);
    out->point = mem_array(most, sizeof *out->point, what, e);
    out->patch = mem_array(most, sizeof *out->patch, what, e);
    out->flags = mem_array(most, sizeof *out->flags, what, e);
    if (!out->normal || !out->point || !out->patch || !out->flags) return false;
    for (size_t k = 0; k < points; k++) set_wall(out, k, copies, k);
    for (size_t k = points; k < copies->count; k++)
        if (!g->kept[copies->point[k]]) set_wall(out, count++, copies, k);
    for (uint32_t i = 0; i < points; i++)
        if (g->kept[i]) set_kept(out, g, on, i, &count);
    *copies = (solver_patch_points){
        .count = count, .normal = out->normal, .patch = out->patch, .point = out->point, .flags = out->flags};
    return true;
}

void given_walls_free(given_walls *w)
{
    free(w->normal);
    free(w->point);
    free(w->patch);
    free(w->flags);
    *w = (given_walls){0};
}

double given_points_bytes(const given_points *g)
{
    return (double)(g->count * (4 * sizeof(vec3) + sizeof *g->patch));
}

void given_points_describe(const given_points *g, const spec *s, json *report)
{
    static const char *const modes[] = {SPEC_POINTS_LIST(WORDS_TEXT, )};
    if (g->count == 0) return;
    json *object = json_put_object(report, "points");
    json_put_string(object, "path", s->points.path);
    json_put_string(object, "mode", modes[s->points.mode]);
    json_put_integer(object, "count", (int64_t)g->count);
    json_put_number(object, "max_distance", g->farthest);
}

void given_points_free(given_points *g)
{
    free(g->world);
    free(g->position);
    free(g->normal);
    free(g->projected);
    free(g->patch);
    free(g->row);
    free(g->kept);
    *g = (given_points){0};
}

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

/* Maximum distance of a given point from the surface, in spacings: a point of a coarser file, or on the
 * triangles of a level set, is nearer. A point farther away belongs to another surface, or has other
 * units. */
static const double MAX_DISTANCE = 0.1;
/* Minimum number of points of a solve: fewer do not form a packing. */
enum { START_LEAST = 4 };
/* Maximum displacement, in spacings, by the projection onto the sampled surface: the level set of a mesh may
 * lack thin parts. */
static const double MAX_DISPLACEMENT = 1;
enum { GRAIN = 256 };

static const char what[] = "the given points";

static bool read_file(const spec *s, source *from, size_t memory_limit, given_points *out, error *e)
{
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
    if (!read_file(s, from, memory_limit, out, e)) return false;
    out->position = mem_array(out->count, sizeof *out->position, what, e);
    if (!out->position) return false;
    for (size_t i = 0; i < out->count; i++)
        out->position[i] = from->turned ? placement_to_part(from->turned, out->world[i]) : out->world[i];
    return true;
}

/* ---- on the surface */

typedef struct place_job {
    const field *field; /* field onto which points are projected, if is_projected */
    bool is_projected;
    given_points *g;
    const mesh_projection *triangles; /* triangles on which points are delivered; or NULL */
    double h;
    double *distance; /* per row, over h; INFINITY: no position on the surface was found */
} place_job;

static void place_chunk(void *context, int worker, size_t begin, size_t end)
{
    const place_job *job = context;
    given_points *g = job->g;
    const projection_limits limits = projection_draft(job->h);
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        vec3 x = g->position[i];
        field_sample s;
        double moved = 0;
        job->distance[i] = INFINITY;
        if (job->is_projected) {
            if (!projection_find(job->field, &limits, &x, &g->normal[i])) continue;
            moved = vec3_norm(vec3_sub(x, g->position[i]));
        }
        g->projected[i] = x;
        if (!job->triangles)
            job->distance[i] = moved / job->h;
        else if (moved < MAX_DISPLACEMENT * job->h &&
                 field_sample_at(&job->triangles->base, g->world[i], FIELD_GRADIENT, &s))
            job->distance[i] = fabs(s.value) / job->h;
    }
}

static bool check_distances(given_points *g, const spec *s, const double *distance, error *e)
{
    for (size_t i = 0; i < g->count; i++) {
        g->farthest = fmax(g->farthest, distance[i]);
        if (distance[i] <= MAX_DISTANCE) continue;
        char by[48] = "more";
        if (isfinite(distance[i])) snprintf(by, sizeof by, "%.3g spacings", distance[i]);
        const vec3 x = g->world[i];
        return error_set(
            e, ERROR_INPUT_UNSUPPORTED,
            "%s: row %zu (from 0), at (%.9g, %.9g, %.9g), is %s from the surface, and given points must "
            "be within %g spacings: remove the row, or compare units and surface",
            s->points.path, i, x.x, x.y, x.z, by, MAX_DISTANCE);
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
        g->normal[g->start_count++] = g->normal[i];
    }
    const bool ok = drops != NULL;
    free(order);
    free(drops);
    return ok &&
           (g->start_count >= START_LEAST ||
            error_set(
                e, ERROR_INPUT_UNSUPPORTED,
                "/sampling/points: mode refine requires %d different points or more, and the file has %zu: "
                "add points, or remove this member",
                START_LEAST, g->start_count));
}

static bool check_count(const given_points *g, const spec *s, size_t count, error *e)
{
    const bool is_kept = s->points.mode == SPEC_POINTS_KEEP;
    if (s->points.mode == SPEC_POINTS_AVOID || (is_kept ? g->count < count : g->count <= count)) return true;
    return error_set(
        e, ERROR_SPEC_INVALID,
        "/sampling/points: the file has %zu points, and the count of all points is %zu: ask for %s %zu",
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
    const mesh_projection *on = mesh_projection_find_distance(from, &triangles) ? &triangles : NULL;
    place_job job = {.field = from->field->patches ? from->whole.field : from->field,
                     .is_projected = !from->field->patches || !on,
                     .g = g,
                     .triangles = on,
                     .h = h,
                     .distance = mem_array(g->count, sizeof *job.distance, what, e)};
    bool ok = g->normal && g->projected && job.distance;
    if (ok) threads_run(pool, g->count, GRAIN, place_chunk, &job);
    if (ok && threads_stopped(pool)) ok = error_set(e, ERROR_CANCELLED, "stopped");
    ok = ok && check_distances(g, s, job.distance, e) &&
         (s->points.mode != SPEC_POINTS_REFINE || drop_equal(g, e));
    free(job.distance);
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

double given_points_bytes(const given_points *g)
{
    return (double)(g->count * 4 * sizeof(vec3));
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
    free(g->row);
    free(g->kept);
    *g = (given_points){0};
}

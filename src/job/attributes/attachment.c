// SPDX-License-Identifier: Apache-2.0
#include "job/attributes/attachment.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/hash.h"
#include "geometry/mesh/mesh_edges.h"
#include "geometry/mesh/mesh_weld.h"
#include "geometry/mesh/orientation.h"
#include "base/core/memory.h"
#include "geometry/space/affine.h"
#include "surface/triangles/mesh_place.h"
#include "io/meshes/mesh_file.h"

static const char what[] = "the places of points on meshes";

const attachment_array attachment_arrays[ATTACHMENT_ARRAYS] = {
    [ATTACHMENT_MESH] = {"mesh", POINT_ATTRIBUTE_INT, 1, false},
    [ATTACHMENT_FACE] = {"face", POINT_ATTRIBUTE_INT, 1, false},
    [ATTACHMENT_CORNER] = {"corner", POINT_ATTRIBUTE_INT, 3, false},
    [ATTACHMENT_WEIGHT] = {"bary", POINT_ATTRIBUTE_FLOAT, 3, true},
};

char *attachment_comment(size_t index, const attachment_topology *topology)
{
    return mem_printf("comment mesh %zu: %" PRIu64 " vertices, %" PRIu64 " faces, %" PRIu64
                      " corners, topology %016" PRIx64,
                      index, topology->vertices, topology->faces, topology->corners, topology->hash);
}

bool attachment_parse_comment(const char *line, size_t *index, attachment_topology *out)
{
    return sscanf(line,
                  "comment mesh %zu: %" SCNu64 " vertices, %" SCNu64 " faces, %" SCNu64
                  " corners, topology %" SCNx64,
                  index, &out->vertices, &out->faces, &out->corners, &out->hash) == 5;
}

/* A mesh in world space, with its polygons. */
typedef struct polygon_mesh {
    mesh m;
    mesh_polygons polygons;
} polygon_mesh;

static void free_mesh(polygon_mesh *p)
{
    mesh_free(&p->m);
    mesh_polygons_free(&p->polygons);
    *p = (polygon_mesh){0};
}

static bool read_mesh(const attachment_file *file, size_t memory_limit, polygon_mesh *out, error *e)
{
    const mesh_file from = {file->fd, file->path, NULL, memory_limit};
    if (!(file->array ? mesh_array_read_polygons(file->array, memory_limit, &out->m, &out->polygons, e)
                      : mesh_file_read_polygons(&from, &out->m, &out->polygons, e)))
        return false;
    for (size_t k = 0; k < out->m.vertex_count; k++) {
        const vec3 v = out->m.vertex[k];
        out->m.vertex[k] = affine_apply(file->to_world, v.x, v.y, v.z);
    }
    return true;
}

static uint64_t hash_of(const uint32_t *numbers, size_t count, uint64_t state)
{
    for (size_t k = 0; k < count; k++) state = hash_add(state, numbers[k]);
    return state;
}

static attachment_topology topology_of(const polygon_mesh *p)
{
    const mesh_polygons *all = &p->polygons;
    const uint64_t sizes = hash_of(all->size, all->count, HASH_NONE);
    return (attachment_topology){p->m.vertex_count, all->count, all->corners,
                                 hash_of(all->corner, all->corners, sizes)};
}

/* ---- places ---- */

/* Sorts the corners: the lowest one first, then counter-clockwise seen from the side of the normal. */
static void put_in_order(vec3 of_triangle, vec3 normal, uint32_t corner[3], double weight[3])
{
    const bool is_turned = vec3_dot(of_triangle, normal) < 0;
    const int first = corner[0] <= corner[1]   ? (corner[0] <= corner[2] ? 0 : 2)
                      : corner[1] <= corner[2] ? 1
                                               : 2;
    const uint32_t c[3] = {corner[0], corner[1], corner[2]};
    const double w[3] = {weight[0], weight[1], weight[2]};
    for (int k = 0; k < 3; k++) {
        const int from = (first + (is_turned ? 3 - k : k)) % 3;
        corner[k] = c[from];
        weight[k] = w[from];
    }
}

/* A search in one mesh. Coordinates are relative to the lowest corner of its box, where doubles are most
 * accurate. */
typedef struct search {
    polygon_mesh p;
    vec3 origin;
    triangle_tree *tree;
    uint32_t *face;
} search;

static void end_search(search *s)
{
    triangle_tree_free(s->tree);
    free(s->face);
    free_mesh(&s->p);
}

static bool begin_search(const attachment_file *file, size_t memory_limit, search *s, error *e)
{
    if (!read_mesh(file, memory_limit, &s->p, e)) return false;
    s->origin = mesh_box(&s->p.m, NULL).min;
    for (size_t k = 0; k < s->p.m.vertex_count; k++) s->p.m.vertex[k] = vec3_sub(s->p.m.vertex[k], s->origin);
    return (s->face = mesh_polygons_of_triangles(&s->p.polygons, s->p.m.triangle_count, e)) &&
           (s->tree = triangle_tree_new(&s->p.m, NULL, e));
}

static void store_place(double *const values[ATTACHMENT_ARRAYS], size_t i, size_t file, uint32_t face,
                        const uint32_t corner[3], const double weight[3])
{
    values[ATTACHMENT_MESH][i] = (double)file;
    values[ATTACHMENT_FACE][i] = face;
    for (size_t k = 0; k < 3; k++) {
        values[ATTACHMENT_CORNER][3 * i + k] = corner[k];
        values[ATTACHMENT_WEIGHT][3 * i + k] = weight[k];
    }
}

/* Stores the place of point i on this mesh if its distance is less than *distance, which is updated. */
static void find_place(const search *s, size_t file, vec3 position, vec3 normal, size_t i, double *distance,
                       double *const values[ATTACHMENT_ARRAYS])
{
    mesh_place p;
    if (!mesh_place_find(s->tree, vec3_sub(position, s->origin), &normal, *distance, &p)) return;
    if (values[ATTACHMENT_MESH][i] >= 0 && !(p.distance < *distance)) return;
    const uint32_t *t = s->p.m.triangle[p.triangle], face = s->face[p.triangle];
    uint32_t corner[3];
    for (int k = 0; k < 3; k++) corner[k] = mesh_polygons_find_corner(&s->p.polygons, face, t[k]);
    put_in_order(mesh_place_normal(&s->p.m, &p), normal, corner, p.weight);
    store_place(values, i, file, face, corner, p.weight);
    *distance = p.distance;
}

static void count_places(const double *on_mesh, const double *distance, const double *spacing, size_t count,
                         attachment_counts *counts)
{
    *counts = (attachment_counts){0};
    for (size_t i = 0; i < count; i++) {
        counts->outside += on_mesh[i] < 0;
        if (on_mesh[i] >= 0) counts->distance = fmax(counts->distance, distance[i] / spacing[i]);
    }
}

bool attachment_find(attachment_file *files, size_t file_count, size_t memory_limit, size_t count,
                     const vec3 *position, const vec3 *normal, const double *spacing,
                     double *const values[ATTACHMENT_ARRAYS], attachment_counts *counts, error *e)
{
    static const uint32_t no_corner[3];
    static const double no_weight[3] = {-1, -1, -1};
    double *distance = mem_array(count, sizeof *distance, what, e);
    bool ok = distance != NULL;
    for (size_t i = 0; ok && i < count; i++) {
        distance[i] = ATTACHMENT_TOLERANCE * spacing[i];
        store_place(values, i, 0, 0, no_corner, no_weight);
        values[ATTACHMENT_MESH][i] = values[ATTACHMENT_FACE][i] = -1;
        for (size_t k = 0; k < 3; k++) values[ATTACHMENT_CORNER][3 * i + k] = -1;
    }
    for (size_t f = 0; ok && f < file_count; f++) {
        search s = {0};
        ok = begin_search(&files[f], memory_limit, &s, e) || error_prefix(e, "%s", files[f].path);
        if (ok) files[f].topology = topology_of(&s.p);
        for (size_t i = 0; ok && i < count; i++)
            find_place(&s, f, position[i], normal[i], i, &distance[i], values);
        end_search(&s);
    }
    if (ok) count_places(values[ATTACHMENT_MESH], distance, spacing, count, counts);
    free(distance);
    return ok;
}

/* ---- another frame ---- */

/* A polygon at a vertex. */
typedef struct incidence {
    uint32_t face;
    float angle; /* interior angle of the polygon there */
} incidence;

/* A mesh with normals at its corners. Vertices with equal coordinates count as one for the normals. */
typedef struct frame {
    polygon_mesh p;
    uint32_t *joined; /* per vertex: the first vertex with the same coordinates */
    vec3 *normal;     /* per polygon: unit normal; 0: no area */
    uint32_t *set;    /* per polygon: its set of polygons that are connected by edges of two polygons */
    bool *turned;     /* per polygon: its orientation is opposite to that of the first polygon of its set */
    bool *one_sided;  /* per set: not orientable */
    size_t *first;    /* per vertex, and one more: its first incidence */
    incidence *at;
    double least; /* cosine of ATTACHMENT_CREASE */
} frame;

static void free_frame(frame *f)
{
    free(f->joined);
    free(f->normal);
    free(f->set);
    free(f->turned);
    free(f->one_sided);
    free(f->first);
    free(f->at);
    free_mesh(&f->p);
}

static bool differ(const attachment_file *file, const char *things, uint64_t found, uint64_t meant, error *e)
{
    return error_set(e, ERROR_INPUT_UNSUPPORTED,
                     "%s: the mesh has %" PRIu64 " %s, but the mesh of the result has %" PRIu64
                     ": export all frames with the same vertices and faces",
                     file->path, found, things, meant);
}

static bool check_topology(const attachment_file *file, const polygon_mesh *p, error *e)
{
    const attachment_topology found = topology_of(p), *meant = &file->topology;
    if (found.vertices != meant->vertices)
        return differ(file, "vertices", found.vertices, meant->vertices, e);
    if (found.faces != meant->faces) return differ(file, "faces", found.faces, meant->faces, e);
    if (found.corners != meant->corners)
        return differ(file, "corners of faces", found.corners, meant->corners, e);
    return found.hash == meant->hash ||
           error_set(e, ERROR_INPUT_UNSUPPORTED,
                     "%s: the faces of the mesh have other vertices than those of the mesh of the result: "
                     "export all frames with the same order of vertices and faces",
                     file->path);
}

/* The normal of a polygon, from the sum over its fan (Newell). */
static vec3 polygon_normal(const polygon_mesh *p, size_t face)
{
    const uint32_t *c = p->polygons.corner + p->polygons.first[face];
    vec3 sum = {0, 0, 0};
    for (uint32_t k = 1; k + 1 < p->polygons.size[face]; k++)
        sum = vec3_add(sum, vec3_across(p->m.vertex[c[0]], p->m.vertex[c[k]], p->m.vertex[c[k + 1]]));
    return vec3_norm(sum) > 0 ? vec3_unit(sum) : (vec3){0, 0, 0};
}

static float angle_at(const polygon_mesh *p, size_t face, uint32_t k)
{
    const uint32_t *c = p->polygons.corner + p->polygons.first[face], n = p->polygons.size[face];
    const vec3 at = p->m.vertex[c[k]], a = vec3_sub(p->m.vertex[c[(k + 1) % n]], at),
               b = vec3_sub(p->m.vertex[c[(k + n - 1) % n]], at);
    return (float)elementary_atan2(vec3_norm(vec3_cross(a, b)), vec3_dot(a, b));
}

/* Joins the polygons at each edge of two. */
static void join_polygons(const mesh_edges *edges, const uint32_t *face, orientation *o)
{
    for (size_t v = 0, n; v < edges->vertex_count; v++)
        for (size_t k = edges->first[v]; k < edges->first[v + 1]; k += n) {
            n = mesh_edges_width(edges, v, k);
            const mesh_side *side = edges->sides + k;
            if (n == 2 && face[side[0].triangle] != face[side[1].triangle])
                orientation_join(o, face[side[0].triangle], face[side[1].triangle],
                                 side[0].upwards == side[1].upwards);
        }
}

/* Sets `set`, `turned` and `one_sided`. `welded`: the triangles, with joined vertices. */
static bool find_orientations(frame *f, const mesh *welded, error *e)
{
    const size_t polygons = f->p.polygons.count;
    mesh_edges edges = {0};
    orientation o = {0};
    uint32_t *face = mesh_polygons_of_triangles(&f->p.polygons, f->p.m.triangle_count, e);
    f->set = mem_array(polygons, sizeof *f->set, what, e);
    f->turned = mem_array(polygons, sizeof *f->turned, what, e);
    f->one_sided = mem_array(polygons, sizeof *f->one_sided, what, e);
    const bool ok = face && f->set && f->turned && f->one_sided && orientation_init(&o, polygons, e) &&
                    mesh_edges_list(welded, NULL, &edges, e);
    if (ok) join_polygons(&edges, face, &o);
    for (uint32_t k = 0; ok && k < polygons; k++) {
        f->set[k] = orientation_find(&o, k, &f->turned[k]);
        f->one_sided[k] = o.conflict[k];
    }
    orientation_free(&o);
    mesh_edges_free(&edges);
    free(face);
    return ok;
}

/* Sets `joined`, the first vertex with the same coordinates, and the orientations. */
static bool join_vertices(frame *f, error *e)
{
    mesh copy = {0};
    f->joined = mem_array(f->p.m.vertex_count, sizeof *f->joined, what, e);
    if (!f->joined || !mesh_copy(&f->p.m, NULL, &copy, e)) return false;
    bool ok = mesh_weld_vertices(&copy, NULL, e);
    for (size_t n = 0; ok && n < copy.triangle_count; n++)
        for (int k = 0; k < 3; k++) f->joined[f->p.m.triangle[n][k]] = copy.triangle[n][k];
    ok = ok && find_orientations(f, &copy, e);
    mesh_free(&copy);
    return ok;
}

/* Lists the polygons at each vertex, by a counting sort. */
static bool list_incidences(frame *f, error *e)
{
    const mesh_polygons *all = &f->p.polygons;
    const size_t vertices = f->p.m.vertex_count;
    f->first = mem_array(vertices + 1, sizeof *f->first, what, e);
    f->at = f->first ? mem_array(all->corners, sizeof *f->at, what, e) : NULL;
    if (!f->at) return false;
    memset(f->first, 0, (vertices + 1) * sizeof *f->first);
    for (size_t face = 0; face < all->count; face++)
        for (uint32_t k = 0; all->size[face] > 2 && k < all->size[face]; k++)
            f->first[f->joined[all->corner[all->first[face] + k]] + 1]++;
    for (size_t v = 0; v < vertices; v++) f->first[v + 1] += f->first[v];
    const size_t total = f->first[vertices];
    for (size_t face = all->count; face-- > 0;)
        for (uint32_t k = all->size[face]; all->size[face] > 2 && k-- > 0;) {
            const uint32_t v = f->joined[all->corner[all->first[face] + k]];
            f->at[--f->first[v + 1]] = (incidence){(uint32_t)face, angle_at(&f->p, face, k)};
        }
    /* filling moved first[v] to the end of v's range: restore the begins */
    memmove(f->first, f->first + 1, vertices * sizeof *f->first);
    f->first[vertices] = total;
    return true;
}

static bool open_frame(const attachment_file *file, size_t memory_limit, frame *f, error *e)
{
    if (!read_mesh(file, memory_limit, &f->p, e)) return error_prefix(e, "%s", file->path);
    if (!check_topology(file, &f->p, e)) return false;
    f->least = elementary_cos(ATTACHMENT_CREASE);
    f->normal = mem_array(f->p.polygons.count, sizeof *f->normal, what, e);
    for (size_t k = 0; f->normal && k < f->p.polygons.count; k++) f->normal[k] = polygon_normal(&f->p, k);
    return f->normal && join_vertices(f, e) && list_incidences(f, e);
}

/* The normal of another polygon, on the side of polygon `face`. */
static vec3 normal_on_side(const frame *f, uint32_t other, uint32_t face)
{
    const vec3 n = f->normal[other];
    const bool is_one_set = f->set[other] == f->set[face];
    const bool is_opposite = is_one_set && f->one_sided[f->set[face]] ? vec3_dot(n, f->normal[face]) < 0
                             : is_one_set                             ? f->turned[other] != f->turned[face]
                                                                      : false;
    return is_opposite ? vec3_scale(n, -1) : n;
}

/* The normal of a polygon at one of its vertices. */
static vec3 corner_normal(const frame *f, uint32_t face, uint32_t vertex)
{
    const vec3 own = f->normal[face];
    const uint32_t v = f->joined[vertex];
    vec3 sum = {0, 0, 0};
    for (size_t k = f->first[v]; k < f->first[v + 1]; k++) {
        const vec3 n = normal_on_side(f, f->at[k].face, face);
        if (vec3_dot(n, own) >= f->least) sum = vec3_axpy((double)f->at[k].angle, n, sum);
    }
    return vec3_norm(sum) > 0 ? vec3_unit(sum) : own;
}

/* Whether the weights are valid barycentric weights, within the rounding error of floats. */
static bool are_weights(const double weight[3])
{
    static const double slack = 1e-3;
    double sum = 0;
    bool ok = true;
    for (int k = 0; k < 3; k++) {
        sum += weight[k];
        ok &= weight[k] >= -slack && weight[k] <= 1 + slack;
    }
    return ok && fabs(sum - 1) <= slack;
}

static bool check_place(const mesh_polygons *p, size_t i, double face, const double corner[3],
                        const double weight[3], error *e)
{
    bool ok = face >= 0 && face < (double)p->count && are_weights(weight);
    for (int k = 0; ok && k < 3; k++) ok = corner[k] >= 0 && corner[k] < p->size[(size_t)face];
    return ok ||
           error_set(
               e, ERROR_INPUT_DAMAGED,
               "point %zu of the result lies on face %.0f, corners %.0f, %.0f and %.0f with the weights %g, "
               "%g and %g, which is not a place of the mesh: sample the surface again",
               i, face, corner[0], corner[1], corner[2], weight[0], weight[1], weight[2]);
}

/* Whether the order of the corners is opposite to that of the polygon: the point is on its other side. */
static bool is_turned(const double corner[3])
{
    return (corner[0] < corner[1]) + (corner[1] < corner[2]) + (corner[2] < corner[0]) < 2;
}

static void evaluate(const frame *f, uint32_t face, const double corner[3], const double weight[3],
                     vec3 *position, vec3 *normal)
{
    const uint32_t *of_face = f->p.polygons.corner + f->p.polygons.first[face];
    vec3 x = {0, 0, 0}, n = {0, 0, 0};
    for (int k = 0; k < 3; k++) {
        const uint32_t vertex = of_face[(size_t)corner[k]];
        x = vec3_add(x, vec3_scale(f->p.m.vertex[vertex], weight[k]));
        n = vec3_add(n, vec3_scale(corner_normal(f, face, vertex), weight[k]));
    }
    *position = x;
    if (vec3_norm(n) > 0) *normal = vec3_scale(vec3_unit(n), is_turned(corner) ? -1 : 1);
}

static bool evaluate_all(const frame *f, size_t file, size_t count,
                         const double *const values[ATTACHMENT_ARRAYS], vec3 *position, vec3 *normal,
                         error *e)
{
    for (size_t i = 0; i < count; i++) {
        const double face = values[ATTACHMENT_FACE][i], *corner = values[ATTACHMENT_CORNER] + 3 * i,
                     *weight = values[ATTACHMENT_WEIGHT] + 3 * i;
        if (values[ATTACHMENT_MESH][i] != (double)file) continue;
        if (!check_place(&f->p.polygons, i, face, corner, weight, e)) return false;
        evaluate(f, (uint32_t)face, corner, weight, &position[i], &normal[i]);
    }
    return true;
}

bool attachment_evaluate(const attachment_file *files, size_t file_count, size_t memory_limit, size_t count,
                         const double *const values[ATTACHMENT_ARRAYS], vec3 *position, vec3 *normal,
                         error *e)
{
    bool ok = true;
    for (size_t i = 0; i < count; i++)
        if (values[ATTACHMENT_MESH][i] >= (double)file_count)
            return error_set(
                e, ERROR_INPUT_DAMAGED,
                "point %zu of the result lies on mesh %.0f, but the surface has %zu: sample it again", i,
                values[ATTACHMENT_MESH][i], file_count);
    for (size_t k = 0; ok && k < file_count; k++) {
        frame f = {0};
        ok = open_frame(&files[k], memory_limit, &f, e) &&
             evaluate_all(&f, k, count, values, position, normal, e);
        free_frame(&f);
    }
    return ok;
}

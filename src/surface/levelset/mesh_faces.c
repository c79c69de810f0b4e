// SPDX-License-Identifier: Apache-2.0
#include "surface/levelset/mesh_faces.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "surface/triangles/triangle_tree.h"

/* Maximum distance of a projection, voxels. The zero set is farther from the mesh only at spikes, which it
 * cuts off. */
static const double farthest = 2;
/* A place within this distance of the mesh, in voxels, is projected to the closest triangle at once. */
static const double on_mesh = 1e-3;
/* Distance in front of a place from which the test whether it is hidden starts, voxels: beyond the
 * triangles that meet at the place. */
static const double in_front = 1e-3;
/* Lines are tilted against the normals by this vector, so that they do not run within faces of a mesh with
 * right angles. */
static const vec3 tilt = {0.00917, 0.00631, 0.00487};

/* Meshes of more than UNGROUPED triangles are divided into groups: triangles whose centroids lie in one cell
 * of a lattice. GROUP: typical number of triangles in a group. MOST_CELLS: maximum number of cells along a
 * side. A point searches few groups. */
enum { UNGROUPED = 1 << 16, GROUP = 512, MOST_CELLS = 128 };

struct mesh_faces {
    mesh m; /* in voxels, sorted by group */
    double voxel;
    vec3 origin;
    size_t count; /* of groups */
    mesh *group;  /* ranges of m */
    triangle_tree **tree;
    triangle_forest *trees;
    bool hides; /* parts of the mesh are inside its solids */
};

/* The lattice. */
typedef struct group_job {
    const mesh *m;
    vec3 low;
    double cell;
    size_t side;
    uint32_t *cell_of; /* per triangle */
} group_job;

static void find_cells(void *context, int worker, size_t begin, size_t end)
{
    const group_job *g = context;
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        const uint32_t *t = g->m->triangle[n];
        const vec3 *v = g->m->vertex,
                   middle = vec3_scale(vec3_add(v[t[0]], vec3_add(v[t[1]], v[t[2]])), 1.0 / 3);
        size_t at = 0;
        for (int axis = 0; axis < 3; axis++) {
            const double k = (vec3_get(middle, axis) - vec3_get(g->low, axis)) / g->cell;
            at = at * g->side + (size_t)fmax(0, fmin(k, (double)(g->side - 1)));
        }
        g->cell_of[n] = (uint32_t)at;
    }
}

/* Sorts the triangles by cell. Each cell with triangles becomes a group. */
static bool group_triangles(mesh_faces *f, threads *pool, error *e)
{
    static const char what[] = "the tree of a mesh";
    const bbox box = mesh_box(&f->m, pool);
    const size_t all = f->m.triangle_count;
    group_job g = {.m = &f->m, .low = box.min, .side = 1};
    if (all > UNGROUPED)
        g.side = (size_t)fmax(
            1,
            fmin(MOST_CELLS, sqrt((double)all / (3 * GROUP)))); /* the surface crosses about 3 side^2 cells */
    g.cell = fmax(bbox_longest(box), DBL_MIN) / (double)g.side;
    const size_t cells = g.side * g.side * g.side;
    uint32_t *first = mem_array(cells + 2, sizeof *first, what, e);
    uint32_t(*sorted)[3] = first ? mem_array(all, sizeof *sorted, what, e) : NULL;
    g.cell_of = sorted ? mem_array(all, sizeof *g.cell_of, what, e) : NULL;
    bool ok = g.cell_of;
    if (ok) {
        threads_run(pool, all, 1 << 14, find_cells, &g);
        for (size_t n = 0; n < all; n++) first[g.cell_of[n] + 2]++;
        for (size_t c = 2; c < cells + 2; c++) {
            f->count += first[c] > 0;
            first[c] += first[c - 1];
        }
        for (size_t n = 0; n < all; n++)
            memcpy(sorted[first[g.cell_of[n] + 1]++], f->m.triangle[n], sizeof *sorted);
        free(f->m.triangle);
        f->m.triangle = sorted;
        sorted = NULL;
        f->group = mem_array(f->count, sizeof *f->group, what, e);
        ok = f->group;
    }
    f->count = 0;
    for (size_t c = 0; ok && c < cells; c++)
        if (first[c + 1] > first[c])
            f->group[f->count++] = (mesh){.vertex_count = f->m.vertex_count,
                                          .triangle_count = first[c + 1] - first[c],
                                          .vertex = f->m.vertex,
                                          .triangle = f->m.triangle + first[c]};
    free(first);
    free(sorted);
    free(g.cell_of);
    return ok;
}

static void box_groups(void *context, int worker, size_t begin, size_t end)
{
    const mesh_faces *f = context;
    (void)worker;
    for (size_t k = begin; k < end; k++)
        if (f->group[k].triangle_count <= UNGROUPED) f->tree[k] = triangle_tree_new_lazy(&f->group[k]);
}

static bool make_trees(mesh_faces *f, threads *pool, error *e)
{
    if (!group_triangles(f, pool, e)) return false;
    f->tree = mem_array(f->count, sizeof *f->tree, "the tree of a mesh", e);
    if (!f->tree) return false;
    threads_run(pool, f->count, 16, box_groups, f);
    for (size_t k = 0; k < f->count; k++)
        if (!f->tree[k] && !(f->tree[k] = triangle_tree_new(&f->group[k], pool, e))) return false;
    f->trees = triangle_forest_new((const triangle_tree *const *)f->tree, f->count, e);
    return f->trees;
}

mesh_faces *mesh_faces_new(mesh *m, const double index_to_world[16], bool hides, threads *pool, error *e)
{
    mesh_faces *f = mem_alloc(sizeof *f);
    f->m = *m;
    *m = (mesh){0};
    f->voxel = index_to_world[0];
    f->origin = vec3_make(index_to_world[3], index_to_world[7], index_to_world[11]);
    f->hides = hides;
    if (make_trees(f, pool, e)) return f;
    mesh_faces_free(f);
    return NULL;
}

void mesh_faces_free(mesh_faces *f)
{
    if (!f) return;
    triangle_forest_free(f->trees);
    for (size_t k = 0; f->tree && k < f->count; k++) triangle_tree_free(f->tree[k]);
    free(f->tree);
    free(f->group);
    mesh_free(&f->m);
    free(f);
}

size_t mesh_faces_bytes(const mesh_faces *f)
{
    size_t trees = triangle_forest_bytes(f->trees);
    for (size_t k = 0; k < f->count; k++) trees += triangle_tree_bytes(f->tree[k]);
    return f->m.vertex_count * sizeof *f->m.vertex + f->m.triangle_count * sizeof *f->m.triangle + trees;
}

/* A point to be projected, voxels. */
typedef struct projection {
    const mesh_faces *f;
    vec3 x, normal;
} projection;

static bool looks_its_way(const void *context, size_t n, const triangle *t)
{
    const projection *l = context;
    (void)n;
    return vec3_dot(vec3_cross(vec3_sub(t->b, t->a), vec3_sub(t->c, t->a)), l->normal) > 0;
}

static bool looks_out(const void *context, size_t n, const triangle *t)
{
    const projection *l = context;
    if (!looks_its_way(context, n, t)) return false;
    const vec3 from = vec3_axpy(in_front, l->normal, triangle_nearest(t, l->x)),
               way = vec3_unit(vec3_add(l->normal, tilt));
    return triangle_forest_cross(l->f->trees, from, way).winding == 0;
}

static vec3 to_voxels(const mesh_faces *f, vec3 x)
{
    return vec3_scale(vec3_sub(x, f->origin), 1 / f->voxel);
}

vec3 mesh_faces_project(const mesh_faces *f, vec3 x, vec3 normal)
{
    const projection l = {f, to_voxels(f, x), vec3_unit(normal)};
    vec3 place = l.x;
    if (!(f->hides && triangle_forest_find_accepted(f->trees, l.x, farthest, looks_out, &l, &place)) &&
        !triangle_forest_find_accepted(f->trees, l.x, farthest, looks_its_way, &l, &place))
        triangle_forest_find_accepted(f->trees, l.x, INFINITY, NULL, NULL, &place);
    return mesh_faces_to_world(f, place);
}

/* The place on triangle n of a group, for the whole mesh. */
static mesh_place place_in_group(const mesh_faces *f, size_t group, size_t n, vec3 x)
{
    mesh_place out = {.triangle = (uint32_t)(f->group[group].triangle - f->m.triangle + (ptrdiff_t)n)};
    const triangle of = triangle_of_corners(f->m.vertex, f->m.triangle[out.triangle]);
    triangle_weights(&of, x, out.weight);
    out.distance = sqrt(triangle_distance2(&of, x));
    return out;
}

mesh_place mesh_faces_place(const mesh_faces *f, vec3 x, vec3 normal)
{
    const projection l = {f, to_voxels(f, x), vec3_unit(normal)};
    size_t n, group = triangle_forest_find(f->trees, l.x, &n);
    mesh_place out = place_in_group(f, group, n, l.x);
    const triangle of = triangle_of_corners(f->m.vertex, f->m.triangle[out.triangle]);
    const bool is_inside = out.weight[0] > 0 && out.weight[1] > 0 && out.weight[2] > 0;
    if (is_inside && looks_its_way(&l, n, &of)) return out;
    vec3 at = l.x;
    triangle_forest_find_accepted(f->trees, l.x, farthest, looks_its_way, &l, &at);
    mesh_place_find_among(f->trees, at, &l.normal, INFINITY, &group, &out);
    return place_in_group(f, group, out.triangle, l.x);
}

bool mesh_faces_has_hidden(const mesh_faces *f)
{
    return f->hides;
}

const mesh *mesh_faces_mesh(const mesh_faces *f)
{
    return &f->m;
}

double mesh_faces_unit(const mesh_faces *f)
{
    return f->voxel;
}

vec3 mesh_faces_to_world(const mesh_faces *f, vec3 x_vox)
{
    return vec3_axpy(f->voxel, x_vox, f->origin);
}

vec3 mesh_faces_nearest(const mesh_faces *f, vec3 x)
{
    vec3 place = to_voxels(f, x);
    if (!triangle_forest_find_accepted(f->trees, place, on_mesh, NULL, NULL, &place))
        triangle_forest_find_accepted(f->trees, place, INFINITY, NULL, NULL, &place);
    return mesh_faces_to_world(f, place);
}

#include "mesh/mesh_faces.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "mesh/line_tree.h"
#include "mesh/nearest_triangle.h"

/* Voxels. The zero set is farther from what it follows at spikes alone, which it cuts off. */
static const double farthest = 2;
/* Voxels: a place that has landed is found at once within this. */
static const double landed = 1e-3;
/* Voxels: what hides a place is looked for from so far in front of it, past the triangles that meet there. */
static const double in_front = 1e-3;
/* Lines are tilted by this against normals, lest they run along faces of right angles. */
static const vec3 tilt = {0.00917, 0.00631, 0.00487};

struct mesh_faces {
    mesh m; /* in voxels */
    double voxel;
    vec3 origin;
    nearest_triangle *tree;
    line_tree *lines; /* NULL: nothing is hidden */
};

mesh_faces *mesh_faces_new(mesh *m, const double index_to_world[16], bool hides, error *e)
{
    mesh_faces *f = mem_alloc(sizeof *f);
    f->m = *m;
    *m = (mesh){0};
    f->voxel = index_to_world[0];
    f->origin = vec3_make(index_to_world[3], index_to_world[7], index_to_world[11]);
    if ((f->tree = nearest_triangle_new(&f->m, e)) && (!hides || (f->lines = line_tree_new(&f->m, e))))
        return f;
    mesh_faces_free(f);
    return NULL;
}

void mesh_faces_free(mesh_faces *f)
{
    if (!f) return;
    nearest_triangle_free(f->tree);
    line_tree_free(f->lines);
    mesh_free(&f->m);
    free(f);
}

size_t mesh_faces_bytes(const mesh_faces *f)
{
    return f->m.vertex_count * sizeof *f->m.vertex + f->m.triangle_count * sizeof *f->m.triangle +
           nearest_triangle_bytes(f->tree) + line_tree_bytes(f->lines);
}

/* A point that is to land, in voxels. */
typedef struct landing {
    const mesh_faces *f;
    vec3 x, normal;
} landing;

static bool looks_its_way(const void *context, size_t n, const triangle *t)
{
    const landing *l = context;
    (void)n;
    return vec3_dot(vec3_cross(vec3_sub(t->b, t->a), vec3_sub(t->c, t->a)), l->normal) > 0;
}

static bool looks_out(const void *context, size_t n, const triangle *t)
{
    const landing *l = context;
    if (!looks_its_way(context, n, t)) return false;
    const vec3 from = vec3_axpy(in_front, l->normal, triangle_nearest(t, l->x)),
               way = vec3_unit(vec3_add(l->normal, tilt));
    return line_tree_cross(l->f->lines, from, way, LINE_TREE_NO_TRIANGLE).winding == 0;
}

static vec3 to_voxels(const mesh_faces *f, vec3 x)
{
    return vec3_scale(vec3_sub(x, f->origin), 1 / f->voxel);
}

vec3 mesh_faces_land(const mesh_faces *f, vec3 x, vec3 normal)
{
    const landing l = {f, to_voxels(f, x), vec3_unit(normal)};
    vec3 place = l.x;
    if (!(f->lines && nearest_triangle_find_among(f->tree, l.x, farthest, looks_out, &l, &place)) &&
        !nearest_triangle_find_among(f->tree, l.x, farthest, looks_its_way, &l, &place))
        nearest_triangle_find_among(f->tree, l.x, INFINITY, NULL, NULL, &place);
    return vec3_axpy(f->voxel, place, f->origin);
}

vec3 mesh_faces_nearest(const mesh_faces *f, vec3 x)
{
    vec3 place = to_voxels(f, x);
    if (!nearest_triangle_find_among(f->tree, place, landed, NULL, NULL, &place))
        nearest_triangle_find_among(f->tree, place, INFINITY, NULL, NULL, &place);
    return vec3_axpy(f->voxel, place, f->origin);
}

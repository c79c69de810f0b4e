// SPDX-License-Identifier: Apache-2.0
#include "geometry/mesh/flat_triangles.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "geometry/mesh/mesh_weld.h"
#include "base/core/heap.h"
#include "base/core/memory.h"
#include "geometry/mesh/linked_mesh.h"
#include "geometry/mesh/rounding.h"

static const char what[] = "the triangles without area of the mesh";

/* Triangles in a chunk of work. */
enum { CHUNK = 4096 };

typedef struct flat_search {
    const mesh *m;
    rounding r;
    atomic_bool found; /* a flat triangle was found */
} flat_search;

typedef struct removal_job {
    linked_mesh l;
    rounding r;
    heap flat; /* triangles; key: minus the squared length of the longest side */
} removal_job;

static bool is_same(vec3 a, vec3 b)
{
    return a.x == b.x && a.y == b.y && a.z == b.z;
}

/* Whether three distinct corners lie on a line to within `allowed`. Side k begins at corner k. */
static bool is_flat(const vec3 corner[3], double allowed, int *longest, double *length2, int *shortest,
                    double *least2)
{
    if (is_same(corner[0], corner[1]) || is_same(corner[1], corner[2]) || is_same(corner[2], corner[0]))
        return false;
    *length2 = 0;
    *least2 = INFINITY;
    for (int k = 0; k < 3; k++) {
        const double side2 = vec3_norm2(vec3_sub(corner[(k + 1) % 3], corner[k]));
        if (side2 > *length2) {
            *length2 = side2;
            *longest = k;
        }
        if (side2 < *least2) {
            *least2 = side2;
            *shortest = k;
        }
    }
    const vec3 across = vec3_cross(vec3_sub(corner[1], corner[0]), vec3_sub(corner[2], corner[0]));
    return vec3_norm2(across) <= allowed * allowed * *length2;
}

/* ---- search for flat triangles */

static void look_chunk(void *context, int worker, size_t begin, size_t end)
{
    flat_search *l = context;
    bool found = false;
    (void)worker;
    for (size_t n = begin; n < end && !found; n++) {
        vec3 corner[3];
        int longest, shortest;
        double length2, least2;
        mesh_get_corners(l->m, n, corner);
        found = is_flat(corner, rounding_reach(&l->r, corner), &longest, &length2, &shortest, &least2);
    }
    if (found) atomic_store_explicit(&l->found, true, memory_order_relaxed);
}

static bool look(flat_search *l, threads *pool)
{
    atomic_store(&l->found, false);
    threads_run(pool, l->m->triangle_count, CHUNK, look_chunk, l);
    return l->found;
}

static bool find_flat(flat_search *l, threads *pool)
{
    l->r = rounding_at_most(l->m, pool);
    if (!look(l, pool)) return false; /* most meshes have no flat triangle at this bound */
    l->r = rounding_of(l->m, pool);
    return l->r.relative > 0 || look(l, pool);
}

/* The present shape of a triangle. */
typedef struct triangle_shape {
    bool flat;
    int longest, shortest;
    double length2, least2, error;
} triangle_shape;

static triangle_shape shape_of(const removal_job *r, uint32_t t)
{
    triangle_shape s = {0};
    vec3 corner[3];
    mesh_get_corners(r->l.m, t, corner);
    s.error = rounding_reach(&r->r, corner);
    s.flat = is_flat(corner, s.error, &s.longest, &s.length2, &s.shortest, &s.least2);
    return s;
}

static bool push_if_flat(removal_job *r, uint32_t t, error *e)
{
    const triangle_shape s = shape_of(r, t);
    return !s.flat || heap_push(&r->flat, (heap_item){-s.length2, t, 0}, what, e);
}

/* ---- removal of one triangle */

/* Splits triangle t at m, a point on its side between a and b. */
static bool split(removal_job *r, uint32_t t, uint32_t a, uint32_t b, uint32_t m, error *e)
{
    const uint32_t *corner = r->l.m->triangle[t];
    uint32_t second[3], added = 0;
    memcpy(second, corner, sizeof second);
    second[linked_mesh_corner(second, a)] = m;
    linked_mesh_move(&r->l, 3 * t + (uint32_t)linked_mesh_corner(corner, b), m);
    return linked_mesh_add(&r->l, second, &added, e) && push_if_flat(r, t, e) && push_if_flat(r, added, e);
}

/* Drops triangle t, whose corner m lies on the side from a to b, and splits the other triangles at that side
 * at m. */
static bool split_neighbours(removal_job *r, uint32_t t, uint32_t a, uint32_t b, uint32_t m, error *e)
{
    if (r->l.degree[a] > r->l.degree[b]) {
        const uint32_t swap = a;
        a = b;
        b = swap;
    }
    linked_mesh_drop(&r->l, t);
    for (uint32_t c = r->l.head[a], next; c != LINKED_MESH_NONE; c = next) {
        const uint32_t other = c / 3;
        const uint32_t *corner = r->l.m->triangle[other];
        next = r->l.next[c];
        if (linked_mesh_corner(corner, b) < 0) continue;
        if (linked_mesh_corner(corner, m) >= 0) /* a duplicate of triangle t */
            linked_mesh_drop(&r->l, other);
        else if (!split(r, other, a, b, m, e))
            return false;
    }
    return true;
}

/* Replaces vertex `from` by vertex `to`. */
static bool collapse(removal_job *r, uint32_t to, uint32_t from, error *e)
{
    while (r->l.head[from] != LINKED_MESH_NONE) {
        const uint32_t c = r->l.head[from], t = c / 3;
        if (linked_mesh_corner(r->l.m->triangle[t], to) >= 0) {
            linked_mesh_drop(&r->l, t);
            continue;
        }
        linked_mesh_move(&r->l, c, to);
        if (!push_if_flat(r, t, e)) return false;
    }
    return true;
}

static bool remove_one(removal_job *r, uint32_t t, const triangle_shape *s, error *e)
{
    const uint32_t *corner = r->l.m->triangle[t];
    if (s->least2 <= s->error * s->error) {
        const uint32_t a = corner[s->shortest], b = corner[(s->shortest + 1) % 3];
        return r->l.degree[a] < r->l.degree[b] ? collapse(r, b, a, e) : collapse(r, a, b, e);
    }
    return split_neighbours(r, t, corner[s->longest], corner[(s->longest + 1) % 3],
                            corner[(s->longest + 2) % 3], e);
}

/* Removes the flat triangle with the longest side until none is left. A removal creates only flat triangles
 * with shorter sides, unless a neighbour is as thin. `most` bounds the number of removals if rounding causes
 * cycles. */
static bool remove_all(removal_job *r, size_t most, error *e)
{
    while (r->flat.count > 0 && most-- > 0) {
        const heap_item first = heap_pop(&r->flat);
        if (r->l.dead[first.item]) continue;
        const triangle_shape s = shape_of(r, first.item);
        /* changed since it was pushed; a later item is valid */
        if (!s.flat || s.length2 != -first.key) continue;
        if (!remove_one(r, first.item, &s, e)) return false;
    }
    return true;
}

/* ---- public functions */

static bool begin(removal_job *r, mesh *m, size_t *flat, error *e)
{
    if (!linked_mesh_begin(m, &r->l, e)) return false;
    for (uint32_t t = 0; t < m->triangle_count; t++)
        if (linked_mesh_is_proper(m->triangle[t]) && !push_if_flat(r, t, e)) return false;
    *flat = r->flat.count;
    return true;
}

static bool remove_flat(mesh *m, const rounding *rounded, mesh_notes *notes, error *e)
{
    enum { ROUNDS = 32, ROUNDS_MORE = 1024 };
    removal_job r = {.r = *rounded};
    const size_t all = m->triangle_count;
    size_t flat = 0;
    const bool ok = begin(&r, m, &flat, e) && remove_all(&r, ROUNDS * flat + ROUNDS_MORE, e);
    linked_mesh_end(&r.l);
    free(r.flat.item);
    if (ok && flat)
        mesh_note(notes,
                  "%zu of %zu triangles have no area (corners on a line within rounding): they are "
                  "removed and their neighbours are joined; repair the mesh to keep its shape.",
                  flat, all);
    return ok;
}

bool flat_triangles_remove(mesh *m, threads *pool, mesh_notes *notes, error *e)
{
    flat_search l = {.m = m};
    const bool found = m->triangle_count > 0 && find_flat(&l, pool);
    if (!threads_may_go_on(pool, e)) return false;
    return !found || (mesh_weld_vertices(m, pool, e) && remove_flat(m, &l.r, notes, e));
}

bool flat_triangles_remove_thin(mesh *m, const rounding *r, error *e)
{
    mesh_notes unused = {0};
    return mesh_weld_vertices(m, NULL, e) && remove_flat(m, r, &unused, e);
}

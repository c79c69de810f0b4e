// SPDX-License-Identifier: Apache-2.0
#include "surface/triangles/mesh_facets.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/compare.h"
#include "base/core/memory.h"

static const char what[] = "the facets of a mesh";

/* A position within this fraction of the length of a side from it is on the side. */
static const double ON_SIDE = 1e-9;

bool mesh_facets_begin(const smooth_sides *sides, mesh_facets *out, error *e)
{
    *out = (mesh_facets){.sides = sides};
    out->of = mem_array(sides->m->triangle_count, sizeof *out->of, what, e);
    return out->of != NULL;
}

void mesh_facets_free(mesh_facets *f)
{
    for (size_t k = 0; k < f->count; k++) {
        free(f->facet[k].side);
        free(f->facet[k].corner);
    }
    free(f->facet);
    free(f->of);
    free(f->queue);
    *f = (mesh_facets){0};
}

static bool add_triangle(mesh_facets *f, uint32_t triangle, error *e)
{
    if (!MEM_GROW(f->queue, f->queue_count, &f->queue_room, what, e)) return false;
    f->queue[f->queue_count++] = triangle;
    f->of[triangle] = (uint32_t)f->count + 1;
    return true;
}

/* The sum of the cross products of the triangles, on the side of the first one. */
static vec3 normal_of(const mesh_facets *f)
{
    const mesh *m = f->sides->m;
    vec3 sum = {0, 0, 0};
    for (size_t k = 0; k < f->queue_count; k++) {
        const vec3 cross = mesh_across(m, f->queue[k]);
        sum = vec3_axpy(vec3_dot(sum, cross) < 0 ? -1 : 1, cross, sum);
    }
    return vec3_unit(sum);
}

/* Lists the triangles of a facet, in ascending order, so that it does not depend on the requested one. Sets its
 * normal, and whether it is apart. */
static bool gather_triangles(mesh_facets *f, uint32_t triangle, mesh_facet *out, error *e)
{
    const smooth_sides *s = f->sides;
    f->queue_count = 0;
    out->is_apart = true;
    if (!add_triangle(f, triangle, e)) return false;
    for (size_t k = 0; k < f->queue_count; k++) {
        const uint32_t n = f->queue[k];
        for (int side = 0; side < 3; side++) {
            if (!smooth_sides_is_coplanar(s, n, side))
                out->is_apart &= smooth_sides_is_crease(s, n, side);
            else if (f->of[s->beside[n][side]] == 0 && !add_triangle(f, s->beside[n][side], e))
                return false;
        }
    }
    qsort(f->queue, f->queue_count, sizeof *f->queue, compare_uint32);
    out->normal = normal_of(f);
    return true;
}

/* A corner of the facet in work. */
typedef struct found_corner {
    uint32_t vertex, triangle, corner;
} found_corner;

static int by_vertex(const void *a, const void *b)
{
    const uint32_t x = ((const found_corner *)a)->vertex, y = ((const found_corner *)b)->vertex;
    return (x > y) - (x < y);
}

/* The index of the corner at a vertex; `otherwise` if there is none. */
static uint32_t index_of(const found_corner *list, size_t count, uint32_t vertex, uint32_t otherwise)
{
    const found_corner key = {vertex, 0, 0}, *found = bsearch(&key, list, count, sizeof *list, by_vertex);
    return found ? (uint32_t)(found - list) : otherwise;
}

/* The start of a boundary side: the sides of a triangle are seen in the orientation of the facet. */
static sector_step side_from(const mesh_facets *f, const mesh_facet *facet, uint32_t n, int side)
{
    const smooth_sides *s = f->sides;
    const bool ahead = vec3_dot(mesh_across(s->m, n), facet->normal) >= 0;
    return sector_begin(s, n, ahead ? side : (side + 1) % 3, ahead);
}

/* Lists the corners of a facet, and the sides between them. */
static bool find_boundary(mesh_facets *f, mesh_facet *out, error *e)
{
    const smooth_sides *s = f->sides;
    size_t room = 0, side_room = 0, found = 0;
    found_corner *list = NULL;
    bool ok = true;
    for (size_t q = 0; ok && q < f->queue_count; q++)
        for (int side = 0; ok && side < 3; side++) {
            if (smooth_sides_is_coplanar(s, f->queue[q], side)) continue;
            const sector_step at = side_from(f, out, f->queue[q], side);
            if (!sector_is_corner(s, at.triangle, at.corner)) continue;
            if (!(ok = MEM_GROW(list, found, &room, what, e) &&
                       MEM_GROW(out->side, out->side_count, &side_room, what, e)))
                break;
            list[found++] = (found_corner){s->m->triangle[at.triangle][at.corner], at.triangle, at.corner};
            const sector_step end = sector_follow(s, at);
            out->side[out->side_count][0] = list[found - 1].vertex;
            out->side[out->side_count++][1] = s->m->triangle[end.triangle][end.corner];
        }
    if (found > 0) qsort(list, found, sizeof *list, by_vertex);
    for (size_t k = 0; k < found; k++)
        if (out->corner_count == 0 || list[k].vertex != list[out->corner_count - 1].vertex)
            list[out->corner_count++] = list[k];
    out->corner = ok ? mem_array(out->corner_count, sizeof *out->corner, what, e) : NULL;
    for (size_t k = 0; out->corner && k < out->corner_count; k++)
        out->corner[k] = (mesh_facet_corner){list[k].triangle, list[k].corner};
    for (size_t k = 0; out->corner && k < out->side_count; k++) {
        uint32_t *ends = out->side[k];
        ends[0] = index_of(list, out->corner_count, ends[0], 0);
        ends[1] = index_of(list, out->corner_count, ends[1], ends[0]);
    }
    free(list);
    return out->corner != NULL;
}

bool mesh_facets_request(mesh_facets *f, uint32_t triangle, error *e)
{
    if (f->of[triangle] > 0) return true;
    if (!MEM_GROW(f->facet, f->count, &f->room, what, e)) return false;
    mesh_facet *out = &f->facet[f->count];
    *out = (mesh_facet){.side_count = 0};
    bool ok = gather_triangles(f, triangle, out, e);
    f->count++;
    return ok && (out->is_apart || find_boundary(f, out, e));
}

void mesh_facet_weigh(const mesh_facet *f, const mesh *m, vec3 x, mesh_facet_visitor *visit, void *context)
{
    for (size_t k = 0; k < f->side_count; k++) {
        const mesh_facet_corner *a = &f->corner[f->side[k][0]], *b = &f->corner[f->side[k][1]];
        const vec3 to_a = vec3_sub(m->vertex[m->triangle[a->triangle][a->corner]], x),
                   to_b = vec3_sub(m->vertex[m->triangle[b->triangle][b->corner]], x);
        const double ra = vec3_norm(to_a), rb = vec3_norm(to_b), length = vec3_norm(vec3_sub(to_b, to_a)),
                     area = vec3_dot(vec3_cross(to_a, to_b), f->normal), dot = vec3_dot(to_a, to_b);
        if (dot <= 0 && fabs(area) <= ON_SIDE * length * length) { /* x is on the side */
            visit(context, NULL, 0);
            visit(context, a, rb);
            visit(context, b, ra);
            return;
        }
        const double tangent = area / (ra * rb + dot); /* of half the angle at x */
        visit(context, a, tangent / ra);
        visit(context, b, tangent / rb);
    }
}

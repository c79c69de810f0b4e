// SPDX-License-Identifier: Apache-2.0
#include "surface/remesh/fine_mesh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "geometry/mesh/mesh_weld.h"
#include "base/core/memory.h"
#include "geometry/space/point_tree.h"
#include "geometry/space/triangle.h"

static const char what[] = "the pieces of the mesh";

/* Maximum number of passes; each halves a side at most once. */
enum { MOST_PASSES = 24 };

/* ---- a part of the mesh ---- */

/* Whether the bounding sphere of a triangle, about its centroid, meets the part. */
static bool meets_part(const fine_mesh_part *part, const mesh *m, const uint32_t t[3])
{
    if (!part) return true;
    const vec3 a = m->vertex[t[0]], b = m->vertex[t[1]], c = m->vertex[t[2]],
               middle = vec3_scale(vec3_add(a, vec3_add(b, c)), 1.0 / 3);
    const double reach = fmax(vec3_norm2(vec3_sub(a, middle)),
                              fmax(vec3_norm2(vec3_sub(b, middle)), vec3_norm2(vec3_sub(c, middle))));
    double away;
    const uint32_t center = point_tree_nearest(part->centers, middle, 0, &away);
    return away <= part->radius[center] + sqrt(reach);
}

/* Copies the triangles that meet the part, and their vertices. */
static bool copy_part(const mesh *whole, const fine_mesh_part *part, mesh *out, error *e)
{
    size_t count = 0;
    *out = (mesh){.welded = whole->welded};
    uint32_t *vertex = mem_array(whole->vertex_count, sizeof *vertex, what, e),
             *of_part = mem_array(whole->triangle_count, sizeof *of_part, what, e);
    bool ok = vertex && of_part;
    for (size_t n = 0; ok && n < whole->triangle_count; n++)
        if (meets_part(part, whole, whole->triangle[n])) of_part[count++] = (uint32_t)n;
    ok = ok && (out->triangle = mem_array(count, sizeof *out->triangle, what, e)) &&
         (out->vertex = mem_array(3 * count, sizeof *out->vertex, what, e));
    for (size_t c = 0; ok && c < 3 * count; c++) {
        const uint32_t v = whole->triangle[of_part[c / 3]][c % 3];
        if (vertex[v] == 0) { /* index + 1; 0: not copied yet */
            out->vertex[out->vertex_count] = whole->vertex[v];
            vertex[v] = (uint32_t)++out->vertex_count;
        }
        out->triangle[c / 3][c % 3] = vertex[v] - 1;
    }
    if (ok) out->triangle_count = count;
    free(vertex);
    free(of_part);
    return ok;
}

/* ---- sides and their midpoint vertices ---- */

#define WHOLE UINT32_MAX /* a side that is not halved; greater than any index of a vertex or triangle */

typedef struct side {
    uint32_t low, high; /* equal: a free slot of the hash table */
    uint32_t middle;
} side;

typedef struct halving {
    fine_mesh *out;
    const fine_mesh_part *part;
    const point_tree *tree;
    const double *spacing;
    double share;
    side *table;
    size_t mask, vertex_room, triangle_room;
} halving;

/* The spacing at the midpoint of a side is that of a point within this distance of it, or else of the
 * nearest point. In side lengths. */
static const double NEAR_ENOUGH = 0.5;

static bool needs_halving(const halving *h, vec3 a, vec3 b, vec3 middle)
{
    double unused;
    const double length = vec3_norm(vec3_sub(a, b));
    const uint32_t near = point_tree_nearest(h->tree, middle, NEAR_ENOUGH * length, &unused);
    return length > h->share * h->spacing[near];
}

static bool too_many(error *e)
{
    return error_set(e, ERROR_LIMIT_MEMORY,
                     "mesh.ply requires more than %u pieces of the mesh: ask for fewer points", WHOLE);
}

/* The vertex at the midpoint of a side, created at the first call for the side; WHOLE if the side is not
 * halved. */
static bool halve_side(halving *h, uint32_t a, uint32_t b, uint32_t *out, error *e)
{
    mesh *m = &h->out->m;
    const uint32_t low = a < b ? a : b, high = a < b ? b : a;
    size_t at = (((uint64_t)low << 32 | high) * 0x9e3779b97f4a7c15u >> 20) & h->mask;
    while (h->table[at].low != h->table[at].high && (h->table[at].low != low || h->table[at].high != high))
        at = (at + 1) & h->mask;
    side *s = &h->table[at];
    if (s->low == s->high) {
        const vec3 middle = vec3_scale(vec3_add(m->vertex[low], m->vertex[high]), 0.5);
        *s = (side){low, high, WHOLE};
        if (needs_halving(h, m->vertex[low], m->vertex[high], middle)) {
            if (m->vertex_count >= WHOLE) return too_many(e);
            if (!MEM_GROW(m->vertex, m->vertex_count, &h->vertex_room, what, e)) return false;
            s->middle = (uint32_t)m->vertex_count;
            m->vertex[m->vertex_count++] = middle;
        }
    }
    *out = s->middle;
    return true;
}

/* The triangles into which a triangle is divided at its halved sides. Returns their number. */
static size_t cut_triangle(const uint32_t t[3], const uint32_t middle[3], uint32_t out[4][3])
{
    const bool halved[3] = {middle[0] != WHOLE, middle[1] != WHOLE, middle[2] != WHOLE};
    const uint32_t corner[6] = {t[0], t[1], t[2], middle[0], middle[1], middle[2]};
    int parts[4][3];
    const int count = triangle_split(halved, parts);
    for (int n = 0; n < count; n++)
        for (int k = 0; k < 3; k++) out[n][k] = corner[parts[n][k]];
    return (size_t)count;
}

static bool keep_triangle(mesh *m, const uint32_t t[3], size_t *room, error *e)
{
    if (m->triangle_count >= WHOLE) return too_many(e);
    if (!MEM_GROW(m->triangle, m->triangle_count, room, what, e)) return false;
    memcpy(m->triangle[m->triangle_count++], t, sizeof *m->triangle);
    return true;
}

/* Halves each side that is too long once. Triangles without such a side are finished and leave the list. */
static bool halve_sides(halving *h, uint32_t (**at_hand)[3], size_t *count, error *e)
{
    size_t places = 16, made = 0;
    while (places < 6 * *count) places *= 2;
    h->mask = places - 1;
    h->table = mem_array(places, sizeof *h->table, what, e);
    uint32_t(*next)[3] = mem_array(4 * *count, sizeof *next, what, e);
    bool ok = h->table && next;
    for (size_t n = 0; ok && n < *count; n++) {
        const uint32_t *t = (*at_hand)[n];
        uint32_t middle[3];
        if (!meets_part(h->part, &h->out->m, t)) continue;
        for (int k = 0; ok && k < 3; k++) ok = halve_side(h, t[k], t[(k + 1) % 3], &middle[k], e);
        if (!ok) break;
        if (middle[0] == WHOLE && middle[1] == WHOLE && middle[2] == WHOLE)
            ok = keep_triangle(&h->out->m, t, &h->triangle_room, e);
        else
            made += cut_triangle(t, middle, next + made);
    }
    free(h->table);
    free(*at_hand);
    *at_hand = next;
    *count = made;
    return ok;
}

/* ---- public functions ---- */

static bool list_around(fine_mesh *f, error *e)
{
    const mesh *m = &f->m;
    f->first = mem_array(m->vertex_count + 2, sizeof *f->first, what, e);
    f->around = mem_array(3 * m->triangle_count, sizeof *f->around, what, e);
    if (!f->first || !f->around) return false;
    for (size_t c = 0; c < 3 * m->triangle_count; c++) f->first[m->triangle[c / 3][c % 3] + 2]++;
    for (size_t v = 2; v < m->vertex_count + 2; v++) f->first[v] += f->first[v - 1];
    for (size_t c = 0; c < 3 * m->triangle_count; c++)
        f->around[f->first[m->triangle[c / 3][c % 3] + 1]++] = (uint32_t)(c / 3);
    return true;
}

bool fine_mesh_make(const mesh *whole, const fine_mesh_part *part, size_t count, const vec3 *position,
                    const double *spacing, double share, fine_mesh *out, error *e)
{
    mesh_notes unused = {0};
    *out = (fine_mesh){0};
    point_tree *tree = point_tree_new(position, count, e);
    bool ok = tree && (part ? copy_part(whole, part, &out->m, e) : mesh_copy(whole, NULL, &out->m, e)) &&
              mesh_weld(&out->m, MESH_KEEP_CANCELLED, &unused, e);
    halving h = {.out = out,
                 .part = part,
                 .tree = tree,
                 .spacing = spacing,
                 .share = share,
                 .vertex_room = out->m.vertex_count};
    uint32_t(*at_hand)[3] = out->m.triangle;
    size_t left = out->m.triangle_count;
    out->m.triangle = NULL;
    out->m.triangle_count = 0;
    out->m.welded = false;
    for (int pass = 0; ok && left > 0 && pass < MOST_PASSES; pass++) ok = halve_sides(&h, &at_hand, &left, e);
    for (size_t n = 0; ok && n < left; n++) ok = keep_triangle(&out->m, at_hand[n], &h.triangle_room, e);
    free(at_hand);
    point_tree_free(tree);
    return ok && list_around(out, e);
}

void fine_mesh_free(fine_mesh *f)
{
    mesh_free(&f->m);
    free(f->first);
    free(f->around);
    *f = (fine_mesh){0};
}

// SPDX-License-Identifier: Apache-2.0
#include "geometry/mesh/contacts.h"

#include <stdint.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "base/core/sets.h"
#include "geometry/mesh/mesh_edges.h"

static const char what[] = "the contacts of the mesh";

/* Joins the sets of all faces at an edge that cancel. */
static void join_at_edge(const mesh_side *s, size_t count, const unsigned char *face, uint32_t *set)
{
    const mesh_side *first = NULL;
    for (size_t k = 0; k < count; k++) {
        if (face[s[k].triangle] != CONTACTS_CANCELS) continue;
        if (first)
            sets_join(set, first->triangle, s[k].triangle);
        else
            first = &s[k];
    }
}

/* Whether the faces at an edge from v that cancel lie on one side of it: with no other face there, it is the free border
 * of a sheet. */
static bool is_border(const mesh *m, uint32_t v, const mesh_side *s, size_t count, const unsigned char *face)
{
    const vec3 at = m->vertex[v], way = vec3_sub(m->vertex[s->other], at);
    vec3 first = {0, 0, 0};
    bool has_first = false;
    for (size_t k = 0; k < count; k++) {
        if (face[s[k].triangle] != CONTACTS_CANCELS) continue;
        const uint32_t *t = m->triangle[s[k].triangle], beyond = t[0] + t[1] + t[2] - v - s->other;
        const vec3 to = vec3_sub(m->vertex[beyond], at),
                   off = vec3_axpy(-vec3_dot(to, way) / vec3_norm2(way), way, to);
        if (has_first && vec3_dot(first, off) < 0) return false;
        if (!has_first) first = off;
        has_first = true;
    }
    return has_first;
}

/* What is known of a set of cancelling faces. */
enum { TOUCHES = 1, HAS_HOLE = 2 };

/* Notes for the set of the cancelling faces at an edge: other faces remain there (TOUCHES); removing the set would leave
 * a hole beside the only one, or would remove a free border (HAS_HOLE). */
static void look_at_edge(const mesh *m, uint32_t v, const mesh_side *s, size_t count,
                         const unsigned char *face, uint32_t *set, unsigned char *found)
{
    size_t remaining = 0;
    for (size_t k = 0; k < count; k++) remaining += face[s[k].triangle] == CONTACTS_REMAINS;
    const bool loses = remaining == 1 || (remaining == 0 && is_border(m, v, s, count, face));
    for (size_t k = 0; k < count; k++)
        if (face[s[k].triangle] == CONTACTS_CANCELS)
            found[sets_root(set, s[k].triangle)] |=
                (unsigned char)((remaining ? TOUCHES : 0) | (loses ? HAS_HOLE : 0));
}

bool contacts_find_needed(const mesh *m, unsigned char *face, error *e)
{
    const size_t all = m->triangle_count;
    mesh_edges edges = {0};
    uint32_t *set = mem_array(all, sizeof *set, what, e);
    unsigned char *found = set ? mem_array(all, sizeof *found, what, e) : NULL;
    const bool ok = found && mesh_edges_list(m, NULL, &edges, e);
    if (ok) sets_reset(set, all);
    for (int pass = 0; ok && pass < 2; pass++)
        for (size_t v = 0; v < edges.vertex_count; v++)
            for (size_t k = edges.first[v], n; k < edges.first[v + 1]; k += n) {
                n = mesh_edges_width(&edges, v, k);
                if (pass == 0)
                    join_at_edge(edges.sides + k, n, face, set);
                else
                    look_at_edge(m, (uint32_t)v, edges.sides + k, n, face, set, found);
            }
    for (uint32_t t = 0; ok && t < all; t++)
        if (face[t] == CONTACTS_CANCELS && found[sets_root(set, t)] != TOUCHES) face[t] = CONTACTS_NEEDED;
    mesh_edges_free(&edges);
    free(set);
    free(found);
    return ok;
}

bool contacts_find_closed(const mesh *m, const mesh_edges *edges, bool *closed, error *e)
{
    const size_t all = m->triangle_count;
    uint32_t *set = mem_array(all, sizeof *set, what, e);
    if (!set) return false;
    sets_reset(set, all);
    for (uint32_t t = 0; t < all; t++) closed[t] = true;
    for (int pass = 0; pass < 2; pass++)
        for (size_t v = 0; v < edges->vertex_count; v++)
            for (size_t k = edges->first[v], n; k < edges->first[v + 1]; k += n) {
                const mesh_side *s = edges->sides + k;
                n = mesh_edges_width(edges, v, k);
                for (size_t i = 1; pass == 0 && i < n; i++) sets_join(set, s[0].triangle, s[i].triangle);
                if (pass == 1 && n % 2 == 1) closed[sets_root(set, s[0].triangle)] = false;
            }
    for (uint32_t t = 0; t < all; t++) closed[t] = closed[sets_root(set, t)];
    free(set);
    return true;
}

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

/* Marks the set of the cancelling faces at an edge if exactly one remaining face meets there: removing the
 * set would leave a hole. */
static void mark_hole(const mesh_side *s, size_t count, const unsigned char *face, uint32_t *set,
                      bool *has_hole)
{
    size_t remaining = 0;
    for (size_t k = 0; k < count; k++) remaining += face[s[k].triangle] == CONTACTS_REMAINS;
    for (size_t k = 0; remaining == 1 && k < count; k++)
        if (face[s[k].triangle] == CONTACTS_CANCELS) has_hole[sets_root(set, s[k].triangle)] = true;
}

bool contacts_find_needed(const mesh *m, unsigned char *face, error *e)
{
    const size_t all = m->triangle_count;
    mesh_edges edges = {0};
    uint32_t *set = mem_array(all, sizeof *set, what, e);
    bool *has_hole = set ? mem_array(all, sizeof *has_hole, what, e) : NULL;
    const bool ok = has_hole && mesh_edges_list(m, NULL, &edges, e);
    if (ok) sets_reset(set, all);
    for (int pass = 0; ok && pass < 2; pass++)
        for (size_t v = 0; v < edges.vertex_count; v++)
            for (size_t k = edges.first[v], n; k < edges.first[v + 1]; k += n) {
                n = mesh_edges_width(&edges, v, k);
                if (pass == 0)
                    join_at_edge(edges.sides + k, n, face, set);
                else
                    mark_hole(edges.sides + k, n, face, set, has_hole);
            }
    for (uint32_t t = 0; ok && t < all; t++)
        if (face[t] == CONTACTS_CANCELS && has_hole[sets_root(set, t)]) face[t] = CONTACTS_NEEDED;
    mesh_edges_free(&edges);
    free(set);
    free(has_hole);
    return ok;
}

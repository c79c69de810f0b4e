// SPDX-License-Identifier: Apache-2.0
#include "geometry/mesh/mesh_euler.h"

#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/mesh/mesh_edges.h"

/* In `seen`: the vertex is on an edge that does not count. */
#define ON_BORDER UINT32_MAX

static bool has_equal_corners(const uint32_t t[3])
{
    return t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
}

static uint32_t piece_of(const uint32_t *piece, size_t triangle)
{
    return piece ? piece[triangle] : 0;
}

/* Subtracts the edges that count, and marks the vertices of the others. Sides of triangles with equal corners lie
 * beside those of their neighbours, which they connect. */
static void subtract_edges(const mesh *m, const mesh_edges *edges, const uint32_t *piece, bool borders,
                           uint32_t *seen, double *euler)
{
    for (size_t v = 0; v < edges->vertex_count; v++)
        for (size_t k = edges->first[v], n; k < edges->first[v + 1]; k += n) {
            const mesh_side *side = edges->sides + k;
            n = mesh_edges_width(edges, v, k);
            size_t proper = 0, last = 0;
            for (size_t i = 0; i < n; i++)
                if (!has_equal_corners(m->triangle[side[i].triangle])) {
                    proper++;
                    last = side[i].triangle;
                }
            if (proper == 1 && !borders)
                seen[v] = seen[side->other] = ON_BORDER;
            else if (proper > 0)
                euler[piece_of(piece, last)]--;
        }
}

bool mesh_euler_add(const mesh *m, const uint32_t *piece, bool borders, threads *pool, double *euler,
                    error *e)
{
    mesh_edges edges = {0};
    /* of each vertex: the last piece in which it was counted, plus 1 */
    uint32_t *seen = mem_array(m->vertex_count + 1, sizeof *seen, "the pieces of the mesh", e);
    const bool ok = seen && mesh_edges_list(m, pool, &edges, e);
    if (ok) subtract_edges(m, &edges, piece, borders, seen, euler);
    for (size_t t = 0; ok && t < m->triangle_count; t++) {
        const uint32_t p = piece_of(piece, t);
        if (has_equal_corners(m->triangle[t])) continue;
        euler[p]++;
        for (int c = 0; c < 3; c++) {
            uint32_t *last = &seen[m->triangle[t][c]];
            if (*last == p + 1 || *last == ON_BORDER) continue;
            *last = p + 1;
            euler[p]++;
        }
    }
    mesh_edges_free(&edges);
    free(seen);
    return ok;
}

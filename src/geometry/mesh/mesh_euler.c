// SPDX-License-Identifier: Apache-2.0
#include "geometry/mesh/mesh_euler.h"

#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/mesh/mesh_edges.h"

static bool has_equal_corners(const uint32_t t[3])
{
    return t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
}

/* Subtracts the edges that count, and marks the vertices of the others. Sides of triangles with equal corners lie
 * beside those of their neighbours, which they connect. */
static void subtract_edges(const mesh *m, const mesh_edges *edges, bool borders, bool *seen, double *euler)
{
    for (size_t v = 0; v < edges->vertex_count; v++)
        for (size_t k = edges->first[v], n; k < edges->first[v + 1]; k += n) {
            const mesh_side *side = edges->sides + k;
            n = mesh_edges_width(edges, v, k);
            size_t proper = 0;
            for (size_t i = 0; i < n; i++) proper += !has_equal_corners(m->triangle[side[i].triangle]);
            if (proper == 1 && !borders)
                seen[v] = seen[side->other] = true;
            else if (proper > 0)
                --*euler;
        }
}

bool mesh_euler_add(const mesh *m, bool borders, threads *pool, double *euler, error *e)
{
    mesh_edges edges = {0};
    /* of each vertex: it was counted, or does not count */
    bool *seen = mem_array(m->vertex_count + 1, sizeof *seen, "the edges of the mesh", e);
    const bool ok = seen && mesh_edges_list(m, pool, &edges, e);
    if (ok) subtract_edges(m, &edges, borders, seen, euler);
    for (size_t t = 0; ok && t < m->triangle_count; t++) {
        if (has_equal_corners(m->triangle[t])) continue;
        ++*euler;
        for (int c = 0; c < 3; c++) {
            const uint32_t v = m->triangle[t][c];
            *euler += !seen[v];
            seen[v] = true;
        }
    }
    mesh_edges_free(&edges);
    free(seen);
    return ok;
}

// SPDX-License-Identifier: Apache-2.0
#include "surface/labels/label_graph.h"

#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/mesh/mesh_edges.h"

static const char what[] = "the neighbours of vertices between labels";

/* Visits the line edges if `lines`, otherwise all other edges. Without neighbour array: counts the
 * neighbours of both ends. With it: enters them. */
static void list_edges(const mesh_edges *edges, const uint32_t *kind, bool lines, size_t *place,
                       label_graph *g)
{
    for (uint32_t v = 0; v < edges->vertex_count; v++)
        for (size_t i = edges->first[v], n; i < edges->first[v + 1]; i += n) {
            n = mesh_edges_width(edges, v, i);
            const mesh_side *s = edges->sides + i;
            const uint32_t ends[2] = {v, s->other};
            if ((n != 2 || kind[s[0].triangle] != kind[s[1].triangle]) != lines) continue;
            for (int k = 0; k < 2; k++) {
                if (g->neighbour)
                    g->neighbour[place[ends[k]]] = ends[1 - k];
                else if (lines)
                    g->along[ends[k]]++;
                place[ends[k]]++;
            }
        }
}

bool label_graph_make(const mesh *m, const uint32_t *kind, label_graph *out, error *e)
{
    mesh_edges edges = {0};
    label_graph g = {.first = mem_array(m->vertex_count + 2, sizeof *g.first, what, e),
                     .along = mem_array(m->vertex_count, sizeof *g.along, what, e),
                     .kind = mem_array(m->vertex_count, sizeof *g.kind, what, e)};
    bool ok = g.first && g.along && g.kind && mesh_edges_list(m, NULL, &edges, e);
    if (ok) {
        for (size_t n = 0; n < m->triangle_count; n++)
            for (int k = 0; k < 3; k++) g.kind[m->triangle[n][k]] = kind[n];
        list_edges(&edges, kind, true, g.first + 2, &g);
        list_edges(&edges, kind, false, g.first + 2, &g);
        for (size_t v = 2; v < m->vertex_count + 2; v++) g.first[v] += g.first[v - 1];
        ok = (g.neighbour = mem_array(g.first[m->vertex_count + 1], sizeof *g.neighbour, what, e)) != NULL;
    }
    if (ok) {
        list_edges(&edges, kind, true, g.first + 1, &g);
        list_edges(&edges, kind, false, g.first + 1, &g);
    } else {
        label_graph_free(&g);
    }
    mesh_edges_free(&edges);
    *out = g;
    return ok;
}

void label_graph_normals(const mesh *m, vec3 *out)
{
    for (size_t v = 0; v < m->vertex_count; v++) out[v] = (vec3){0, 0, 0};
    for (size_t n = 0; n < m->triangle_count; n++) {
        const uint32_t *t = m->triangle[n];
        const vec3 across = mesh_across(m, n);
        for (int k = 0; k < 3; k++) out[t[k]] = vec3_add(out[t[k]], across);
    }
}

void label_graph_free(label_graph *g)
{
    free(g->first);
    free(g->neighbour);
    free(g->along);
    free(g->kind);
    *g = (label_graph){0};
}

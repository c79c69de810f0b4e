// SPDX-License-Identifier: Apache-2.0
#include "job/phases/label_meshes.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/mesh/mesh_edges.h"

static const char what[] = "the mesh of a label";

static bool count_edges(label_mesh_part *p, error *e)
{
    const mesh m = {p->set.count, p->set.triangle_count, p->position, p->triangle, false};
    mesh_edges edges = {0};
    const bool ok = mesh_edges_list(&m, NULL, &edges, e);
    for (size_t v = 0; ok && v < edges.vertex_count; v++)
        for (size_t k = edges.first[v], n; k < edges.first[v + 1]; k += n) {
            int way = 0;
            n = mesh_edges_width(&edges, v, k);
            for (size_t i = k; i < k + n; i++) way += edges.sides[i].upwards ? 1 : -1;
            p->open_edges += way != 0;
            p->nonmanifold_edges += n > 2;
        }
    mesh_edges_free(&edges);
    return ok;
}

static double volume_of(const label_mesh_part *p)
{
    double sum = 0;
    for (size_t k = 0; k < p->set.triangle_count; k++) {
        const uint32_t *t = p->triangle[k];
        sum += vec3_dot(p->position[t[0]], vec3_cross(p->position[t[1]], p->position[t[2]])) / 6;
    }
    return p->open_edges > 0 ? NAN : sum;
}

/* `number`: for each point of the whole, its index in *p plus 1, or 0. */
static void gather(const points *whole, int64_t label, uint32_t *number, label_mesh_part *p)
{
    for (size_t k = 0; k < whole->triangle_count; k++) {
        const int64_t *labels = whole->triangle_labels[k];
        const bool turned = labels[1] == label;
        if (labels[0] != label && !turned) continue;
        for (int c = 0; c < 3; c++) {
            const uint32_t point = whole->triangle[k][turned ? (3 - c) % 3 : c];
            if (number[point] == 0) {
                p->position[p->set.count] = whole->position[point];
                p->index[p->set.count] = point;
                number[point] = (uint32_t)++p->set.count;
            }
            p->triangle[p->set.triangle_count][c] = number[point] - 1;
        }
        p->set.triangle_count++;
    }
}

bool label_mesh_part_make(const points *whole, int64_t label, label_mesh_part *out, error *e)
{
    uint32_t *number = mem_array(whole->count, sizeof *number, what, e);
    *out = (label_mesh_part){.position = mem_array(whole->count, sizeof *out->position, what, e),
                             .index = mem_array(whole->count, sizeof *out->index, what, e),
                             .triangle = mem_array(whole->triangle_count, sizeof *out->triangle, what, e)};
    bool ok = number && out->position && out->index && out->triangle;
    if (ok) {
        gather(whole, label, number, out);
        out->point = (point_attribute){"point", POINT_ATTRIBUTE_INT, 1, out->index, false};
        out->set.position = out->position;
        out->set.attributes = &out->point;
        out->set.attribute_count = 1;
        out->set.triangle = (const uint32_t(*)[3])out->triangle;
        ok = count_edges(out, e);
    }
    if (ok) out->volume = volume_of(out);
    free(number);
    return ok;
}

void label_mesh_part_free(label_mesh_part *p)
{
    free(p->position);
    free(p->index);
    free(p->triangle);
    *p = (label_mesh_part){0};
}

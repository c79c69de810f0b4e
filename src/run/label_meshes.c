#include "run/label_meshes.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"

static const char what[] = "the mesh of a label";

/* An edge of a triangle: its ends, the lesser one first, and which way the triangle goes. */
typedef struct edge {
    uint32_t low, high;
    int way;
} edge;

static int compare_edges(const void *a, const void *b)
{
    const edge *x = a, *y = b;
    if (x->low != y->low) return x->low > y->low ? 1 : -1;
    return (x->high > y->high) - (x->high < y->high);
}

static bool count_edges(label_mesh_part *p, error *e)
{
    const size_t count = 3 * p->set.triangle_count;
    edge *list = mem_array(count, sizeof *list, what, e);
    if (!list) return false;
    for (size_t k = 0; k < count; k++) {
        const uint32_t from = p->triangle[k / 3][k % 3], to = p->triangle[k / 3][(k + 1) % 3];
        list[k] = from < to ? (edge){from, to, 1} : (edge){to, from, -1};
    }
    qsort(list, count, sizeof *list, compare_edges);
    for (size_t k = 0, n; k < count; k = n) {
        int way = 0;
        for (n = k; n < count && compare_edges(&list[n], &list[k]) == 0; n++) way += list[n].way;
        p->open_edges += way != 0;
        p->nonmanifold_edges += n - k > 2;
    }
    free(list);
    return true;
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

/* `number`: of each point of the whole one more than its number here, or 0. */
static void gather(const points *whole, int32_t label, uint32_t *number, label_mesh_part *p)
{
    for (size_t k = 0; k < whole->triangle_count; k++) {
        const int32_t *labels = whole->triangle_labels[k];
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

bool label_mesh_part_make(const points *whole, int32_t label, label_mesh_part *out, error *e)
{
    uint32_t *number = mem_array(whole->count, sizeof *number, what, e);
    *out = (label_mesh_part){.position = mem_array(whole->count, sizeof *out->position, what, e),
                             .index = mem_array(whole->count, sizeof *out->index, what, e),
                             .triangle = mem_array(whole->triangle_count, sizeof *out->triangle, what, e)};
    bool ok = number && out->position && out->index && out->triangle;
    if (ok) {
        gather(whole, label, number, out);
        out->point = (point_attribute){"point", POINT_ATTRIBUTE_INT, 1, out->index};
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

#include "mesh/nearest_triangle.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "geometry/morton.h"
#include "mesh/triangle.h"

/* Triangles in a leaf; a box costs about as much as one. */
enum { LEAF = 4, DEEPEST = 64 };

struct nearest_triangle {
    const mesh *mesh;
    uint32_t *order; /* triangles along Morton's curve */
    bbox *box;       /* of node k, whose halves are 2 k + 1 and 2 k + 2 */
};

/* Places for the nodes of a tree over `count` triangles, which are halved until they are a leaf. */
static size_t places_for(size_t count)
{
    size_t nodes = 1;
    for (; count > LEAF; count -= count / 2) nodes = 2 * nodes + 1;
    return nodes;
}

static triangle triangle_at(const nearest_triangle *n, size_t k)
{
    const uint32_t *corner = n->mesh->triangle[n->order[k]];
    const vec3 *v = n->mesh->vertex;
    return (triangle){v[corner[0]], v[corner[1]], v[corner[2]]};
}

static bbox build(nearest_triangle *n, size_t node, size_t first, size_t count)
{
    bbox box = bbox_empty();
    if (count <= LEAF) {
        for (size_t k = first; k < first + count; k++) {
            const triangle t = triangle_at(n, k);
            box = bbox_unite(box, triangle_box(&t));
        }
    } else {
        size_t half = count / 2;
        box = bbox_unite(build(n, 2 * node + 1, first, half),
                         build(n, 2 * node + 2, first + half, count - half));
    }
    return n->box[node] = box;
}

nearest_triangle *nearest_triangle_new(const mesh *m, error *e)
{
    nearest_triangle *n = mem_alloc(sizeof *n);
    vec3 *middle = mem_array(m->triangle_count, sizeof *middle, "the tree of a mesh", e);
    n->mesh = m;
    n->order = mem_array(m->triangle_count, sizeof *n->order, "the tree of a mesh", e);
    n->box = mem_array(places_for(m->triangle_count), sizeof *n->box, "the tree of a mesh", e);
    for (size_t k = 0; middle && k < m->triangle_count; k++) {
        const uint32_t *corner = m->triangle[k];
        vec3 sum = vec3_add(m->vertex[corner[0]], vec3_add(m->vertex[corner[1]], m->vertex[corner[2]]));
        middle[k] = vec3_scale(sum, 1.0 / 3);
    }
    bool ok = middle && n->order && n->box && morton_order(middle, m->triangle_count, n->order, e);
    free(middle);
    if (ok) {
        build(n, 0, 0, m->triangle_count);
        return n;
    }
    nearest_triangle_free(n);
    return NULL;
}

void nearest_triangle_free(nearest_triangle *n)
{
    if (!n) return;
    free(n->order);
    free(n->box);
    free(n);
}

static double box_distance2(const bbox *b, vec3 p)
{
    double sum = 0;
    for (int a = 0; a < 3; a++) {
        double x = vec3_get(p, a), d = fmax(0, fmax(vec3_get(b->min, a) - x, x - vec3_get(b->max, a)));
        sum += d * d;
    }
    return sum;
}

/* A part of the tree that is yet to be looked at. */
typedef struct visit {
    size_t node, first, count;
    double distance2;
} visit;

size_t nearest_triangle_find(const nearest_triangle *n, vec3 p, double weight[3])
{
    visit stack[DEEPEST] = {{0, 0, n->mesh->triangle_count, 0}};
    size_t found = 0;
    double best = INFINITY;
    for (int depth = 1; depth > 0;) {
        const visit v = stack[--depth];
        if (!(v.distance2 < best)) continue;
        if (v.count <= LEAF) {
            for (size_t k = v.first; k < v.first + v.count; k++) {
                const triangle t = triangle_at(n, k);
                double distance2 = triangle_distance2(&t, p);
                if (!(distance2 < best)) continue;
                best = distance2;
                found = k;
            }
            continue;
        }
        size_t half = v.count / 2, left = 2 * v.node + 1, right = left + 1;
        const visit a = {left, v.first, half, box_distance2(&n->box[left], p)},
                    b = {right, v.first + half, v.count - half, box_distance2(&n->box[right], p)};
        bool swap = a.distance2 < b.distance2; /* the nearer one is looked at first */
        stack[depth++] = swap ? b : a;
        stack[depth++] = swap ? a : b;
    }
    const triangle t = triangle_at(n, found);
    triangle_weights(&t, p, weight);
    return n->order[found];
}

// SPDX-License-Identifier: Apache-2.0
#include "job/phases/mesh_faults.h"

#include <stdlib.h>

#include "base/core/memory.h"
#include "sampling/packing/point_flags.h"

static const char what[] = "the faults of the mesh";

size_t mesh_faults_count(const triangulation_facts *f)
{
    return f->nonmanifold_edges - f->seam_edges + f->nonmanifold_vertices + f->boundary_edges - f->rim_edges;
}

/* A triangle at one of its corners: the other two corners, counterclockwise. */
typedef struct wedge {
    uint32_t from, to;
} wedge;

/* A step along a curve between two vertices, the lower index first. */
typedef struct step {
    uint32_t low, high;
} step;

typedef struct fault_search {
    const triangulation_input *in;
    size_t *begin; /* vertex v has the wedges begin[v] .. begin[v + 1] - 1 */
    wedge *wedge;
    step *step; /* sorted */
} fault_search;

static int compare_steps(const void *left, const void *right)
{
    const step *a = left, *b = right;
    if (a->low != b->low) return a->low < b->low ? -1 : 1;
    return (a->high > b->high) - (a->high < b->high);
}

static step step_between(uint32_t a, uint32_t b)
{
    return a < b ? (step){a, b} : (step){b, a};
}

static bool list_steps(fault_search *f, error *e)
{
    const triangulation_input *in = f->in;
    if (!(f->step = mem_array(in->side_count, sizeof *f->step, what, e))) return false;
    for (size_t k = 0; k < in->side_count; k++)
        f->step[k] = step_between(in->point[in->side[k][0]], in->point[in->side[k][1]]);
    qsort(f->step, in->side_count, sizeof *f->step, compare_steps);
    return true;
}

static bool list_wedges(fault_search *f, const triangulation *made, error *e)
{
    const size_t points = f->in->points, triangles = made->facts.triangles;
    f->begin = mem_array(points + 2, sizeof *f->begin, what, e);
    f->wedge = mem_array(3 * triangles, sizeof *f->wedge, what, e);
    if (!f->begin || !f->wedge) return false;
    for (size_t c = 0; c < 3 * triangles; c++) f->begin[made->corner[c / 3][c % 3] + 2]++;
    for (size_t v = 2; v < points + 2; v++) f->begin[v] += f->begin[v - 1];
    for (size_t c = 0; c < 3 * triangles; c++) {
        const uint32_t *t = made->corner[c / 3];
        f->wedge[f->begin[t[c % 3] + 1]++] = (wedge){t[(c + 1) % 3], t[(c + 2) % 3]};
    }
    return true;
}

/* Number of curve steps between two vertices. */
static size_t steps_between(const fault_search *f, uint32_t a, uint32_t b)
{
    const step wanted = step_between(a, b);
    size_t low = 0, high = f->in->side_count, count = 0;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (compare_steps(&f->step[middle], &wanted) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    while (low + count < f->in->side_count && compare_steps(&f->step[low + count], &wanted) == 0) count++;
    return count;
}

static bool is_at_boundary(const triangulation_input *in, uint32_t v)
{
    return (!in->side && in->flags && in->flags[v] & PACKING_FIXED) ||
           (in->open && !bbox_contains(bbox_grow(in->domain, -in->spacing[v]), in->position[v]));
}

typedef enum edge_kind { EDGE_MANIFOLD, EDGE_SEAM, EDGE_FAULTY } edge_kind;

/* The edge from v, which has the wedges w, to `other`. */
static edge_kind kind_of_edge(const fault_search *f, uint32_t v, const wedge *w, size_t count, uint32_t other)
{
    size_t first = 0, second = 0;
    for (size_t k = 0; k < count; k++) {
        first += w[k].from == other;
        second += w[k].to == other;
    }
    if (first == 1 && second == 1) return EDGE_MANIFOLD;
    const size_t steps = steps_between(f, v, other);
    if (first > 1 || second > 1) return first + second == steps ? EDGE_SEAM : EDGE_FAULTY;
    return steps == 1 || (is_at_boundary(f->in, v) && is_at_boundary(f->in, other)) ? EDGE_MANIFOLD
                                                                                    : EDGE_FAULTY;
}

/* Whether the wedges of a vertex, whose edges are manifold, form one fan: walks from the first one forwards,
 * then backwards. */
static bool is_one_fan(const wedge *w, size_t count)
{
    size_t seen = 1;
    uint32_t end = w[0].to, begin = w[0].from;
    for (size_t k = 0; k < count && end != begin;)
        if (w[k].from == end) {
            end = w[k].to;
            seen++;
            k = 0;
        } else
            k++;
    for (size_t k = 0; k < count && end != begin;)
        if (w[k].to == begin) {
            begin = w[k].from;
            seen++;
            k = 0;
        } else
            k++;
    return seen == count;
}

static bool is_faulty(const fault_search *f, uint32_t v)
{
    const wedge *w = f->wedge + f->begin[v];
    const size_t count = f->begin[v + 1] - f->begin[v];
    bool has_seam = false;
    for (size_t k = 0; k < 2 * count; k++) {
        const edge_kind kind = kind_of_edge(f, v, w, count, k % 2 ? w[k / 2].to : w[k / 2].from);
        if (kind == EDGE_FAULTY) return true;
        has_seam |= kind == EDGE_SEAM;
    }
    return count == 0 || (!has_seam && !is_one_fan(w, count));
}

bool mesh_faults_mark(const triangulation_input *in, const triangulation *made, bool *faulty, size_t *count,
                      error *e)
{
    fault_search f = {.in = in};
    const bool ok = list_steps(&f, e) && list_wedges(&f, made, e);
    *count = 0;
    for (uint32_t v = 0; ok && v < in->points; v++) *count += faulty[v] = is_faulty(&f, v);
    free(f.begin);
    free(f.wedge);
    free(f.step);
    return ok;
}

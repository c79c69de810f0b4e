// SPDX-License-Identifier: Apache-2.0
#include "surface/levelset/mesh_repair.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/sets.h"
#include "geometry/space/bbox.h"
#include "geometry/mesh/mesh_edges.h"
#include "geometry/mesh/orientation.h"

static const char what[] = "the edges of the mesh";

enum { CHUNK = 4096 }; /* vertices, or triangles, of a task */

typedef struct component {
    uint32_t root; /* its representative triangle; after sorting, its first one */
    uint32_t size, turned;
    bool one_sided, inside_out, cavity;
    double volume; /* signed, by its own orientation, in units of the mesh */
    bbox box;
    uint32_t solid;
} component;

typedef struct component_check {
    mesh *m;
    const mesh_repair_input *in;
    mesh_notes *notes;
    const mesh_edges *edges;
    mesh_edges listed_edges; /* if they were not given */
    orientation turned;      /* of connected triangles */
    uint32_t *number;        /* per triangle: its component */
    component *components;
    size_t component_count;
    size_t holes;
} component_check;

/* ---- edges */

/* At an edge of more than two triangles the neighbours are ambiguous. Components with an odd number of
 * triangles there cannot be closed alone, so they are joined in pairs. `odd` is zero for every triangle,
 * before and after. */
static void join_odd(component_check *j, const mesh_side *s, size_t count, int32_t *odd)
{
    bool turned;
    size_t waiting = count;
    for (size_t k = 0; k < count; k++) {
        uint32_t root = orientation_find(&j->turned, s[k].triangle, &turned);
        odd[root] = odd[root] ? 0 : (int32_t)k + 1;
    }
    for (size_t k = 0; k < count; k++) { /* an odd component is marked at its last triangle */
        uint32_t root = orientation_find(&j->turned, s[k].triangle, &turned);
        if (odd[root] != (int32_t)k + 1) continue;
        odd[root] = 0;
        if (waiting == count) {
            waiting = k;
            continue;
        }
        orientation_join(&j->turned, s[waiting].triangle, s[k].triangle, s[waiting].upwards == s[k].upwards);
        waiting = count;
    }
}

/* A component whose triangles have an edge unequally often in both directions has no winding number. `sum`
 * is used like `odd`. */
static void check_balance(component_check *j, const mesh_side *s, size_t count, int32_t *sum)
{
    bool turned;
    for (size_t k = 0; k < count; k++) {
        uint32_t root = orientation_find(&j->turned, s[k].triangle, &turned);
        sum[root] += turned == s[k].upwards ? 1 : -1;
    }
    for (size_t k = 0; k < count; k++) {
        uint32_t root = orientation_find(&j->turned, s[k].triangle, &turned);
        if (sum[root] != 0) j->turned.conflict[root] = true;
        sum[root] = 0;
    }
}

/* A set of boundary edges connected by vertices. */
typedef struct hole {
    size_t edges;
    bbox box;
} hole;

static int by_edges(const void *left, const void *right)
{
    const hole *a = left, *b = right;
    if (a->edges != b->edges) return a->edges > b->edges ? -1 : 1;
    return (a->box.min.x > b->box.min.x) - (a->box.min.x < b->box.min.x);
}

static bool find_holes(component_check *j, const seam_edge *open, size_t count, hole **out, error *e)
{
    uint32_t *up = mem_array(j->m->vertex_count, sizeof *up, what, e);
    uint32_t *number = mem_array(j->m->vertex_count, sizeof *number, what, e);
    hole *holes = mem_array(count, sizeof *holes, what, e);
    bool ok = up && number && holes;
    if (ok) {
        sets_reset(up, j->m->vertex_count);
        for (size_t k = 0; k < count; k++) sets_join(up, open[k].from, open[k].to);
        for (size_t k = 0; k < count; k++) {
            uint32_t *n = &number[sets_root(up, open[k].from)];
            if (*n == 0) {
                holes[j->holes].box = bbox_empty();
                *n = (uint32_t)++j->holes;
            }
            hole *h = &holes[*n - 1];
            h->edges++;
            h->box = bbox_include(bbox_include(h->box, j->m->vertex[open[k].from]), j->m->vertex[open[k].to]);
        }
        qsort(holes, j->holes, sizeof *holes, by_edges);
        *out = holes;
    }
    free(up);
    free(number);
    if (!ok) free(holes);
    return ok;
}

/* Prints the boxes of the largest holes, in coordinates of the file. */
static void print_holes(const component_check *j, const hole *holes, char *text, size_t size)
{
    enum { MOST_TOLD = 4 };
    const double *m = j->in->index_to_world;
    size_t at = 0;
    for (size_t k = 0; k < j->holes && k < MOST_TOLD && at < size; k++) {
        const bbox b = holes[k].box;
        at += (size_t)snprintf(
            text + at, size - at, "%s%zu edges within [%.5g, %.5g, %.5g] to [%.5g, %.5g, %.5g]",
            k ? "; " : "", holes[k].edges, m[0] * b.min.x + m[3], m[5] * b.min.y + m[7],
            m[10] * b.min.z + m[11], m[0] * b.max.x + m[3], m[5] * b.max.y + m[7], m[10] * b.max.z + m[11]);
    }
    if (j->holes > MOST_TOLD && at < size)
        snprintf(text + at, size - at, "; and %zu more", j->holes - MOST_TOLD);
}

static bool not_closed(component_check *j, error *e)
{
    char odd[128] = "", where[640] = "";
    seam_edge *open;
    size_t count;
    hole *holes = NULL;
    if (!mesh_edges_open(j->edges, &open, &count, e)) return false;
    bool ok = find_holes(j, open, count, &holes, e);
    free(open);
    if (!ok) return false;
    print_holes(j, holes, where, sizeof where);
    free(holes);
    if (j->edges->odd)
        snprintf(odd, sizeof odd, "%s%zu edges at which an odd number of triangles, three or more, meet",
                 j->edges->open ? " and " : "", j->edges->odd);
    if (!j->edges->open)
        return error_set(e, ERROR_INPUT_UNSUPPORTED,
                         "the mesh encloses no volume: it has %s, where walls within it end: remove them",
                         odd);
    return error_set(
        e, ERROR_INPUT_UNSUPPORTED,
        "the mesh is open, so it encloses no volume: it has %zu boundary edges around %zu hole%s%s: "
        "\"holes\": \"fill\" closes them; %s",
        j->edges->open, j->holes, j->holes == 1 ? "" : "s", odd, where);
}

static bool join_at_edges(component_check *j, error *e)
{
    enum { PAIRS, BRANCHES, CHECK, PASSES }; /* pairs first: they determine the components */
    int32_t *mark = mem_array(j->m->triangle_count, sizeof *mark, what, e);
    if (!mark) return false;
    for (int pass = PAIRS; pass < PASSES; pass++)
        for (size_t v = 0; v < j->m->vertex_count; v++)
            for (size_t k = j->edges->first[v], n; k < j->edges->first[v + 1]; k += n) {
                const mesh_side *s = j->edges->sides + k;
                n = mesh_edges_width(j->edges, v, k);
                if (pass == PAIRS && n == 2)
                    orientation_join(&j->turned, s[0].triangle, s[1].triangle, s[0].upwards == s[1].upwards);
                if (pass == BRANCHES && n > 2) join_odd(j, s, n, mark);
                if (pass == CHECK && n > 2) check_balance(j, s, n, mark);
            }
    bool turned;
    for (uint32_t n = 0; n < j->m->triangle_count; n++) orientation_find(&j->turned, n, &turned);
    free(mark);
    return true;
}

static void join_chunk(void *context, int worker, size_t begin, size_t end)
{
    const component_check *j = context;
    (void)worker;
    for (size_t k = j->edges->first[begin]; k < j->edges->first[end]; k += 2)
        sets_join_shared(j->turned.parent, j->edges->sides[k].triangle, j->edges->sides[k + 1].triangle);
}

static void flatten_chunk(void *context, int worker, size_t begin, size_t end)
{
    const component_check *j = context;
    (void)worker;
    for (size_t n = begin; n < end; n++) sets_flatten_shared(j->turned.parent, (uint32_t)n);
}

/* Finds the connected components; in parallel if every edge has two triangles of consistent orientation,
 * as in most meshes. */
static bool join_triangles(component_check *j, error *e)
{
    const mesh_edges *edges = j->edges;
    if (edges->open || edges->odd) return not_closed(j, e);
    if (edges->branching || edges->against) return join_at_edges(j, e);
    threads_run(j->in->pool, j->m->vertex_count, CHUNK, join_chunk, j);
    threads_run(j->in->pool, j->m->triangle_count, CHUNK, flatten_chunk, j);
    return threads_may_go_on(j->in->pool, e);
}

/* ---- components */

static void turn_triangle(uint32_t t[3])
{
    uint32_t swap = t[1];
    t[1] = t[2];
    t[2] = swap;
}

/* Turns the minority of the triangles of each component. */
static void orient(component_check *j)
{
    size_t total = 0, turned_ones = 0;
    for (size_t c = 0; c < j->component_count; c++) turned_ones += j->components[c].turned;
    for (uint32_t n = 0; turned_ones && n < j->m->triangle_count; n++) {
        component *c = &j->components[j->number[n]];
        bool turned;
        orientation_find(&j->turned, n, &turned);
        if (c->one_sided || turned != (2 * (size_t)c->turned <= c->size)) continue;
        turn_triangle(j->m->triangle[n]);
        total++;
    }
    if (total)
        mesh_note(j->notes, "%zu of %zu triangles are oriented against their neighbours: turned", total,
                  j->m->triangle_count);
}

/* Consecutive triangles are mostly of one component. */
static void number_chunk(void *context, int worker, size_t begin, size_t end)
{
    component_check *j = context;
    (void)worker;
    for (size_t n = begin, next; n < end; n = next) {
        const uint32_t root = j->turned.parent[n], number = j->number[root];
        uint32_t turned = 0;
        for (next = n; next < end && j->turned.parent[next] == root; next++) {
            if (next != root) j->number[next] = number;
            turned += j->turned.turned[next];
        }
        __atomic_fetch_add(&j->components[number].size, (uint32_t)(next - n), __ATOMIC_RELAXED);
        __atomic_fetch_add(&j->components[number].turned, turned, __ATOMIC_RELAXED);
    }
}

/* Numbers the components, after each triangle's parent is its root. */
static bool number_components(component_check *j, error *e)
{
    const size_t count = j->m->triangle_count;
    j->number = mem_array(count, sizeof *j->number, what, e);
    if (!j->number) return false;
    for (uint32_t n = 0; n < count; n++)
        if (j->turned.parent[n] == n) j->number[n] = (uint32_t)j->component_count++;
    j->components = mem_array(j->component_count, sizeof *j->components, what, e);
    if (!j->components) return false;
    for (uint32_t n = 0, found = 0; found < j->component_count; n++)
        if (j->turned.parent[n] == n)
            j->components[found++] = (component){.root = n, .one_sided = j->turned.conflict[n]};
    threads_run(j->in->pool, count, CHUNK, number_chunk, j);
    return threads_may_go_on(j->in->pool, e);
}

/* Sorts the triangles by component. `rank`: the position of each component. */
static bool sort_triangles(component_check *j, const uint32_t *rank, error *e)
{
    mesh *m = j->m;
    if (j->component_count == 1) {
        j->components[0].root = 0;
        return true;
    }
    uint32_t(*sorted)[3] = mem_array(m->triangle_count, sizeof *sorted, what, e);
    uint32_t *number = mem_array(m->triangle_count, sizeof *number, what, e);
    size_t *place = mem_array(j->component_count + 1, sizeof *place, what, e);
    bool ok = sorted && number && place;
    if (ok) {
        for (size_t c = 0; c < j->component_count; c++) place[rank[c] + 1] = j->components[c].size;
        for (size_t c = 1; c <= j->component_count; c++) place[c] += place[c - 1];
        for (size_t c = 0; c < j->component_count; c++) j->components[c].root = (uint32_t)place[rank[c]];
        for (size_t n = 0; n < m->triangle_count; n++) {
            size_t to = place[rank[j->number[n]]]++;
            memcpy(sorted[to], m->triangle[n], sizeof sorted[to]);
            number[to] = j->number[n];
        }
        free(m->triangle);
        free(j->number);
        m->triangle = sorted;
        j->number = number;
    } else {
        free(sorted);
        free(number);
    }
    free(place);
    return ok;
}

/* Maximum number of triangles of a part of a component. Sums are taken per part, so that they do not
 * depend on the number of threads. */
enum { PART = 1 << 16 };

typedef struct part {
    double volume;
    bbox box;
} part;

typedef struct parts_job {
    const mesh *m;
    const component *of;
    part *parts;
} parts_job;

static void measure_part(void *context, int worker, size_t k, size_t end)
{
    const parts_job *w = context;
    const vec3 *vertex = w->m->vertex, origin = vertex[w->m->triangle[w->of->root][0]];
    (void)worker;
    for (; k < end; k++) {
        part sum = {0, bbox_empty()};
        const size_t first = k * PART, after = w->of->size - first < PART ? w->of->size : first + PART;
        for (size_t n = w->of->root + first; n < w->of->root + after; n++) {
            vec3 p[3];
            for (int c = 0; c < 3; c++) {
                const vec3 v = vertex[w->m->triangle[n][c]];
                sum.box = bbox_include(sum.box, v);
                p[c] = vec3_sub(v, origin);
            }
            sum.volume += vec3_dot(p[0], vec3_cross(p[1], p[2])) / 6;
        }
        w->parts[k] = sum;
    }
}

static bool measure_components(component_check *j, error *e)
{
    part *parts = mem_array(j->m->triangle_count / PART + 1, sizeof *parts, what, e);
    for (size_t k = 0; parts && k < j->component_count; k++) {
        component *c = &j->components[k];
        const size_t count = (c->size + PART - 1) / PART;
        c->box = bbox_empty();
        threads_run(j->in->pool, count, 1, measure_part, &(parts_job){j->m, c, parts});
        for (size_t i = 0; i < count; i++) {
            c->volume += parts[i].volume;
            c->box = bbox_unite(c->box, parts[i].box);
        }
    }
    free(parts);
    if (parts && threads_stopped(j->in->pool)) return error_set(e, ERROR_CANCELLED, "stopped");
    return parts;
}

/* ---- nesting of components */

static bool holds_point(const component_check *j, const component *c, vec3 p, winding_point at)
{
    if (!bbox_contains(c->box, p)) return false;
    int winding = 0, crossings = 0;
    for (uint32_t n = c->root; n < c->root + c->size; n++) {
        const uint32_t *t = j->m->triangle[n];
        const vec3 *v = j->m->vertex;
        const winding_point q[3] = {winding_fix(v[t[0]]), winding_fix(v[t[1]]), winding_fix(v[t[2]])};
        double z;
        int sign = winding_cross(&q[0], &q[1], &q[2], at.x, at.y, &z);
        if (!sign || z <= at.z) continue;
        winding += sign;
        crossings++;
    }
    return c->one_sided ? crossings & 1 : winding != 0;
}

/* Whether `inner` lies inside `outer`, by the majority of three of its triangles: one of them may touch
 * it. */
static bool holds(const component_check *j, const component *outer, const component *inner)
{
    if (!(inner->box.min.x >= outer->box.min.x && inner->box.max.x <= outer->box.max.x &&
          inner->box.min.y >= outer->box.min.y && inner->box.max.y <= outer->box.max.y &&
          inner->box.min.z >= outer->box.min.z && inner->box.max.z <= outer->box.max.z))
        return false;
    int within = 0;
    for (uint32_t k = 0; k < 3; k++) {
        const uint32_t *t = j->m->triangle[inner->root + k * (inner->size - 1) / 2];
        const vec3 *v = j->m->vertex;
        vec3 p = vec3_scale(vec3_add(v[t[0]], vec3_add(v[t[1]], v[t[2]])), 1.0 / 3);
        within += holds_point(j, outer, p, winding_fix(p));
    }
    return within >= 2;
}

static int by_volume(const void *left, const void *right)
{
    const component *const *a = left, *const *b = right;
    double va = fabs((*a)->volume), vb = fabs((*b)->volume);
    if (va != vb) return va > vb ? -1 : 1;
    return (*a > *b) - (*a < *b);
}

/* Classifies a component, after the component around it (NULL: none). */
static void settle_component(component *c, const component *around, uint32_t *solids)
{
    if (c->one_sided) {
        c->solid = (*solids)++;
        return;
    }
    double volume = around && around->inside_out ? -c->volume : c->volume;
    c->inside_out = around ? around->inside_out : volume < 0;
    if (around && volume < 0 && !around->cavity && !around->one_sided) {
        c->cavity = true;
        c->solid = around->solid;
        return;
    }
    if (around && volume < 0) c->inside_out = !c->inside_out;
    c->solid = (*solids)++;
}

static bool nest(component_check *j, uint32_t *solids, error *e)
{
    component **order = mem_array(j->component_count, sizeof *order, what, e);
    if (!order) return false;
    for (size_t c = 0; c < j->component_count; c++) order[c] = &j->components[c];
    qsort(order, j->component_count, sizeof *order, by_volume);
    size_t inside_out = 0, nested = 0, one_sided = 0;
    for (size_t k = 0; k < j->component_count; k++) {
        component *c = order[k], *around = NULL;
        for (size_t i = k; i > 0 && !around; i--)
            if (holds(j, order[i - 1], c)) around = order[i - 1];
        settle_component(c, around, solids);
        one_sided += c->one_sided;
        inside_out += c->inside_out;
        nested += around && !c->cavity && !around->cavity;
    }
    if (inside_out)
        mesh_note(j->notes, "%zu of %zu shells are inside out: turned", inside_out, j->component_count);
    if (one_sided)
        mesh_note(
            j->notes,
            "%zu of %zu shells have triangles that cannot all be turned to agree: what is inside them is "
            "decided by counting crossings",
            one_sided, j->component_count);
    if (nested)
        mesh_note(j->notes,
                  "%zu of %zu shells lie within others of the same orientation: they are in the solid and do "
                  "not show",
                  nested, j->component_count);
    free(order);
    return true;
}

static bool gather_solids(component_check *j, uint32_t solids, mesh_solids *out, error *e)
{
    uint32_t *rank = mem_array(j->component_count, sizeof *rank, what, e);
    out->first = mem_array(solids + 1, sizeof *out->first, what, e);
    out->one_sided = mem_array(solids, sizeof *out->one_sided, what, e);
    out->solid_count = solids;
    uint32_t *place = mem_array(solids + 1, sizeof *place, what, e);
    bool ok = rank && out->first && out->one_sided && place;
    if (ok) {
        for (size_t c = 0; c < j->component_count; c++) {
            const component *at = &j->components[c];
            out->first[at->solid + 1] += at->size;
            place[at->solid + 1]++;
            out->one_sided[at->solid] |= at->one_sided;
        }
        for (uint32_t s = 0; s < solids; s++) {
            out->first[s + 1] += out->first[s];
            place[s + 1] += place[s];
        }
        for (size_t c = 0; c < j->component_count; c++) rank[c] = place[j->components[c].solid]++;
        for (uint32_t n = 0; n < j->m->triangle_count; n++)
            if (j->components[j->number[n]].inside_out) turn_triangle(j->m->triangle[n]);
        ok = sort_triangles(j, rank, e);
    }
    free(rank);
    free(place);
    return ok;
}

static bool settle(component_check *j, mesh_solids *out, error *e)
{
    uint32_t solids = 0;
    j->edges = mesh_edges_close_seams(j->m, j->in->edges, j->in->tolerance, j->in->pool, &j->listed_edges,
                                      j->notes, e);
    if (!j->edges || !orientation_init(&j->turned, j->m->triangle_count, e) || !join_triangles(j, e) ||
        !number_components(j, e))
        return false;
    if (j->edges->branching)
        mesh_note(j->notes,
                  "%zu edges at which four or more triangles meet: the mesh is closed but not manifold",
                  j->edges->branching);
    j->edges = NULL;
    mesh_edges_free(&j->listed_edges);
    orient(j);
    uint32_t *rank = mem_array(j->component_count, sizeof *rank, what, e);
    if (!rank) return false;
    for (uint32_t c = 0; c < j->component_count; c++) rank[c] = c;
    bool ok = sort_triangles(j, rank, e);
    free(rank);
    return ok && measure_components(j, e) && nest(j, &solids, e) && gather_solids(j, solids, out, e);
}

bool mesh_repair_solids(mesh *m, const mesh_repair_input *in, mesh_solids *out, mesh_notes *notes, error *e)
{
    component_check j = {.m = m, .in = in, .notes = notes};
    mesh_solids t = {0};
    bool ok = settle(&j, &t, e);
    mesh_edges_free(&j.listed_edges);
    orientation_free(&j.turned);
    free(j.number);
    free(j.components);
    if (ok)
        *out = t;
    else
        mesh_solids_free(&t);
    return ok;
}

void mesh_solids_free(mesh_solids *t)
{
    free(t->first);
    free(t->one_sided);
    *t = (mesh_solids){0};
}

#include "mesh/mesh_repair.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sets.h"
#include "geometry/bbox.h"
#include "mesh/seams.h"

static const char what[] = "the edges of the mesh";

/* A triangle's way along an edge. */
typedef struct side {
    uint32_t other; /* the edge's higher vertex; the lower one tells where the side stands */
    uint32_t triangle;
    bool upwards; /* from the lower vertex to the higher one */
} side;

typedef struct component {
    uint32_t root; /* the triangle that stands for it; once they are sorted, its first one */
    uint32_t size, turned;
    bool one_sided, inside_out, cavity;
    double volume; /* of its own orientation, in the mesh's units */
    bbox box;
    uint32_t solid;
} component;

typedef struct judging {
    mesh *m;
    const winding_point *fixed;
    const mesh_place *place;
    mesh_notes *notes;
    /* sides by their lower vertex: sides[first[v]] .. sides[first[v + 1]], by the other vertex */
    side *sides;
    size_t *first;
    /* forest of triangles; `turned`: against the parent's orientation */
    uint32_t *parent;
    bool *turned, *conflict;
    uint32_t *number; /* of a triangle's component */
    component *components;
    size_t component_count;
    size_t boundary_edges, odd_edges, branching_edges, holes;
} judging;

/* ---- the forest */

static uint32_t find(judging *j, uint32_t n, bool *turned)
{
    uint32_t root = n;
    bool all = false;
    while (j->parent[root] != root) {
        all ^= j->turned[root];
        root = j->parent[root];
    }
    *turned = all;
    while (j->parent[n] != root && n != root) { /* the way is made short */
        uint32_t next = j->parent[n];
        bool rest = all ^ j->turned[n];
        j->parent[n] = root;
        j->turned[n] = all;
        all = rest;
        n = next;
    }
    return root;
}

/* Puts two triangles into one component; `against`: one of them must be turned for both to agree. */
static void join(judging *j, uint32_t a, uint32_t b, bool against)
{
    bool ta, tb;
    uint32_t ra = find(j, a, &ta), rb = find(j, b, &tb);
    bool differs = ta ^ tb ^ against;
    if (ra == rb) {
        if (differs) j->conflict[ra] = true;
        return;
    }
    uint32_t low = ra < rb ? ra : rb, high = ra < rb ? rb : ra;
    j->parent[high] = low;
    j->turned[high] = differs;
    j->conflict[low] |= j->conflict[high];
}

/* ---- edges */

static int by_other(const void *left, const void *right)
{
    const side *a = left, *b = right;
    if (a->other != b->other) return a->other < b->other ? -1 : 1;
    return (a->triangle > b->triangle) - (a->triangle < b->triangle);
}

static bool list_sides(judging *j, error *e)
{
    const mesh *m = j->m;
    free(j->sides);
    free(j->first);
    j->first = NULL;
    j->sides = mem_array(3 * m->triangle_count, sizeof *j->sides, what, e);
    j->first = mem_array(m->vertex_count + 2, sizeof *j->first, what, e);
    if (!j->sides || !j->first) return false;
    /* counted two ahead; after the sums the starts are one ahead, and filling moves them to their places */
    for (size_t n = 0; n < m->triangle_count; n++)
        for (int k = 0; k < 3; k++) {
            uint32_t a = m->triangle[n][k], b = m->triangle[n][(k + 1) % 3];
            j->first[(a < b ? a : b) + 2]++;
        }
    for (size_t v = 2; v < m->vertex_count + 2; v++) j->first[v] += j->first[v - 1];
    for (uint32_t n = 0; n < m->triangle_count; n++)
        for (int k = 0; k < 3; k++) {
            uint32_t a = m->triangle[n][k], b = m->triangle[n][(k + 1) % 3], low = a < b ? a : b;
            j->sides[j->first[low + 1]++] = (side){a < b ? b : a, n, a < b};
        }
    for (size_t v = 0; v < m->vertex_count; v++)
        qsort(j->sides + j->first[v], j->first[v + 1] - j->first[v], sizeof *j->sides, by_other);
    return true;
}

/* More than two triangles at an edge: which of them are neighbours is not said. Components that have an odd
 * number of them there cannot be closed alone, so these are joined two by two. `odd` is zero for every
 * triangle, before and after. */
static void join_odd(judging *j, const side *s, size_t count, int32_t *odd)
{
    bool turned;
    size_t waiting = count;
    for (size_t k = 0; k < count; k++) {
        uint32_t root = find(j, s[k].triangle, &turned);
        odd[root] = odd[root] ? 0 : (int32_t)k + 1;
    }
    for (size_t k = 0; k < count; k++) { /* what is odd has its mark at its last triangle */
        uint32_t root = find(j, s[k].triangle, &turned);
        if (odd[root] != (int32_t)k + 1) continue;
        odd[root] = 0;
        if (waiting == count) {
            waiting = k;
            continue;
        }
        join(j, s[waiting].triangle, s[k].triangle, s[waiting].upwards == s[k].upwards);
        waiting = count;
    }
}

/* A component whose triangles do not come and go alike along an edge has no winding number. `sum` is like
 * `odd`. */
static void check_balance(judging *j, const side *s, size_t count, int32_t *sum)
{
    bool turned;
    for (size_t k = 0; k < count; k++) {
        uint32_t root = find(j, s[k].triangle, &turned);
        sum[root] += turned == s[k].upwards ? 1 : -1;
    }
    for (size_t k = 0; k < count; k++) {
        uint32_t root = find(j, s[k].triangle, &turned);
        if (sum[root] != 0) j->conflict[root] = true;
        sum[root] = 0;
    }
}

static size_t edge_length(const side *s, size_t left)
{
    size_t n = 1;
    while (n < left && s[n].other == s[0].other) n++;
    return n;
}

static bool list_boundary(const judging *j, seam_edge **out, size_t *count, error *e)
{
    seam_edge *list = NULL;
    *count = 0;
    for (int pass = 0; pass < 2; pass++) {
        if (pass && !(list = mem_array(*count, sizeof *list, what, e))) return false;
        *count = 0;
        for (uint32_t v = 0; v < j->m->vertex_count; v++)
            for (size_t k = j->first[v], n; k < j->first[v + 1]; k += n) {
                const side *s = j->sides + k;
                n = edge_length(s, j->first[v + 1] - k);
                if (n != 1) continue;
                if (pass)
                    list[*count] =
                        (seam_edge){s->upwards ? v : s->other, s->upwards ? s->other : v, s->triangle};
                ++*count;
            }
    }
    *out = list;
    return true;
}

/* First vertices meet vertices; then each round splits one edge of a triangle. */
static bool close_seams(judging *j, error *e)
{
    enum { MOST_ROUNDS = 9 };
    const double tolerance = j->place->tolerance;
    size_t joined = 0, split = 0, changed = 1;
    for (int round = 0; changed && round < MOST_ROUNDS; round++) {
        const size_t before = split;
        seam_edge *open;
        size_t count;
        if (!list_boundary(j, &open, &count, e)) return false;
        bool ok = round == 0 ? seams_join(j->m, open, count, tolerance, &joined, e)
                             : seams_split(j->m, open, count, tolerance, &split, e);
        free(open);
        changed = count > 0 && (round == 0 || split > before);
        if (!ok || (changed && !list_sides(j, e))) return false;
    }
    if (joined)
        mesh_note(j->notes, "%zu vertices of open edges lie as near to others as rounding: joined", joined);
    if (split)
        mesh_note(j->notes, "%zu triangles have vertices of others on their open edges: split there", split);
    return true;
}

/* A set of boundary edges that hang together by vertices. */
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

static bool find_holes(judging *j, const seam_edge *open, size_t count, hole **out, error *e)
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

/* Where the largest holes are, in the file's coordinates. */
static void print_holes(const judging *j, const hole *holes, char *text, size_t size)
{
    enum { MOST_TOLD = 4 };
    const double *m = j->place->index_to_world;
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

static bool not_closed(judging *j, error *e)
{
    char odd[128] = "", where[640] = "";
    seam_edge *open;
    size_t count;
    hole *holes = NULL;
    if (!list_boundary(j, &open, &count, e)) return false;
    bool ok = find_holes(j, open, count, &holes, e);
    free(open);
    if (!ok) return false;
    print_holes(j, holes, where, sizeof where);
    free(holes);
    if (j->odd_edges)
        snprintf(odd, sizeof odd, "%s%zu edges at which an odd number of triangles, three or more, meet",
                 j->boundary_edges ? " and " : "", j->odd_edges);
    if (!j->boundary_edges)
        return error_set(e, ERROR_INPUT_UNSUPPORTED,
                         "the mesh encloses no volume: it has %s, where walls within it end: remove them",
                         odd);
    return error_set(
        e, ERROR_INPUT_UNSUPPORTED,
        "the mesh is open, so it encloses no volume: it has %zu boundary edges around %zu hole%s%s: close "
        "the holes (most mesh editors fill them) and submit it again; %s",
        j->boundary_edges, j->holes, j->holes == 1 ? "" : "s", odd, where);
}

static void count_edge(judging *j, size_t triangles)
{
    j->boundary_edges += triangles == 1;
    j->odd_edges += triangles % 2 && triangles > 1;
    j->branching_edges += triangles > 2;
}

static bool join_at_edges(judging *j, error *e)
{
    enum { PAIRS, BRANCHES, CHECK, PASSES }; /* pairs first: they say what hangs together elsewhere */
    int32_t *mark = mem_array(j->m->triangle_count, sizeof *mark, what, e);
    if (!mark) return false;
    for (int pass = PAIRS; pass < PASSES; pass++)
        for (size_t v = 0; v < j->m->vertex_count; v++)
            for (size_t k = j->first[v], n; k < j->first[v + 1]; k += n) {
                const side *s = j->sides + k;
                n = edge_length(s, j->first[v + 1] - k);
                if (pass == PAIRS) count_edge(j, n);
                if (pass == PAIRS && n == 2)
                    join(j, s[0].triangle, s[1].triangle, s[0].upwards == s[1].upwards);
                if (pass == BRANCHES && n > 2) join_odd(j, s, n, mark);
                if (pass == CHECK && n > 2) check_balance(j, s, n, mark);
            }
    free(mark);
    return (j->boundary_edges == 0 && j->odd_edges == 0) || not_closed(j, e);
}

/* ---- components */

static void turn_triangle(uint32_t t[3])
{
    uint32_t swap = t[1];
    t[1] = t[2];
    t[2] = swap;
}

/* Turns the minority of each component. */
static void orient(judging *j)
{
    size_t total = 0;
    for (uint32_t n = 0; n < j->m->triangle_count; n++) {
        component *c = &j->components[j->number[n]];
        bool turned;
        find(j, n, &turned);
        if (c->one_sided || turned != (2 * (size_t)c->turned <= c->size)) continue;
        turn_triangle(j->m->triangle[n]);
        total++;
    }
    if (total)
        mesh_note(j->notes, "%zu of %zu triangles are oriented against their neighbours: turned", total,
                  j->m->triangle_count);
}

static bool number_components(judging *j, error *e)
{
    const size_t count = j->m->triangle_count;
    bool turned;
    j->number = mem_array(count, sizeof *j->number, what, e);
    if (!j->number) return false;
    for (uint32_t n = 0; n < count; n++) /* a root is the lowest of its triangles, so it comes first */
        if (find(j, n, &turned) == n) j->number[n] = (uint32_t)j->component_count++;
    j->components = mem_array(j->component_count, sizeof *j->components, what, e);
    if (!j->components) return false;
    for (uint32_t n = 0; n < count; n++) {
        uint32_t root = find(j, n, &turned);
        component *c = &j->components[j->number[n] = j->number[root]];
        c->root = root;
        c->size++;
        c->turned += turned;
        c->one_sided = j->conflict[root];
    }
    return true;
}

/* Makes the triangles of a component neighbours in the list: `rank` gives each component's place. */
static bool sort_triangles(judging *j, const uint32_t *rank, error *e)
{
    mesh *m = j->m;
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

static void measure_component(const mesh *m, component *c)
{
    const vec3 origin = m->vertex[m->triangle[c->root][0]];
    c->box = bbox_empty();
    for (uint32_t n = c->root; n < c->root + c->size; n++) {
        vec3 p[3];
        for (int k = 0; k < 3; k++) {
            vec3 v = m->vertex[m->triangle[n][k]];
            c->box = bbox_include(c->box, v);
            p[k] = vec3_sub(v, origin);
        }
        c->volume += vec3_dot(p[0], vec3_cross(p[1], p[2])) / 6;
    }
}

/* ---- what lies in what */

static bool holds_point(const judging *j, const component *c, vec3 p, winding_point at)
{
    if (!bbox_contains(c->box, p)) return false;
    int winding = 0, crossings = 0;
    for (uint32_t n = c->root; n < c->root + c->size; n++) {
        const uint32_t *t = j->m->triangle[n];
        double z;
        int sign = winding_cross(&j->fixed[t[0]], &j->fixed[t[1]], &j->fixed[t[2]], at.x, at.y, &z);
        if (!sign || z <= at.z) continue;
        winding += sign;
        crossings++;
    }
    return c->one_sided ? crossings & 1 : winding != 0;
}

/* By most of three of its triangles: one may touch. */
static bool holds(const judging *j, const component *outer, const component *inner)
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

/* What a component is, once the one around it (NULL: none) is settled. */
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

static bool nest(judging *j, uint32_t *solids, error *e)
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

static bool gather_solids(judging *j, uint32_t solids, mesh_solids *out, error *e)
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

static bool settle(judging *j, mesh_solids *out, error *e)
{
    uint32_t solids = 0;
    if (!list_sides(j, e) || !close_seams(j, e)) return false;
    const size_t count = j->m->triangle_count;
    j->parent = mem_array(count, sizeof *j->parent, what, e);
    j->turned = mem_array(count, sizeof *j->turned, what, e);
    j->conflict = mem_array(count, sizeof *j->conflict, what, e);
    if (!j->parent || !j->turned || !j->conflict) return false;
    for (uint32_t n = 0; n < count; n++) j->parent[n] = n;
    if (!join_at_edges(j, e) || !number_components(j, e)) return false;
    if (j->branching_edges)
        mesh_note(j->notes,
                  "%zu edges at which four or more triangles meet: the mesh is closed but not manifold",
                  j->branching_edges);
    orient(j);
    uint32_t *rank = mem_array(j->component_count, sizeof *rank, what, e);
    if (!rank) return false;
    for (uint32_t c = 0; c < j->component_count; c++) rank[c] = c;
    bool ok = sort_triangles(j, rank, e);
    free(rank);
    if (!ok) return false;
    for (size_t c = 0; c < j->component_count; c++) measure_component(j->m, &j->components[c]);
    return nest(j, &solids, e) && gather_solids(j, solids, out, e);
}

bool mesh_repair_solids(mesh *m, const winding_point *fixed, const mesh_place *place, mesh_solids *out,
                        mesh_notes *notes, error *e)
{
    judging j = {.m = m, .fixed = fixed, .place = place, .notes = notes};
    mesh_solids t = {0};
    bool ok = settle(&j, &t, e);
    free(j.sides);
    free(j.first);
    free(j.parent);
    free(j.turned);
    free(j.conflict);
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

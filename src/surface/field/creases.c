// SPDX-License-Identifier: Apache-2.0
#include "surface/field/creases.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

static const char *const WHAT = "the creases";

/* Maximum number of patches that end along a segment. */
enum { ENDS = 4 };
typedef struct ends {
    int count;
    uint32_t patch[ENDS];
} ends;

/* An end of a segment: a vertex of the graph of segments. */
typedef struct joint {
    vec3 at;
    size_t segment;
    int end;
} joint;

typedef struct graph {
    const crease_segment *segment;
    size_t count;
    joint *joint;  /* 2 per segment, sorted by position */
    size_t *first; /* range of joints at the position of each segment end: first, and last plus 1 */
    size_t *past;
    bool *used;                       /* of each segment */
    size_t curves, vertices, patches; /* capacities */
    size_t vertex_count, patch_count;
} graph;

static int compare_segments(const void *a, const void *b)
{
    const crease_segment *p = a, *q = b;
    for (int k = 0; k < 2; k++)
        if (p->leaf[k] != q->leaf[k]) return p->leaf[k] < q->leaf[k] ? -1 : 1;
    int order = vec3_compare(p->end[0], q->end[0]);
    return order ? order : vec3_compare(p->end[1], q->end[1]);
}

static int compare_joints(const void *a, const void *b)
{
    const joint *p = a, *q = b;
    int order = vec3_compare(p->at, q->at);
    if (order) return order;
    return p->segment != q->segment ? (p->segment < q->segment ? -1 : 1) : p->end - q->end;
}

static bool is_corner(uint64_t on)
{
    return (on & (on - 1) & ((on & (on - 1)) - 1)) != 0; /* three leaves or more */
}

/* Each leaf computed its own copy of a corner: replaces copies within the tolerance by the first one. */
static bool unite_corners(crease_segment *segment, size_t count, double tolerance, error *e)
{
    size_t found = 0, room = 0;
    vec3 *corner = NULL;
    bool ok = true;
    for (size_t k = 0; ok && k < 2 * count; k++) {
        vec3 *x = &segment[k / 2].end[k % 2];
        size_t n = 0;
        if (!is_corner(segment[k / 2].on[k % 2])) continue;
        while (n < found && vec3_norm2(vec3_sub(corner[n], *x)) > tolerance * tolerance) n++;
        if (n < found) {
            *x = corner[n];
            continue;
        }
        if (!(ok = MEM_GROW(corner, found, &room, WHAT, e))) break;
        corner[found++] = *x;
    }
    free(corner);
    return ok;
}

/* Sorts the ends of each segment, and removes segments of length 0 and duplicates. */
static size_t tidy(crease_segment *segment, size_t count)
{
    size_t kept = 0;
    for (size_t k = 0; k < count; k++) {
        crease_segment s = segment[k];
        int order = vec3_compare(s.end[0], s.end[1]);
        if (order == 0) continue;
        if (order > 0) {
            segment[k].end[0] = s.end[1];
            segment[k].end[1] = s.end[0];
            segment[k].on[0] = s.on[1];
            segment[k].on[1] = s.on[0];
        }
        segment[kept++] = segment[k];
    }
    if (kept > 0) qsort(segment, kept, sizeof *segment, compare_segments);
    count = kept;
    kept = 0;
    for (size_t k = 0; k < count; k++) {
        if (k + 1 < count && compare_segments(&segment[k], &segment[k + 1]) == 0)
            k++;
        else
            segment[kept++] = segment[k];
    }
    return kept;
}

static void add_end(ends *e, const uint32_t *patch_of, int leaf, int surface)
{
    uint32_t patch = surface ? patch_of[2 * leaf + (surface < 0)] : UINT32_MAX;
    if (patch != UINT32_MAX) e->patch[e->count++] = patch;
}

static ends ends_of(const solid *s, const crease_segment *segment, const uint32_t *patch_of)
{
    ends e = {0};
    for (int k = 0; k < 2; k++) {
        const int leaf = segment->leaf[k];
        const uint64_t other = (uint64_t)1 << segment->leaf[!k];
        int in = solid_surface(s, leaf, segment->sides | other),
            out = solid_surface(s, leaf, segment->sides & ~other);
        if (in == out) continue; /* the surface continues */
        add_end(&e, patch_of, leaf, in);
        add_end(&e, patch_of, leaf, out);
    }
    return e;
}

/* The next segment of the curve at an end, or SIZE_MAX if the curve ends there. */
static size_t next_of(const graph *g, const solid *s, const uint32_t *patch_of, size_t segment, int end)
{
    size_t first = g->first[2 * segment + (size_t)end];
    if (g->past[2 * segment + (size_t)end] - first != 2) return SIZE_MAX;
    size_t other = g->joint[first].segment == segment ? g->joint[first + 1].segment : g->joint[first].segment;
    const crease_segment *a = &g->segment[segment], *b = &g->segment[other];
    if (other == segment || a->leaf[0] != b->leaf[0] || a->leaf[1] != b->leaf[1]) return SIZE_MAX;
    ends p = ends_of(s, a, patch_of), q = ends_of(s, b, patch_of);
    return memcmp(&p, &q, sizeof p) == 0 ? other : SIZE_MAX;
}

static bool find_joints(graph *g, error *e)
{
    g->joint = mem_array(2 * g->count, sizeof *g->joint, WHAT, e);
    g->first = mem_array(2 * g->count, sizeof *g->first, WHAT, e);
    g->past = mem_array(2 * g->count, sizeof *g->past, WHAT, e);
    g->used = mem_array(g->count, sizeof *g->used, WHAT, e);
    if (!g->joint || !g->first || !g->past || !g->used) return false;
    for (size_t k = 0; k < 2 * g->count; k++)
        g->joint[k] = (joint){g->segment[k / 2].end[k % 2], k / 2, (int)(k % 2)};
    if (g->count > 0) qsort(g->joint, 2 * g->count, sizeof *g->joint, compare_joints);
    for (size_t k = 0, past; k < 2 * g->count; k = past) {
        for (past = k + 1; past < 2 * g->count && vec3_compare(g->joint[k].at, g->joint[past].at) == 0;)
            past++;
        for (size_t n = k; n < past; n++) {
            const size_t at = 2 * g->joint[n].segment + (size_t)g->joint[n].end;
            g->first[at] = k;
            g->past[at] = past;
        }
    }
    return true;
}

static bool add_vertex(graph *g, vec3 x, field_patches *out, error *e)
{
    if (!MEM_GROW(out->vertex, g->vertex_count, &g->vertices, WHAT, e)) return false;
    out->vertex[g->vertex_count++] = x;
    return true;
}

/* Starts a curve with a segment, from one of its ends. */
static field_curve *add_curve(graph *g, const solid *s, const uint32_t *patch_of, size_t segment,
                              field_patches *out, error *e)
{
    if (!MEM_GROW(out->curve, out->curve_count, &g->curves, WHAT, e)) return NULL;
    ends end = ends_of(s, &g->segment[segment], patch_of);
    field_curve *c = &out->curve[out->curve_count];
    *c = (field_curve){.first = g->vertex_count, .patch_first = g->patch_count};
    for (int k = 0; k < 2; k++) c->on[k] = &s->leaf[g->segment[segment].leaf[k]].base;
    for (int k = 0; k < end.count; k++) {
        if (!MEM_GROW(out->curve_patch, g->patch_count, &g->patches, WHAT, e)) return NULL;
        out->curve_patch[g->patch_count++] = end.patch[k];
        c->patch_count++;
    }
    out->curve_count++;
    return c;
}

/* Traces the curve of a segment from its end `from`. */
static bool follow(graph *g, const solid *s, const uint32_t *patch_of, size_t segment, int from,
                   field_patches *out, error *e)
{
    const size_t begin = segment;
    field_curve *c = add_curve(g, s, patch_of, segment, out, e);
    if (!c || !add_vertex(g, g->segment[segment].end[from], out, e)) return false;
    while (segment != SIZE_MAX && !g->used[segment]) {
        vec3 to = g->segment[segment].end[!from];
        g->used[segment] = true;
        size_t next = next_of(g, s, patch_of, segment, !from);
        if (next == begin) {
            c->closed = true;
            break;
        }
        if (!add_vertex(g, to, out, e)) return false;
        segment = next;
        if (next != SIZE_MAX) from = vec3_compare(g->segment[next].end[0], to) != 0;
    }
    c->count = g->vertex_count - c->first;
    return true;
}

bool creases_join(const solid *s, crease_segment *segment, size_t count, const uint32_t *patch_of,
                  double tolerance, field_patches *out, error *e)
{
    if (!unite_corners(segment, count, tolerance, e)) return false;
    graph g = {.segment = segment, .count = tidy(segment, count)};
    bool ok = find_joints(&g, e);
    for (int pass = 0; pass < 2; pass++) /* first curves from corners; the remaining ones are closed */
        for (size_t k = 0; ok && k < 2 * g.count; k++) {
            const int end = (int)(k % 2);
            if (g.used[k / 2] || ends_of(s, &segment[k / 2], patch_of).count == 0) continue;
            if (pass == 0 && next_of(&g, s, patch_of, k / 2, end) != SIZE_MAX) continue;
            ok = follow(&g, s, patch_of, k / 2, end, out, e);
        }
    free(g.joint);
    free(g.first);
    free(g.past);
    free(g.used);
    return ok;
}

// SPDX-License-Identifier: Apache-2.0
#include "sampling/voronoi/triangulation.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "sampling/packing/point_flags.h"
#include "sampling/voronoi/partitions.h"
#include "sampling/voronoi/voronoi.h"

/* Points, or triangles, in a chunk of work. */
enum { CHUNK = THREADS_GRAIN };

/* ---- the triangles ---- */

/* The triangles of one chunk of points. */
typedef struct triangle_list {
    size_t count, capacity;
    uint32_t (*corner)[3];
} triangle_list;

typedef struct triangle_search {
    const partition *partition;
    voronoi_sites sites;
    triangle_list *lists; /* per chunk */
} triangle_search;

static void note_triangle(const voronoi_sites *s, uint32_t a, uint32_t b, uint32_t c, triangle_list *out)
{
    const vec3 *x = s->position, *n = s->normal;
    vec3 across = vec3_cross(vec3_sub(x[b], x[a]), vec3_sub(x[c], x[a]));
    bool outwards = vec3_dot(across, vec3_add(n[a], vec3_add(n[b], n[c]))) >= 0;
    if (out->count == out->capacity) {
        out->capacity = out->capacity > 0 ? 2 * out->capacity : CHUNK;
        out->corner = mem_resize(out->corner, out->capacity * sizeof *out->corner);
    }
    uint32_t *corner = out->corner[out->count++];
    corner[0] = s->index[a];
    corner[1] = s->index[outwards ? b : c];
    corner[2] = s->index[outwards ? c : b];
}

/* Each triangle is found by its corner of least index. */
static void search_chunk(void *context, int worker, size_t begin, size_t end)
{
    const triangle_search *job = context;
    (void)worker;
    for (uint32_t a = (uint32_t)begin; a < end; a++) {
        if (!partition_owns(job->partition, a)) continue;
        voronoi_star star;
        voronoi_star_at(&job->sites, a, &star);
        for (uint32_t t = 0; t < star.triangle_count; t++) {
            uint32_t b = star.point[star.corner[t][0]], c = star.point[star.corner[t][1]];
            if (a < b && a < c) note_triangle(&job->sites, a, b, c, &job->lists[begin / CHUNK]);
        }
    }
}

/* Appends the triangles of all chunks of a partition, in their order. */
static bool append_found(const triangle_list *all, size_t chunks, triangulation *t, error *e)
{
    size_t sum = t->facts.triangles;
    for (size_t k = 0; k < chunks; k++) sum += all[k].count;
    uint32_t(*corner)[3] = mem_array(sum, sizeof *corner, "the mesh", e);
    if (!corner) return false;
    if (t->facts.triangles > 0) memcpy(corner, t->corner, t->facts.triangles * sizeof *corner);
    free(t->corner);
    t->corner = corner;
    for (size_t k = 0; k < chunks; k++) {
        if (all[k].count > 0)
            memcpy(corner + t->facts.triangles, all[k].corner, all[k].count * sizeof *corner);
        t->facts.triangles += all[k].count;
    }
    return true;
}

static bool search_partition(const partition *s, threads *pool, triangulation *t, error *e)
{
    const size_t chunks = (s->count + CHUNK - 1) / CHUNK;
    triangle_search job = {.partition = s,
                           .sites = {s->position, s->normal, s->spacing, s->near, s->flags, s->index},
                           .lists = mem_array(chunks, sizeof *job.lists, "the mesh", e)};
    bool ok = job.lists != NULL;
    if (ok) {
        threads_run(pool, s->count, CHUNK, search_chunk, &job);
        ok = threads_stopped(pool) ? error_set(e, ERROR_CANCELLED, "stopped")
                                   : append_found(job.lists, chunks, t, e);
    }
    for (size_t c = 0; job.lists && c < chunks; c++) free(job.lists[c].corner);
    free(job.lists);
    return ok;
}

/* ---- whether they are a surface ---- */

/* A triangle at one of its corners: the other two corners, counterclockwise. */
typedef struct wedge {
    uint32_t from, to;
} wedge;

/* Counts of one chunk. */
typedef struct tally {
    size_t edges, boundary, rim, bad_edges, seams, bad_vertices, off_steps;
    double ratio;
} tally;

typedef struct survey {
    const triangulation_input *in;
    const triangulation *made;
    const uint32_t *vertex_of; /* per point of the curve steps: its vertex; NULL: the point itself */
    size_t *begin;             /* point i has the wedges begin[i] .. begin[i + 1] - 1 */
    wedge *wedge;
    size_t *side_begin; /* per point: its range in `side`, the other ends of its curve steps; NULL: there are
                         * none */
    uint32_t *side;
    tally *tally; /* per chunk */
    bool *faulty; /* per vertex, or NULL */
} survey;

static void free_survey(survey *job)
{
    free(job->begin);
    free(job->wedge);
    free(job->side_begin);
    free(job->side);
    free(job->tally);
}

static bool list_sides(survey *job, error *e)
{
    const triangulation_input *in = job->in;
    if (!in->side) return true;
    job->side_begin = mem_array(in->count + 2, sizeof *job->side_begin, "the mesh", e);
    job->side = mem_array(2 * in->side_count, sizeof *job->side, "the mesh", e);
    if (!job->side_begin || !job->side) return false;
    for (size_t k = 0; k < 2 * in->side_count; k++) {
        uint32_t i = in->side[k / 2][k % 2];
        job->side_begin[(job->vertex_of ? job->vertex_of[i] : i) + 2]++;
    }
    for (size_t i = 2; i < in->count + 2; i++) job->side_begin[i] += job->side_begin[i - 1];
    for (size_t k = 0; k < 2 * in->side_count; k++) {
        uint32_t i = in->side[k / 2][k % 2], other = in->side[k / 2][1 - k % 2];
        job->side[job->side_begin[(job->vertex_of ? job->vertex_of[i] : i) + 1]++] =
            job->vertex_of ? job->vertex_of[other] : other;
    }
    return true;
}

/* Number of curve steps between two points. */
static size_t count_between(const survey *job, uint32_t i, uint32_t other)
{
    size_t count = 0;
    for (size_t k = job->side ? job->side_begin[i] : 0; job->side && k < job->side_begin[i + 1]; k++)
        count += job->side[k] == other;
    return count;
}

static bool list_wedges(survey *job, error *e)
{
    const triangulation *t = job->made;
    size_t count = job->in->count;
    job->begin = mem_array(count + 2, sizeof *job->begin, "the mesh", e);
    job->wedge = mem_array(3 * t->facts.triangles, sizeof *job->wedge, "the mesh", e);
    if (!job->begin || !job->wedge) return false;
    for (size_t k = 0; k < t->facts.triangles; k++)
        for (int c = 0; c < 3; c++) {
            assert(t->corner[k][c] < count);
            job->begin[t->corner[k][c] + 2]++;
        }
    for (size_t i = 2; i < count + 2; i++) job->begin[i] += job->begin[i - 1];
    for (size_t k = 0; k < t->facts.triangles; k++)
        for (int c = 0; c < 3;
             c++) { /* begin[i + 1] moves from the begin to the end of the wedges of point i */
            const uint32_t *corner = t->corner[k];
            job->wedge[job->begin[corner[c] + 1]++] = (wedge){corner[(c + 1) % 3], corner[(c + 2) % 3]};
        }
    return list_sides(job, e);
}

/* Numbers of triangles at a point whose first, or second, edge leads to `other`. */
static void count_sides(const wedge *w, size_t count, uint32_t other, size_t *first, size_t *second)
{
    *first = *second = 0;
    for (size_t k = 0; k < count; k++) {
        *first += w[k].from == other;
        *second += w[k].to == other;
    }
}

static bool is_at_boundary(const triangulation_input *in, uint32_t i)
{
    return (!in->side && in->flags && in->flags[i] & PACKING_FIXED) ||
           (in->open && !bbox_contains(bbox_grow(in->domain, -in->spacing[i]), in->position[i]));
}

/* Counts the edge from i to `other`, at its end of lower index, and sets *faulty if it is faulty. False: it is in
 * too many triangles. */
static bool tally_edge(const survey *job, uint32_t i, uint32_t other, tally *t, bool *faulty)
{
    const bool is_lower = i < other;
    size_t first, second;
    count_sides(job->wedge + job->begin[i], job->begin[i + 1] - job->begin[i], other, &first, &second);
    t->edges += is_lower;
    if (first == 1 && second == 1) return true;
    const bool good = first <= 1 && second <= 1;
    const size_t steps = count_between(job, i, other);
    const bool is_seam = !good && first + second == steps,
               is_rim =
                   good && (steps == 1 || (is_at_boundary(job->in, i) && is_at_boundary(job->in, other)));
    t->boundary += is_lower && good;
    t->rim += is_lower && is_rim;
    t->bad_edges += is_lower && !good;
    t->seams += is_lower && is_seam;
    *faulty |= !is_seam && !is_rim;
    return good;
}

/* Counts the triangles that are missing or in excess along the curve steps at a point, each step at its end of lower
 * index. Returns whether there are any. */
static bool tally_steps(const survey *job, uint32_t i, tally *t)
{
    bool any = false;
    for (size_t k = job->side_begin[i]; k < job->side_begin[i + 1]; k++) {
        size_t first, second, off;
        count_sides(job->wedge + job->begin[i], job->begin[i + 1] - job->begin[i], job->side[k], &first,
                    &second);
        const size_t steps = count_between(job, i, job->side[k]), sides = first + second;
        off = sides > steps ? sides - steps : steps - sides;
        any |= off > 0;
        t->off_steps += i < job->side[k] ? off : 0;
    }
    return any;
}

/* The other end of edge k at a point; an edge occurs once per triangle. */
static uint32_t edge_at(const wedge *w, size_t k)
{
    return k % 2 == 0 ? w[k / 2].from : w[k / 2].to;
}

static bool is_first_time(const wedge *w, size_t k)
{
    for (size_t earlier = 0; earlier < k; earlier++)
        if (edge_at(w, earlier) == edge_at(w, k)) return false;
    return true;
}

/* Whether the triangles at a point, whose edges are manifold, form one fan. */
static bool is_one_fan(const wedge *w, size_t count)
{
    size_t start = 0, seen = 1;
    for (size_t k = 0; k < count; k++) {
        size_t first, second;
        count_sides(w, count, w[k].from, &first, &second);
        if (second == 0) start = k; /* the fan begins at a boundary */
    }
    for (uint32_t at = w[start].to; at != w[start].from && seen <= count;) {
        size_t next = 0;
        while (next < count && w[next].from != at) next++;
        if (next == count) break;
        at = w[next].to;
        seen++;
    }
    return seen == count;
}

static void survey_points(void *context, int worker, size_t begin, size_t end)
{
    const survey *job = context;
    tally *t = &job->tally[begin / CHUNK];
    (void)worker;
    for (uint32_t i = (uint32_t)begin; i < end; i++) {
        const wedge *w = job->wedge + job->begin[i];
        size_t count = job->begin[i + 1] - job->begin[i];
        bool good = true, faulty = false;
        for (size_t k = 0; k < 2 * count; k++)
            if (is_first_time(w, k)) good &= tally_edge(job, i, edge_at(w, k), t, &faulty);
        const bool is_bad = count == 0 || (good && !is_one_fan(w, count));
        t->bad_vertices += is_bad;
        if (job->in->ends_at_steps && job->side) faulty |= tally_steps(job, i, t);
        if (job->faulty) job->faulty[i] = is_bad || faulty;
    }
}

/* 2 r_in / R_circ, from the lengths of the edges. */
static double radius_ratio(const vec3 *x, const uint32_t corner[3])
{
    double a = vec3_norm(vec3_sub(x[corner[1]], x[corner[2]]));
    double b = vec3_norm(vec3_sub(x[corner[2]], x[corner[0]]));
    double c = vec3_norm(vec3_sub(x[corner[0]], x[corner[1]]));
    double product = a * b * c;
    return product > 0 ? fmax((b + c - a) * (c + a - b) * (a + b - c) / product, 0) : 0;
}

static void survey_triangles(void *context, int worker, size_t begin, size_t end)
{
    const survey *job = context;
    (void)worker;
    double sum = 0;
    for (size_t k = begin; k < end; k++) sum += radius_ratio(job->in->position, job->made->corner[k]);
    job->tally[begin / CHUNK].ratio = sum;
}

static void conclude(const tally *all, size_t chunks, size_t points, triangulation_facts *out)
{
    *out = (triangulation_facts){.triangles = out->triangles, .hole_triangles = out->hole_triangles};
    for (size_t k = 0; k < chunks; k++) {
        out->edges += all[k].edges;
        out->boundary_edges += all[k].boundary;
        out->rim_edges += all[k].rim;
        out->nonmanifold_edges += all[k].bad_edges;
        out->seam_edges += all[k].seams;
        out->nonmanifold_vertices += all[k].bad_vertices;
        out->off_steps += all[k].off_steps;
        out->radius_ratio += all[k].ratio;
    }
    if (out->triangles > 0) out->radius_ratio /= (double)out->triangles;
    out->euler = (int64_t)points - (int64_t)out->edges + (int64_t)out->triangles;
}

/* Rotates the corners so that the least index comes first. */
static void turn_to_least(uint32_t corner[3])
{
    const uint32_t c[3] = {corner[0], corner[1], corner[2]};
    int least = c[0] < c[1] ? (c[0] < c[2] ? 0 : 2) : c[1] < c[2] ? 1 : 2;
    for (int k = 0; k < 3; k++) corner[k] = c[(least + k) % 3];
}

/* ---- holes ---- */

/* Maximum number of edges of a hole that is closed. Larger holes are between walls that the points do not
 * resolve. */
enum { HOLE_MOST = 8 };

/* The points around a hole: clockwise in the surrounding triangles, seen from outside, and
 * counterclockwise in those that close it. */
typedef struct hole {
    size_t count;
    uint32_t point[HOLE_MOST];
} hole;

static size_t wedges_at(const survey *job, uint32_t i, const wedge **out)
{
    *out = job->wedge + job->begin[i];
    return job->begin[i + 1] - job->begin[i];
}

/* Counts the boundary edges that end at a point and follow no curve. *out: the other end of the last one. */
static size_t open_edges(const survey *job, uint32_t i, uint32_t *out)
{
    const wedge *w;
    size_t count = wedges_at(job, i, &w), open = 0;
    for (size_t k = 0; k < count; k++) {
        size_t first, second;
        count_sides(w, count, w[k].to, &first, &second);
        if (first > 0 || second != 1 || count_between(job, i, w[k].to) > 0) continue;
        *out = w[k].to;
        open++;
    }
    return open;
}

/* Counts the curve steps at a point that are in no triangle, except the one back to `from`. *out: the
 * other end of the last one. */
static size_t uncovered_curve_edges(const survey *job, uint32_t i, uint32_t from, uint32_t *out)
{
    const wedge *w;
    size_t count = wedges_at(job, i, &w), bare = 0;
    for (size_t k = job->side ? job->side_begin[i] : 0; job->side && k < job->side_begin[i + 1]; k++) {
        size_t first, second;
        count_sides(w, count, job->side[k], &first, &second);
        if (first + second > 0 || job->side[k] == from || count_between(job, i, job->side[k]) != 1) continue;
        *out = job->side[k];
        bare++;
    }
    return bare;
}

/* Finds the hole at point i, if i is the least of its points with a boundary edge. */
static bool find_hole(const survey *job, uint32_t i, hole *out)
{
    uint32_t at = i, from = i;
    out->count = 0;
    do {
        uint32_t next;
        const size_t open = open_edges(job, at, &next);
        if (out->count == HOLE_MOST || is_at_boundary(job->in, at) || open > 1 || (open == 1 && at < i) ||
            (open == 0 && (at == i || uncovered_curve_edges(job, at, from, &next) != 1)))
            return false;
        out->point[out->count++] = at;
        from = at;
        at = next;
    } while (at != i);
    return out->count >= 3;
}

/* Whether a triangle faces the way of the normals of its corners; a bridge between opposite walls does
 * not. `loosely`: of their sum. */
static bool faces_right(const triangulation_input *in, const uint32_t corner[3], bool loosely)
{
    const vec3 *x = in->position, *n = in->normal;
    vec3 across = vec3_cross(vec3_sub(x[corner[1]], x[corner[0]]), vec3_sub(x[corner[2]], x[corner[0]]));
    double least = VORONOI_OPPOSITE_COSINE * vec3_norm(across), sum = 0;
    for (int c = 0; c < 3; c++) {
        double facing = vec3_dot(across, n[corner[c]]);
        if (!(facing > least || loosely)) return false;
        sum += facing;
    }
    return sum > 0;
}

static bool are_joined(const survey *job, uint32_t a, uint32_t b)
{
    const wedge *w;
    size_t count = wedges_at(job, a, &w), first, second;
    count_sides(w, count, b, &first, &second);
    return first + second > 0;
}

/* Chooses the ear of the hole with the shortest new edge among those that face the right way. Returns its
 * corner; the count of the hole if there is none. */
static size_t choose_ear(const survey *job, const hole *h, bool loosely, uint32_t ear[3])
{
    size_t best = h->count;
    double shortest = INFINITY;
    for (size_t k = 0; k < h->count; k++) {
        const uint32_t corner[3] = {h->point[(k + h->count - 1) % h->count], h->point[k],
                                    h->point[(k + 1) % h->count]};
        double square = vec3_norm2(vec3_sub(job->in->position[corner[2]], job->in->position[corner[0]]));
        if (!(square < shortest) || !faces_right(job->in, corner, loosely)) continue;
        if (h->count > 3 && are_joined(job, corner[0], corner[2])) continue;
        memcpy(ear, corner, sizeof corner);
        shortest = square;
        best = k;
    }
    return best;
}

/* Closes the hole by ear clipping. Returns the number of triangles; 0: it cannot be closed. */
static size_t close_hole(const survey *job, hole h, bool loosely, uint32_t out[HOLE_MOST - 2][3])
{
    size_t made = 0;
    for (; h.count >= 3; h.count--) {
        uint32_t ear[3];
        size_t k = choose_ear(job, &h, loosely, ear);
        if (k == h.count) return 0;
        turn_to_least(ear);
        memcpy(out[made++], ear, sizeof ear);
        memmove(h.point + k, h.point + k + 1, (h.count - k - 1) * sizeof *h.point);
    }
    return made;
}

/* Whether a triangle lies beyond a curve: one edge is a boundary that follows no curve, and another one
 * follows a curve and has a second triangle. */
static bool is_beyond(const survey *job, const uint32_t corner[3])
{
    int open = 0, crossed = 0;
    for (int c = 0; c < 3; c++) {
        const uint32_t i = corner[c], other = corner[(c + 1) % 3];
        const wedge *w;
        size_t count = wedges_at(job, i, &w), first, second, sides = count_between(job, i, other);
        count_sides(w, count, other, &first, &second);
        open += sides == 0 && first + second == 1;
        crossed += sides == 1 && first + second > 1;
    }
    return open > 0 && crossed > 0;
}

/* Removes the triangles beyond curves, from the rim inwards. */
static bool drop_beyond_curves(const triangulation_input *in, triangulation *t, error *e)
{
    for (bool any = true; any;) {
        survey job = {.in = in, .made = t};
        bool *beyond = mem_array(t->facts.triangles, sizeof *beyond, "the mesh", e);
        const bool ok = beyond && list_wedges(&job, e);
        size_t kept = 0;
        for (size_t k = 0; ok && k < t->facts.triangles; k++) beyond[k] = is_beyond(&job, t->corner[k]);
        for (size_t k = 0; ok && k < t->facts.triangles; k++)
            if (!beyond[k]) memmove(t->corner[kept++], t->corner[k], sizeof t->corner[0]);
        any = kept < t->facts.triangles;
        if (ok) t->facts.triangles = kept;
        free(beyond);
        free_survey(&job);
        if (!ok) return false;
    }
    return true;
}

/* Closes small holes and sets facts.hole_triangles. */
static bool close_holes(const triangulation_input *in, triangulation *made, error *e)
{
    survey job = {.in = in, .made = made};
    triangle_list added = {0};
    bool ok = list_wedges(&job, e);
    for (uint32_t i = 0; ok && i < in->count; i++) {
        hole h;
        uint32_t corner[HOLE_MOST - 2][3];
        if (!find_hole(&job, i, &h)) continue;
        size_t more = close_hole(&job, h, false, corner);
        if (more == 0 && in->side)
            more = close_hole(&job, h, true, corner); /* with curves there is one wall only */
        added.corner = mem_resize(added.corner, (added.count + more + 1) * sizeof *added.corner);
        memcpy(added.corner + added.count, corner, more * sizeof *corner);
        added.count += more;
    }
    made->facts.hole_triangles = added.count;
    if (ok && added.count > 0) ok = append_found(&added, 1, made, e);
    free(added.corner);
    free_survey(&job);
    return ok;
}

/* Removes triangles between points on curves that lie beyond the curves. */
static void drop_outside(const triangulation_input *in, triangulation *t)
{
    size_t kept = 0;
    for (size_t k = 0; k < t->facts.triangles; k++) {
        const uint32_t *corner = t->corner[k];
        vec3 sum = {0, 0, 0};
        bool fixed = true;
        for (int c = 0; c < 3; c++) {
            sum = vec3_add(sum, in->position[corner[c]]);
            fixed &= (in->flags[corner[c]] & PACKING_FIXED) != 0;
        }
        if (fixed && !in->is_within(in->context, in->label[corner[0]], vec3_scale(sum, 1.0 / 3))) continue;
        memmove(t->corner[kept++], corner, sizeof t->corner[0]);
    }
    t->facts.triangles = kept;
}

/* ---- the whole ---- */

bool triangulation_join(const triangulation_input *in, triangulation *t, error *e)
{
    t->label = mem_array(t->facts.triangles, sizeof *t->label, "the mesh", e);
    if (!t->label) return false;
    for (size_t k = 0; k < t->facts.triangles; k++) {
        t->label[k] = in->label[t->corner[k][0]];
        for (int c = 0; c < 3; c++) t->corner[k][c] = in->point[t->corner[k][c]];
        turn_to_least(t->corner[k]);
    }
    return true;
}

bool triangulation_survey(const triangulation_input *in, threads *pool, triangulation *made, bool *faulty,
                          error *e)
{
    triangulation_input vertices = *in;
    if (in->point) vertices.count = in->points;
    survey job = {.in = &vertices, .made = made, .vertex_of = in->point, .faulty = faulty};
    size_t most = made->facts.triangles > vertices.count ? made->facts.triangles : vertices.count,
           chunks = most / CHUNK + 1;
    job.tally = mem_array(chunks, sizeof *job.tally, "the mesh", e);
    bool ok = job.tally && list_wedges(&job, e);
    if (ok) {
        threads_run(pool, vertices.count, CHUNK, survey_points, &job);
        threads_run(pool, made->facts.triangles, CHUNK, survey_triangles, &job);
        conclude(job.tally, chunks, vertices.count, &made->facts);
        if (threads_stopped(pool)) ok = error_set(e, ERROR_CANCELLED, "stopped");
    }
    free_survey(&job);
    return ok;
}

bool triangulation_make(const triangulation_input *in, threads *pool, triangulation *out, error *e)
{
    const partitions_input cut = {in->count, in->position, in->normal,   in->spacing,
                                  in->label, in->flags,    VORONOI_REACH};
    partitions all;
    partition part = {0};
    *out = (triangulation){0};
    bool ok = partitions_cut(&cut, pool, &all, e);
    for (size_t k = 0; ok && k < all.count; k++)
        ok = partition_fill(&cut, &all, k, pool, &part, e) && search_partition(&part, pool, out, e);
    partition_free(&part);
    partitions_free(&all);
    if (ok && in->flags) drop_outside(in, out);
    if (ok && in->side) ok = drop_beyond_curves(in, out, e);
    ok = ok && close_holes(in, out, e);
    if (ok && in->point) ok = triangulation_join(in, out, e);
    return ok && triangulation_survey(in, pool, out, NULL, e);
}

void triangulation_free(triangulation *t)
{
    free(t->corner);
    free(t->label);
    *t = (triangulation){0};
}

size_t triangulation_faults(const triangulation_facts *f)
{
    return f->nonmanifold_edges - f->seam_edges + f->nonmanifold_vertices + f->boundary_edges - f->rim_edges +
           f->off_steps;
}

bool triangulation_is_manifold(const triangulation_facts *f)
{
    return f->triangles > 0 && triangulation_faults(f) == 0;
}

bool triangulation_is_closed(const triangulation_facts *f)
{
    return triangulation_is_manifold(f) && f->boundary_edges == 0;
}

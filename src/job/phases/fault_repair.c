// SPDX-License-Identifier: Apache-2.0
#include "job/phases/fault_repair.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/sets.h"
#include "geometry/space/point_tree.h"
#include "job/phases/mesh_faults.h"
#include "surface/remesh/surface_mesh.h"

static const char what[] = "the repair of the mesh";

/* Radius, in spacings, of the region around a faulty vertex that is triangulated along the mesh. */
static const double REGION = 5;
/* Maximum distance, in spacings, of a vertex from a faulty vertex if its triangles may be replaced. Nearer to
 * the rim of the region, cells miss neighbours. */
static const double TRUSTED = 3;
/* Maximum number of passes. Each extends the regions to triangles that could not be replaced. */
enum { MOST_PASSES = 4 };
/* If the regions have more than this fraction of the vertices, one pass over the whole mesh takes less time
 * than all passes over the regions. */
static const double WHOLE_FROM = 1.0 / MOST_PASSES;
/* Maximum number of points in the regions: the pieces of the mesh take about 3 kB per point. */
static const size_t most_points = 200000;

#define NONE UINT32_MAX

/* A triangle near a fault: of the triangulation, or along the mesh. */
typedef struct candidate {
    uint32_t corner[3]; /* the least index first */
    uint32_t index;     /* in its list */
    bool is_along;
    uint32_t group;
} candidate;

/* An edge of a candidate, the lower index first. */
typedef struct edge {
    uint32_t low, high, candidate;
} edge;

/* Candidates that are connected by edges: they are replaced together. */
typedef struct group {
    bool is_faulty;  /* has a faulty vertex or a closing triangle */
    bool is_trusted; /* all of its vertices are */
    bool is_replaced;
    size_t before, after; /* faulty vertices, with multiplicity */
} group;

typedef struct repair {
    const triangulation_input *in;
    const mesh *on;
    triangulation made;  /* corners, triangles and hole_triangles only */
    triangulation whole; /* all triangles along the mesh; corners and triangles only; no corners: not made */
    bool *faulty, *faulty_after, *center, *is_done; /* per vertex */
    uint32_t *local;                                /* per vertex: its index in the region, or NONE */
    bool *trusted;                                  /* per vertex */
    candidate *candidate;
    size_t count;
    group *group;
} repair;

/* The triangles that close holes are the last ones. They are poor: they are replaced, too. */
static size_t first_closing(const repair *m)
{
    return m->made.facts.triangles - m->made.facts.hole_triangles;
}

/* ---- the region ---- */

/* The centers and the points near them, with an own numbering of vertices. */
typedef struct region {
    vec3 *center;
    double *radius;
    size_t centers;
    point_tree *tree;
    vec3 *position;
    double *spacing;
    uint32_t *name, *vertex; /* vertex: of each name, its vertex in the input */
    size_t points, names;
    uint32_t (*side)[2];
    size_t sides;
    bool is_whole; /* it is the whole mesh */
} region;

static void region_free(region *r)
{
    point_tree_free(r->tree);
    free(r->center);
    free(r->radius);
    free(r->position);
    free(r->spacing);
    free(r->name);
    free(r->vertex);
    free(r->side);
}

static bool take_centers(const repair *m, region *out, error *e)
{
    for (size_t v = 0; v < m->in->points; v++) out->centers += m->center[v];
    out->center = mem_array(out->centers, sizeof *out->center, what, e);
    out->radius = mem_array(out->centers, sizeof *out->radius, what, e);
    if (!out->center || !out->radius) return false;
    for (size_t v = 0, k = 0; v < m->in->points; v++)
        if (m->center[v]) {
            out->center[k] = m->in->position[v];
            out->radius[k++] = REGION * m->in->spacing[v];
        }
    return (out->tree = point_tree_new(out->center, out->centers, e)) != NULL;
}

/* Sets `local` and `trusted` from the distances to centers. */
static void mark_vertices(repair *m, region *r)
{
    const size_t vertices = m->in->points;
    r->names = 0;
    for (size_t v = 0; v < vertices; v++) {
        double away;
        const uint32_t near = point_tree_nearest(r->tree, m->in->position[v], 0, &away);
        m->trusted[v] = away <= TRUSTED / REGION * r->radius[near];
        m->local[v] = away <= r->radius[near] ? (uint32_t)r->names++ : NONE;
    }
    r->is_whole = (double)r->names > WHOLE_FROM * (double)vertices && m->in->count <= most_points;
    if (!r->is_whole) return;
    r->names = vertices;
    for (size_t v = 0; v < vertices; v++) {
        m->trusted[v] = true;
        m->local[v] = (uint32_t)v;
    }
}

static bool take_region(repair *m, region *out, error *e)
{
    const triangulation_input *in = m->in;
    *out = (region){0};
    if (!take_centers(m, out, e)) return false;
    mark_vertices(m, out);
    size_t points = 0;
    for (size_t i = 0; i < in->count; i++) points += m->local[in->point[i]] != NONE;
    out->position = mem_array(points, sizeof *out->position, what, e);
    out->spacing = mem_array(points, sizeof *out->spacing, what, e);
    out->name = mem_array(points, sizeof *out->name, what, e);
    out->vertex = mem_array(out->names, sizeof *out->vertex, what, e);
    uint32_t *index = mem_array(in->count, sizeof *index, what, e);
    bool ok = out->position && out->spacing && out->name && out->vertex && index;
    for (uint32_t i = 0; ok && i < in->count; i++) {
        const uint32_t v = in->point[i], name = m->local[v];
        if (name == NONE) continue;
        out->position[out->points] = in->position[i];
        out->spacing[out->points] = in->spacing[i];
        out->vertex[name] = v;
        index[i] = (uint32_t)out->points;
        out->name[out->points++] = name;
    }
    ok = ok && (out->side = mem_array(in->side_count, sizeof *out->side, what, e));
    for (size_t k = 0; ok && k < in->side_count; k++) {
        const uint32_t *s = in->side[k];
        if (m->local[in->point[s[0]]] == NONE || m->local[in->point[s[1]]] == NONE) continue;
        out->side[out->sides][0] = index[s[0]];
        out->side[out->sides++][1] = index[s[1]];
    }
    free(index);
    return ok;
}

static bool triangulate_region(const repair *m, const region *r, uint32_t (**triangle)[3], size_t *count,
                               error *e)
{
    const fine_mesh_part part = {r->tree, r->radius};
    const surface_mesh_input in = {.m = m->on,
                                   .count = r->points,
                                   .position = r->position,
                                   .spacing = r->spacing,
                                   .name = r->name,
                                   .names = r->names,
                                   .side = (const uint32_t(*)[2])r->side,
                                   .side_count = r->sides,
                                   .part = r->is_whole ? NULL : &part};
    if (!surface_mesh_make(&in, triangle, count, e)) return false;
    for (size_t c = 0; c < 3 * *count; c++) {
        uint32_t *corner = &(*triangle)[c / 3][c % 3];
        *corner = r->vertex[*corner];
    }
    return true;
}

/* ---- candidates and their groups ---- */

static candidate candidate_of(const uint32_t t[3], size_t index, bool is_along)
{
    const int least = t[0] < t[1] ? (t[0] < t[2] ? 0 : 2) : t[1] < t[2] ? 1 : 2;
    return (candidate){{t[least], t[(least + 1) % 3], t[(least + 2) % 3]}, (uint32_t)index, is_along, NONE};
}

static int compare_corners(const candidate *a, const candidate *b)
{
    for (int c = 0; c < 3; c++)
        if (a->corner[c] != b->corner[c]) return a->corner[c] < b->corner[c] ? -1 : 1;
    return 0;
}

static int by_corners(const void *left, const void *right)
{
    const candidate *a = left, *b = right;
    const int order = compare_corners(a, b);
    if (order != 0) return order;
    if (a->is_along != b->is_along) return a->is_along ? 1 : -1;
    return (a->index > b->index) - (a->index < b->index);
}

/* Removes pairs of equal triangles, one of each kind. */
static void drop_common(repair *m)
{
    size_t kept = 0;
    qsort(m->candidate, m->count, sizeof *m->candidate, by_corners);
    for (size_t k = 0, n; k < m->count; k += n) {
        size_t along = 0;
        for (n = 0; k + n < m->count && compare_corners(&m->candidate[k], &m->candidate[k + n]) == 0; n++)
            along += m->candidate[k + n].is_along;
        const size_t of_made = n - along, common = along < of_made ? along : of_made;
        for (size_t i = common; i < of_made; i++) m->candidate[kept++] = m->candidate[k + i];
        for (size_t i = of_made + common; i < n; i++) m->candidate[kept++] = m->candidate[k + i];
    }
    m->count = kept;
}

/* Lists the triangles of both kinds that have no equal one of the other kind. */
static bool list_candidates(repair *m, const uint32_t (*along)[3], size_t count, error *e)
{
    size_t most = count;
    for (int pass = 0; pass < 2; pass++) {
        for (size_t k = 0; k < m->made.facts.triangles; k++) {
            const uint32_t *t = m->made.corner[k];
            if (m->local[t[0]] == NONE && m->local[t[1]] == NONE && m->local[t[2]] == NONE) continue;
            if (pass == 0)
                most++;
            else
                m->candidate[m->count++] = candidate_of(t, k, false);
        }
        if (pass == 0 && !(m->candidate = mem_array(most, sizeof *m->candidate, what, e))) return false;
    }
    for (size_t k = 0; k < count; k++) m->candidate[m->count++] = candidate_of(along[k], k, true);
    drop_common(m);
    return true;
}

static int by_ends(const void *left, const void *right)
{
    const edge *a = left, *b = right;
    if (a->low != b->low) return a->low < b->low ? -1 : 1;
    if (a->high != b->high) return a->high < b->high ? -1 : 1;
    return (a->candidate > b->candidate) - (a->candidate < b->candidate);
}

/* Sets the group of each candidate, and what the groups are. */
static bool make_groups(repair *m, error *e)
{
    edge *all = mem_array(3 * m->count, sizeof *all, what, e);
    uint32_t *parent = mem_array(m->count, sizeof *parent, what, e);
    m->group = mem_array(m->count, sizeof *m->group, what, e);
    const bool ok = all && parent && m->group;
    for (size_t c = 0; ok && c < 3 * m->count; c++) {
        const uint32_t *t = m->candidate[c / 3].corner, a = t[c % 3], b = t[(c + 1) % 3];
        all[c] = (edge){a < b ? a : b, a < b ? b : a, (uint32_t)(c / 3)};
    }
    if (ok) {
        qsort(all, 3 * m->count, sizeof *all, by_ends);
        sets_reset(parent, m->count);
    }
    for (size_t k = 1; ok && k < 3 * m->count; k++)
        if (all[k].low == all[k - 1].low && all[k].high == all[k - 1].high)
            sets_join(parent, all[k].candidate, all[k - 1].candidate);
    for (uint32_t k = 0; ok && k < m->count; k++) {
        candidate *t = &m->candidate[k];
        t->group = sets_root(parent, k);
        group *g = &m->group[t->group];
        if (t->group == k) g->is_trusted = true;
        g->is_faulty |= !t->is_along && t->index >= first_closing(m);
        for (int c = 0; c < 3; c++) {
            g->is_faulty |= m->faulty[t->corner[c]];
            g->is_trusted &= m->trusted[t->corner[c]];
        }
    }
    free(all);
    free(parent);
    return ok;
}

/* ---- replacement ---- */

static bool is_replaced(const repair *m, const candidate *t)
{
    return m->group[t->group].is_replaced;
}

/* *out: the triangulation with the replaced groups. */
static bool replace(const repair *m, triangulation *out, error *e)
{
    const triangulation *old = &m->made;
    size_t added = 0;
    for (size_t k = 0; k < m->count; k++)
        added += m->candidate[k].is_along && is_replaced(m, &m->candidate[k]);
    *out = (triangulation){.corner = mem_array(old->facts.triangles + added, sizeof *out->corner, what, e)};
    bool *is_dropped = mem_array(old->facts.triangles, sizeof *is_dropped, what, e);
    const bool ok = out->corner && is_dropped;
    for (size_t k = 0; ok && k < m->count; k++) {
        const candidate *t = &m->candidate[k];
        if (!is_replaced(m, t)) continue;
        if (t->is_along)
            memcpy(out->corner[out->facts.triangles++], t->corner, sizeof t->corner);
        else
            is_dropped[t->index] = true;
    }
    for (size_t k = 0; ok && k < old->facts.triangles; k++)
        if (!is_dropped[k]) {
            memcpy(out->corner[out->facts.triangles++], old->corner[k], sizeof *out->corner);
            out->facts.hole_triangles += k >= first_closing(m);
        }
    free(is_dropped);
    return ok;
}

/* Counts the faulty vertices of each group before and after the replacement. Keeps the triangles of groups
 * that would have more. Returns whether there are such groups. */
static bool revoke_worse(repair *m)
{
    bool any = false;
    for (size_t k = 0; k < m->count; k++) {
        const candidate *t = &m->candidate[k];
        for (int c = 0; c < 3; c++) {
            m->group[t->group].before += m->faulty[t->corner[c]];
            m->group[t->group].after += m->faulty_after[t->corner[c]];
        }
    }
    for (size_t k = 0; k < m->count; k++)
        if (m->group[k].is_replaced && m->group[k].after > m->group[k].before) {
            m->group[k].is_replaced = false;
            any = true;
        }
    return any;
}

/* Replaces the faulty groups that are trusted. */
static bool replace_groups(repair *m, error *e)
{
    triangulation next;
    size_t unused;
    bool any = false;
    for (size_t k = 0; k < m->count; k++)
        any |= m->group[k].is_replaced = m->group[k].is_faulty && m->group[k].is_trusted;
    if (!any) return true;
    bool ok = replace(m, &next, e) && mesh_faults_mark(m->in, &next, m->faulty_after, &unused, e);
    if (ok && revoke_worse(m)) {
        triangulation_free(&next);
        ok = replace(m, &next, e);
    }
    if (!ok) {
        triangulation_free(&next);
        return false;
    }
    triangulation_free(&m->made);
    m->made = next;
    return true;
}

/* Chooses the centers of the next pass: the vertices of faulty groups that could not be replaced because they
 * extend too far, and new faults. */
static bool choose_centers(repair *m, size_t *centers, error *e)
{
    size_t unused;
    for (size_t v = 0; v < m->in->points; v++) {
        m->is_done[v] |= m->center[v];
        m->center[v] = false;
    }
    for (size_t k = 0; k < m->count; k++) {
        const candidate *t = &m->candidate[k];
        if (!m->group[t->group].is_faulty || m->group[t->group].is_trusted) continue;
        for (int c = 0; c < 3; c++) m->center[t->corner[c]] = true;
    }
    if (!mesh_faults_mark(m->in, &m->made, m->faulty, &unused, e)) return false;
    *centers = 0;
    for (size_t v = 0; v < m->in->points; v++) *centers += m->center[v] |= m->faulty[v] && !m->is_done[v];
    return true;
}

/* *goes_on: whether another pass may repair more. */
static bool repair_pass(repair *m, bool *goes_on, error *e)
{
    region r;
    uint32_t(*along)[3] = NULL;
    size_t count = 0;
    m->count = 0;
    free(m->candidate);
    free(m->group);
    m->candidate = NULL;
    m->group = NULL;
    bool ok = take_region(m, &r, e);
    *goes_on = ok && !r.is_whole && r.points <= most_points;
    if (ok && r.points <= most_points)
        ok = triangulate_region(m, &r, &along, &count, e) &&
             list_candidates(m, (const uint32_t(*)[3])along, count, e) && make_groups(m, e) &&
             replace_groups(m, e);
    if (ok && r.is_whole)
        m->whole = (triangulation){.corner = along, .facts.triangles = count};
    else
        free(along);
    region_free(&r);
    return ok;
}

static bool prepare(repair *m, const triangulation *made, size_t *centers, error *e)
{
    const size_t points = m->in->points, triangles = made->facts.triangles;
    m->faulty = mem_array(points, sizeof *m->faulty, what, e);
    m->faulty_after = mem_array(points, sizeof *m->faulty_after, what, e);
    m->center = mem_array(points, sizeof *m->center, what, e);
    m->is_done = mem_array(points, sizeof *m->is_done, what, e);
    m->trusted = mem_array(points, sizeof *m->trusted, what, e);
    m->local = mem_array(points, sizeof *m->local, what, e);
    m->made.corner = mem_array(triangles, sizeof *m->made.corner, what, e);
    if (!m->faulty || !m->faulty_after || !m->center || !m->is_done || !m->trusted || !m->local ||
        !m->made.corner || !mesh_faults_mark(m->in, made, m->faulty, centers, e))
        return false;
    memcpy(m->made.corner, made->corner, triangles * sizeof *m->made.corner);
    memcpy(m->center, m->faulty, points * sizeof *m->center);
    m->made.facts.triangles = triangles;
    m->made.facts.hole_triangles = made->facts.hole_triangles;
    for (size_t c = 3 * first_closing(m); c < 3 * triangles; c++)
        m->center[made->corner[c / 3][c % 3]] = true;
    return true;
}

/* Replaces *made if the other triangulation has fewer faults, and frees the worse one. */
static void keep_better(triangulation *made, triangulation *other)
{
    if (mesh_faults_count(&other->facts) < mesh_faults_count(&made->facts)) {
        const triangulation worse = *made;
        *made = *other;
        *other = worse;
    }
    triangulation_free(other);
}

/* Surveys *other, keeps the better one in *made, and frees the other one. */
static bool compare(const triangulation_input *in, threads *pool, triangulation *made, triangulation *other,
                    error *e)
{
    const bool ok = triangulation_survey(in, pool, other, e);
    if (ok)
        keep_better(made, other);
    else
        triangulation_free(other);
    return ok;
}

/* *is_done: another triangulation of the whole mesh gives nothing new. */
static bool repair_locally(const triangulation_input *in, const mesh *on, threads *pool, triangulation *made,
                           bool *is_done, error *e)
{
    repair m = {.in = in, .on = on};
    size_t centers;
    bool ok = prepare(&m, made, &centers, e), goes_on = true;
    for (int pass = 0; ok && goes_on && centers > 0 && pass < MOST_PASSES; pass++)
        ok = threads_stopped(pool) ? error_set(e, ERROR_CANCELLED, "stopped")
                                   : repair_pass(&m, &goes_on, e) && choose_centers(&m, &centers, e);
    *is_done = m.whole.corner != NULL;
    if (ok)
        ok = compare(in, pool, made, &m.made, e);
    else
        triangulation_free(&m.made);
    if (ok && *is_done)
        ok = compare(in, pool, made, &m.whole, e);
    else
        triangulation_free(&m.whole);
    free(m.faulty);
    free(m.faulty_after);
    free(m.center);
    free(m.is_done);
    free(m.trusted);
    free(m.local);
    free(m.candidate);
    free(m.group);
    return ok;
}

/* Triangulates all points along the mesh. */
static bool triangulate_whole(const triangulation_input *in, const mesh *on, threads *pool,
                              triangulation *made, error *e)
{
    const surface_mesh_input all = {.m = on,
                                    .count = in->count,
                                    .position = in->position,
                                    .spacing = in->spacing,
                                    .name = in->point,
                                    .names = in->points,
                                    .side = in->side,
                                    .side_count = in->side_count};
    triangulation other = {0};
    if (surface_mesh_make(&all, &other.corner, &other.facts.triangles, e))
        return compare(in, pool, made, &other, e);
    triangulation_free(&other);
    return false;
}

bool fault_repair_along(const triangulation_input *in, const mesh *on, threads *pool, triangulation *made,
                        error *e)
{
    bool is_done;
    if (!repair_locally(in, on, pool, made, &is_done, e)) return false;
    is_done = is_done || mesh_faults_count(&made->facts) == 0 || in->count > most_points;
    return is_done || triangulate_whole(in, on, pool, made, e);
}

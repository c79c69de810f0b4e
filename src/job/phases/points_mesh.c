// SPDX-License-Identifier: Apache-2.0
#include "job/phases/points_mesh.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/sets.h"
#include "geometry/space/point_tree.h"
#include "surface/remesh/surface_mesh.h"

static const char what[] = "the repair of the mesh";

/* Radius, in spacings, of the region around a faulty vertex that is triangulated along the surface. */
static const double REGION = 5;
/* Maximum distance, in spacings, of a vertex from a faulty vertex if its triangles may be replaced. Nearer to
 * the rim of the region, cells miss neighbours. */
static const double TRUSTED = 3;
/* Maximum number of passes. Each extends the regions to triangles that could not be replaced. */
enum { MOST_PASSES = 4 };
/* If the regions have more than this fraction of the points of a surface, one pass over the whole surface takes
 * less time than all passes over the regions. */
static const double WHOLE_FROM = 1.0 / MOST_PASSES;
/* Maximum number of points in the pieces of a pass: a piece takes about 3 kB per point. */
static const size_t most_points = 200000;

#define NONE UINT32_MAX

/* Items with keys 0, 1, ...: those with key k are item[first[k]] .. item[first[k + 1] - 1]. */
typedef struct by_key {
    size_t *first;
    uint32_t *item;
} by_key;

/* What is triangulated along a surface in a pass. */
typedef enum piece_kind { PIECE_NONE, PIECE_REGION, PIECE_WHOLE } piece_kind;

/* A triangle near a fault: of the triangulation, or along the surface. */
typedef struct candidate {
    uint32_t corner[3]; /* the least index first */
    uint32_t index;     /* in the triangulation; along the surface: in the order of their creation */
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
    triangulation_input in; /* on patches, each point is a vertex: a patch has no vertex of another one */
    const mesh *on;
    const mesh_patches *patches;
    threads *pool;
    size_t surfaces;      /* the patches; 1 on a mesh */
    by_key points, steps; /* of each surface */
    piece_kind *piece;    /* per surface */
    bool *was_whole;      /* per surface: it was triangulated along the surface as a whole */
    triangulation made;   /* corners and facts */
    bool *faulty, *faulty_after, *center, *is_done, *near, *trusted; /* per vertex */
    uint32_t *local; /* per vertex: its index in the current piece, or NONE */
    uint32_t *index; /* per point: its index in the current piece */
    uint32_t *own;   /* vertices of points on patches */
    candidate *candidate;
    size_t count, room;
    group *group;
} repair;

static bool sort_by_key(const uint32_t *key, size_t count, size_t keys, by_key *out, error *e)
{
    out->first = mem_array(keys + 2, sizeof *out->first, what, e);
    out->item = mem_array(count, sizeof *out->item, what, e);
    if (!out->first || !out->item) return false;
    for (size_t k = 0; k < count; k++) out->first[key[k] + 2]++;
    for (size_t k = 2; k < keys + 2; k++) out->first[k] += out->first[k - 1];
    for (size_t k = 0; k < count; k++) out->item[out->first[key[k] + 1]++] = (uint32_t)k;
    return true;
}

static void by_key_free(by_key *b)
{
    free(b->first);
    free(b->item);
}

/* The triangles that close holes are the last ones. They are poor: they are replaced, too. */
static size_t first_closing(const repair *m)
{
    return m->made.facts.triangles - m->made.facts.hole_triangles;
}

/* ---- pieces ---- */

/* The regions around the faulty vertices. */
typedef struct region {
    vec3 *center;
    double *radius;
    point_tree *tree;
} region;

static void region_free(region *r)
{
    point_tree_free(r->tree);
    free(r->center);
    free(r->radius);
}

static bool take_region(const repair *m, size_t centers, region *out, error *e)
{
    out->center = mem_array(centers, sizeof *out->center, what, e);
    out->radius = mem_array(centers, sizeof *out->radius, what, e);
    if (!out->center || !out->radius) return false;
    for (size_t v = 0, k = 0; v < m->in.points; v++)
        if (m->center[v]) {
            out->center[k] = m->in.position[v];
            out->radius[k++] = REGION * m->in.spacing[v];
        }
    return (out->tree = point_tree_new(out->center, centers, e)) != NULL;
}

static void mark_vertices(repair *m, const region *r)
{
    for (size_t v = 0; v < m->in.points; v++) {
        double away;
        const uint32_t center = point_tree_nearest(r->tree, m->in.position[v], 0, &away);
        m->trusted[v] = away <= TRUSTED / REGION * r->radius[center];
        m->near[v] = away <= r->radius[center];
    }
}

/* Chooses the pieces of surfaces with centers. Vertices beyond pieces are not near, and all vertices of a whole
 * piece are near, trusted and centers. Returns whether there is a piece. */
static bool choose_pieces(repair *m, bool whole)
{
    size_t sum = 0;
    for (size_t p = 0; p < m->surfaces; p++) {
        const uint32_t *point = m->points.item + m->points.first[p];
        const size_t points = m->points.first[p + 1] - m->points.first[p];
        size_t near = 0;
        bool is_faulty = false;
        for (size_t k = 0; k < points; k++) {
            is_faulty |= m->center[m->in.point[point[k]]];
            near += m->near[m->in.point[point[k]]];
        }
        const bool fits = sum + points <= most_points;
        m->piece[p] = !is_faulty || m->was_whole[p]                                   ? PIECE_NONE
                      : fits && (whole || (double)near > WHOLE_FROM * (double)points) ? PIECE_WHOLE
                      : !whole && sum + near <= most_points                           ? PIECE_REGION
                                                                                      : PIECE_NONE;
        sum += m->piece[p] == PIECE_WHOLE ? points : m->piece[p] == PIECE_REGION ? near : 0;
        m->was_whole[p] |= m->piece[p] == PIECE_WHOLE;
        for (size_t k = 0; k < points && m->piece[p] != PIECE_REGION; k++) {
            const uint32_t v = m->in.point[point[k]];
            m->near[v] = m->piece[p] == PIECE_WHOLE;
            m->trusted[v] |= m->near[v];
            m->center[v] |= m->near[v];
        }
    }
    return sum > 0;
}

/* The points of a piece, with an own numbering of vertices. */
typedef struct piece {
    vec3 *position;
    double *spacing;
    uint32_t *name, *vertex; /* vertex: of each name, its vertex in the input */
    size_t points, names;
    uint32_t (*side)[2];
    size_t sides;
} piece;

static void piece_free(piece *p)
{
    free(p->position);
    free(p->spacing);
    free(p->name);
    free(p->vertex);
    free(p->side);
}

static bool take_piece(repair *m, size_t surface, piece *out, error *e)
{
    const triangulation_input *in = &m->in;
    const size_t begin = m->points.first[surface], points = m->points.first[surface + 1] - begin,
                 first = m->steps.first[surface], steps = m->steps.first[surface + 1] - first;
    out->position = mem_array(points, sizeof *out->position, what, e);
    out->spacing = mem_array(points, sizeof *out->spacing, what, e);
    out->name = mem_array(points, sizeof *out->name, what, e);
    out->vertex = mem_array(points, sizeof *out->vertex, what, e);
    out->side = mem_array(steps, sizeof *out->side, what, e);
    if (!out->position || !out->spacing || !out->name || !out->vertex || !out->side) return false;
    for (size_t k = 0; k < points; k++) m->local[in->point[m->points.item[begin + k]]] = NONE;
    for (size_t k = 0; k < points; k++) {
        const uint32_t i = m->points.item[begin + k], v = in->point[i];
        if (!m->near[v]) continue;
        if (m->local[v] == NONE) {
            out->vertex[out->names] = v;
            m->local[v] = (uint32_t)out->names++;
        }
        m->index[i] = (uint32_t)out->points;
        out->position[out->points] = in->position[i];
        out->spacing[out->points] = in->spacing[i];
        out->name[out->points++] = m->local[v];
    }
    for (size_t k = 0; k < steps; k++) {
        const uint32_t *step = in->side[m->steps.item[first + k]];
        if (!m->near[in->point[step[0]]] || !m->near[in->point[step[1]]]) continue;
        for (int end = 0; end < 2; end++) out->side[out->sides][end] = m->index[step[end]];
        out->sides++;
    }
    return true;
}

/* The triangles of a patch, each with its own vertices. */
static bool copy_patch(const mesh_patches *patches, size_t p, mesh *out, error *e)
{
    const uint32_t(*triangle)[3] = (const uint32_t(*)[3])patches->m.triangle + patches->first[p];
    const size_t count = patches->first[p + 1] - patches->first[p];
    *out = (mesh){.vertex = mem_array(3 * count, sizeof *out->vertex, what, e),
                  .triangle = mem_array(count, sizeof *out->triangle, what, e),
                  .vertex_count = 3 * count,
                  .triangle_count = count};
    if (!out->vertex || !out->triangle) return false;
    for (size_t c = 0; c < 3 * count; c++) {
        out->vertex[c] = patches->m.vertex[triangle[c / 3][c % 3]];
        out->triangle[c / 3][c % 3] = (uint32_t)c;
    }
    return true;
}

static bool add_candidate(repair *m, const uint32_t t[3], size_t index, bool is_along, error *e)
{
    if (!MEM_GROW(m->candidate, m->count, &m->room, what, e)) return false;
    const int least = t[0] < t[1] ? (t[0] < t[2] ? 0 : 2) : t[1] < t[2] ? 1 : 2;
    m->candidate[m->count++] =
        (candidate){{t[least], t[(least + 1) % 3], t[(least + 2) % 3]}, (uint32_t)index, is_along, NONE};
    return true;
}

/* Triangulates a piece along its surface: the triangles are candidates. */
static bool triangulate_piece(repair *m, size_t surface, const region *r, error *e)
{
    const fine_mesh_part part = {r->tree, r->radius};
    mesh patch = {0};
    piece p = {0};
    uint32_t(*triangle)[3] = NULL;
    size_t count = 0;
    bool ok = take_piece(m, surface, &p, e) && (!m->patches || copy_patch(m->patches, surface, &patch, e));
    const surface_mesh_input in = {.m = m->patches ? &patch : m->on,
                                   .count = p.points,
                                   .position = p.position,
                                   .spacing = p.spacing,
                                   .name = p.name,
                                   .names = p.names,
                                   .side = (const uint32_t(*)[2])p.side,
                                   .side_count = p.sides,
                                   .part = m->piece[surface] == PIECE_WHOLE ? NULL : &part};
    ok = ok && surface_mesh_make(&in, &triangle, &count, e);
    for (size_t k = 0; ok && k < count; k++) {
        const uint32_t *t = triangle[k];
        ok =
            add_candidate(m, (uint32_t[]){p.vertex[t[0]], p.vertex[t[1]], p.vertex[t[2]]}, m->count, true, e);
    }
    free(triangle);
    mesh_free(&patch);
    piece_free(&p);
    return ok;
}

/* ---- candidates and their groups ---- */

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
static bool list_candidates(repair *m, const region *r, error *e)
{
    bool ok = true;
    m->count = 0;
    for (size_t p = 0; ok && p < m->surfaces; p++)
        if (m->piece[p] != PIECE_NONE)
            ok = threads_stopped(m->pool) ? error_set(e, ERROR_CANCELLED, "stopped")
                                          : triangulate_piece(m, p, r, e);
    for (size_t k = 0; ok && k < m->made.facts.triangles; k++) {
        const uint32_t *t = m->made.corner[k];
        if (m->near[t[0]] || m->near[t[1]] || m->near[t[2]]) ok = add_candidate(m, t, k, false, e);
    }
    if (ok) drop_common(m);
    return ok;
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
    free(m->group);
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
    triangulation_free(out);
    out->corner = mem_array(old->facts.triangles + added, sizeof *out->corner, what, e);
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
    return ok && triangulation_survey(&m->in, m->pool, out, m->faulty_after, e);
}

/* Replaces the triangulation if the other one has no more faults. */
static void keep_better(repair *m, triangulation *other)
{
    if (triangulation_faults(&other->facts) <= triangulation_faults(&m->made.facts)) {
        const triangulation worse = m->made;
        bool *faulty = m->faulty;
        m->made = *other;
        m->faulty = m->faulty_after;
        m->faulty_after = faulty;
        *other = worse;
    }
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
    triangulation next = {0};
    bool any = false;
    for (size_t k = 0; k < m->count; k++)
        any |= m->group[k].is_replaced = m->group[k].is_faulty && m->group[k].is_trusted;
    if (!any) return true;
    bool ok = replace(m, &next, e);
    if (ok && revoke_worse(m)) ok = replace(m, &next, e);
    if (ok) keep_better(m, &next);
    triangulation_free(&next);
    return ok;
}

/* Chooses the centers of the next pass: the vertices of faulty groups that could not be replaced because they
 * extend too far, and new faults. */
static void choose_centers(repair *m)
{
    for (size_t v = 0; v < m->in.points; v++) {
        m->is_done[v] |= m->center[v];
        m->center[v] = m->faulty[v] && !m->is_done[v];
    }
    for (size_t k = 0; k < m->count; k++) {
        const candidate *t = &m->candidate[k];
        if (!m->group[t->group].is_faulty || m->group[t->group].is_trusted) continue;
        for (int c = 0; c < 3; c++) m->center[t->corner[c]] = true;
    }
}

/* *goes_on: whether there were pieces. */
static bool repair_pass(repair *m, bool whole, bool *goes_on, error *e)
{
    region r = {0};
    size_t centers = 0;
    for (size_t v = 0; v < m->in.points; v++) centers += m->center[v];
    *goes_on = centers > 0;
    if (centers == 0) return true;
    bool ok = take_region(m, centers, &r, e);
    if (ok) mark_vertices(m, &r);
    if (ok && (*goes_on = choose_pieces(m, whole)))
        ok = list_candidates(m, &r, e) && make_groups(m, e) && replace_groups(m, e);
    if (ok && *goes_on) choose_centers(m);
    region_free(&r);
    return ok;
}

/* ---- the whole ---- */

/* On patches: the corners of the triangles become points of the triangles' patches. */
static bool split_vertices(repair *m, const triangulation_input *in, const uint32_t *label, error *e)
{
    by_key at = {0};
    m->own = mem_array(in->count, sizeof *m->own, what, e);
    const bool ok = m->own && sort_by_key(in->point, in->count, in->points, &at, e);
    for (uint32_t i = 0; ok && i < in->count; i++) m->own[i] = i;
    for (size_t c = 0; ok && c < 3 * m->made.facts.triangles; c++) {
        uint32_t *corner = &m->made.corner[c / 3][c % 3];
        size_t k = at.first[*corner];
        while (in->label[at.item[k]] != label[c / 3]) k++;
        assert(k < at.first[*corner + 1]);
        *corner = at.item[k];
    }
    by_key_free(&at);
    m->in.point = m->own;
    m->in.points = in->count;
    m->in.ends_at_steps = true;
    return ok;
}

/* Lists the points, and the steps along curves, of each surface. */
static bool list_surfaces(repair *m, error *e)
{
    const triangulation_input *in = &m->in;
    m->surfaces = m->patches ? m->patches->count : 1;
    uint32_t *of_point = mem_array(in->count, sizeof *of_point, what, e),
             *of_step = mem_array(in->side_count, sizeof *of_step, what, e);
    bool ok = of_point && of_step;
    if (ok && m->patches) {
        memcpy(of_point, in->label, in->count * sizeof *of_point);
        for (size_t k = 0; k < in->side_count; k++) of_step[k] = in->label[in->side[k][0]];
    }
    ok = ok && sort_by_key(of_point, in->count, m->surfaces, &m->points, e) &&
         sort_by_key(of_step, in->side_count, m->surfaces, &m->steps, e);
    free(of_point);
    free(of_step);
    m->piece = mem_array(m->surfaces, sizeof *m->piece, what, e);
    m->was_whole = mem_array(m->surfaces, sizeof *m->was_whole, what, e);
    return ok && m->piece && m->was_whole;
}

static bool prepare(repair *m, const triangulation_input *in, const triangulation *made, error *e)
{
    m->made.facts = made->facts;
    m->made.corner = mem_array(made->facts.triangles, sizeof *m->made.corner, what, e);
    if (!m->made.corner) return false;
    memcpy(m->made.corner, made->corner, made->facts.triangles * sizeof *m->made.corner);
    if ((m->patches && !split_vertices(m, in, made->label, e)) || !list_surfaces(m, e)) return false;
    const size_t points = m->in.points;
    m->faulty = mem_array(points, sizeof *m->faulty, what, e);
    m->faulty_after = mem_array(points, sizeof *m->faulty_after, what, e);
    m->center = mem_array(points, sizeof *m->center, what, e);
    m->is_done = mem_array(points, sizeof *m->is_done, what, e);
    m->near = mem_array(points, sizeof *m->near, what, e);
    m->trusted = mem_array(points, sizeof *m->trusted, what, e);
    m->local = mem_array(points, sizeof *m->local, what, e);
    m->index = mem_array(in->count, sizeof *m->index, what, e);
    if (!m->faulty || !m->faulty_after || !m->center || !m->is_done || !m->near || !m->trusted || !m->local ||
        !m->index || !triangulation_survey(&m->in, m->pool, &m->made, m->faulty, e))
        return false;
    memcpy(m->center, m->faulty, points * sizeof *m->center);
    for (size_t c = 3 * first_closing(m); c < 3 * m->made.facts.triangles; c++)
        m->center[m->made.corner[c / 3][c % 3]] = true;
    return true;
}

static bool repair_all(repair *m, error *e)
{
    bool goes_on = true;
    for (int pass = 0; goes_on && pass < MOST_PASSES; pass++)
        if (!repair_pass(m, false, &goes_on, e)) return false;
    if (triangulation_faults(&m->made.facts) == 0) return true;
    memcpy(m->center, m->faulty, m->in.points * sizeof *m->center);
    return repair_pass(m, true, &goes_on, e);
}

bool points_mesh_repair(const triangulation_input *in, const mesh *on, const mesh_patches *patches,
                        threads *pool, triangulation *made, error *e)
{
    repair m = {.in = *in, .on = on, .patches = patches, .pool = pool};
    const bool ok = prepare(&m, in, made, e) && repair_all(&m, e) &&
                    (!patches || (triangulation_join(in, &m.made, e) &&
                                  triangulation_survey(in, pool, &m.made, NULL, e)));
    if (ok && triangulation_faults(&m.made.facts) < triangulation_faults(&made->facts)) {
        const triangulation worse = *made;
        *made = m.made;
        m.made = worse;
    }
    triangulation_free(&m.made);
    by_key_free(&m.points);
    by_key_free(&m.steps);
    free(m.piece);
    free(m.was_whole);
    free(m.faulty);
    free(m.faulty_after);
    free(m.center);
    free(m.is_done);
    free(m.near);
    free(m.trusted);
    free(m.local);
    free(m.index);
    free(m.own);
    free(m.candidate);
    free(m.group);
    return ok;
}

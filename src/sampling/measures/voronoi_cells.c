// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/voronoi_cells.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"

/* A place can belong to the cell of a point that is farther from it than the nearest point by this, in the
 * largest spacing: the nearest point can be on an opposite wall. */
static const double BEYOND_NEAREST = 0.7;
/* The area of a piece may differ from that of its cells by this fraction of it, and may be larger by this multiple of
 * what the bend of the surface adds to certain cells: on meshes, whose triangles meet in edges between the points, the
 * normals give a third of what the edges add. */
static const double AREA_TOLERANCE = 5e-4, BEND_TOLERANCE = 1.2;
/* Triangles are needed for the cells that are not certain and for those beside them. With a larger share of these, all
 * cells are computed from triangles: certain ones would save less than a quarter of the time, or none, and are least
 * exact where the surface bends so much. */
static const double MOST_REACHED = 0.35;

static const char what[] = "the measures of the surface";

void voronoi_cells_free(voronoi_cells *c)
{
    free(c->planar);
    cell_list_free(c->near);
    restricted_voronoi_free(&c->exact);
    *c = (voronoi_cells){0};
}

/* Points whose cells are not certain. */
typedef struct uncertain {
    voronoi_wanted wanted;
    vec3 *position;
    const sites *s; /* all points */
} uncertain;

static void free_uncertain(uncertain *u)
{
    cell_list_free(u->wanted.list);
    free(u->position);
}

/* Lists the points whose cells are not certain, without `measured` only those whose cells are still to be computed.
 * Free *out also after failure. */
static bool list_uncertain(const sites *s, const voronoi_cells *c, bool measured, threads *pool,
                           uncertain *out, error *e)
{
    const planar_cell *known = c->certain_count > 0 ? c->planar : NULL;
    size_t count = 0;
    *out = (uncertain){.wanted = {known, NULL, false, BEYOND_NEAREST * s->largest_spacing}, .s = s};
    for (size_t i = 0; known && i < c->count; i++)
        count += !known[i].certain && (measured || !known[i].measured);
    if (count == 0) return true;
    out->position = mem_array(count, sizeof *out->position, what, e);
    if (!out->position) return false;
    for (size_t i = 0, k = 0; i < c->count; i++)
        if (!known[i].certain && (measured || !known[i].measured)) out->position[k++] = s->position[i];
    out->wanted.list = cell_list_new(out->position, count, pool, e);
    return out->wanted.list != NULL;
}

static bool is_needed(const void *context, const facets_item *item)
{
    const uncertain *u = context;
    double distance;
    const uint32_t nearest = cell_list_nearest(u->s->near, item->centre, 0, &distance);
    return voronoi_reaches(&u->wanted, item->centre, item->radius, distance) ||
           (item->piece != FACETS_MIXED && voronoi_is_apart(u->s, nearest, item));
}

/* Builds the hierarchy for the cells that are not certain. After the first round it contains all triangles of a mesh,
 * since to choose among them takes as long. */
static bool build_hierarchy(const voronoi_cells_input *in, const sites *s, const voronoi_cells *c, int round,
                            threads *pool, error *e)
{
    const bool mesh = in->surface->in.triangle_count > 0;
    uncertain u;
    if (in->whole || c->certain_count == c->count || (mesh && round > 1)) return true;
    if (c->certain_count == 0 || (mesh && round == 1)) return facets_build(in->surface, NULL, NULL, pool, e);
    const bool ok =
        list_uncertain(s, c, true, pool, &u, e) && facets_build(in->surface, is_needed, &u, pool, e);
    free_uncertain(&u);
    return ok;
}

/* Adds cells that were computed later. */
static bool add_cells(restricted_voronoi *to, const restricted_voronoi *more, size_t patches, error *e)
{
    voronoi_side *side = mem_array(to->side_count + more->side_count + 1, sizeof *side, what, e);
    if (!side) return false;
    for (size_t k = 0; k < to->side_count; k++) side[k] = to->side[k];
    for (size_t k = 0; k < more->side_count; k++) side[to->side_count + k] = more->side[k];
    free(to->side);
    to->side = side;
    to->side_count += more->side_count;
    to->missing += more->missing;
    for (size_t p = 0; p < patches; p++) to->farthest[p] = fmax(to->farthest[p], more->farthest[p]);
    return true;
}

/* Computes the cells that are neither certain nor measured, and withdraws the certain ones that contain other places
 * than those from which they were computed. */
static bool build_exact(const voronoi_cells_input *in, const sites *s, int round, threads *pool,
                        voronoi_cells *c, error *e)
{
    uncertain u = {0};
    restricted_voronoi more = {0};
    c->certain_count = 0;
    for (size_t i = 0; i < c->count; i++) c->certain_count += c->planar[i].certain;
    bool ok = build_hierarchy(in, s, c, round, pool, e) && list_uncertain(s, c, false, pool, &u, e);
    if (ok && round > 0 && c->certain_count == 0) u.wanted.known = c->planar;
    u.wanted.again = round > 0;
    ok = ok && restricted_voronoi_build(in->surface, s, &u.wanted, pool, in->area, &more, e);
    free_uncertain(&u);
    for (size_t i = 0; ok && i < c->count; i++) c->planar[i].measured = !c->planar[i].certain;
    for (size_t k = 0; ok && k < more.exceeded_count; k++)
        c->planar[more.exceeded[k]] = (planar_cell){.certain = false};
    if (round == 0) {
        c->exact = more;
        return ok;
    }
    ok = ok && add_cells(&c->exact, &more, in->surface->in.patch_count, e);
    restricted_voronoi_free(&more);
    return ok;
}

/* The areas of the cells of a piece, and what the bend of the surface adds to certain ones. */
typedef struct piece_area {
    double cells, bend;
} piece_area;

/* Withdraws the certain cells of pieces whose cells do not add up to their area. */
static bool withdraw(const facets *f, const sites *s, voronoi_cells *c, error *e)
{
    piece_area *sum = mem_array(f->piece_count, sizeof *sum, what, e);
    for (uint32_t i = 0; sum && i < c->count; i++) {
        sum[sites_piece(s, i)].cells += c->area[i];
        sum[sites_piece(s, i)].bend += c->planar[i].bend / PLANAR_BEND * c->area[i];
    }
    for (uint32_t i = 0; sum && i < c->count; i++) {
        const double area = f->piece_area[sites_piece(s, i)];
        const piece_area *of = &sum[sites_piece(s, i)];
        const double lack = area - of->cells;
        if (!c->planar[i].certain ||
            (lack >= -AREA_TOLERANCE * area && lack <= AREA_TOLERANCE * area + BEND_TOLERANCE * of->bend))
            continue;
        c->planar[i] = (planar_cell){.certain = false};
    }
    free(sum);
    return sum != NULL;
}

/* The largest distances of each patch, of certain cells. */
static void add_distances(const sites *s, voronoi_cells *c)
{
    for (size_t i = 0; i < c->count; i++) {
        if (!c->planar[i].certain) continue;
        double *farthest = &c->exact.farthest[sites_patch(s, sites_first(s, (uint32_t)i))];
        *farthest = fmax(*farthest, c->planar[i].farthest / s->spacing[i]);
    }
}

/* Whether each cell is certain or measured. */
static bool is_complete(const voronoi_cells *c)
{
    bool complete = true;
    for (size_t i = 0; i < c->count; i++) complete &= c->planar[i].certain || c->planar[i].measured;
    return complete;
}

static void reach(void *context, uint32_t point)
{
    ((bool *)context)[point] = true;
}

/* Withdraws all certain cells if triangles are needed for more than MOST_REACHED of all. */
static bool withdraw_few(const sites *s, voronoi_cells *c, error *e)
{
    const double most = MOST_REACHED * (double)c->count;
    size_t rest = 0, reached = 0;
    bool *is_reached = mem_array(c->count + 1, sizeof *is_reached, what, e);
    if (!is_reached) return false;
    for (size_t i = 0; i < c->count; i++) rest += is_reached[i] = !c->planar[i].certain;
    for (size_t i = 0; (double)rest <= most && i < c->count; i++)
        if (!c->planar[i].certain)
            cell_list_within(s->near, s->position[i], VORONOI_FIRST_RING * s->spacing[i], reach, is_reached);
    for (size_t i = 0; i < c->count; i++) reached += is_reached[i];
    for (size_t i = 0; (double)reached > most && i < c->count; i++)
        c->planar[i] = (planar_cell){.certain = false};
    free(is_reached);
    return true;
}

bool voronoi_cells_build(const voronoi_cells_input *in, threads *pool, pair_energies *energy, measures *pairs,
                         voronoi_cells *out, error *e)
{
    sites s = *in->pairs->sites;
    *out = (voronoi_cells){.count = s.count, .area = in->area};
    out->planar = mem_array(s.count, sizeof *out->planar, what, e);
    if (!out->planar ||
        !pair_measures_take(in->pairs, pool, in->exact ? NULL : out->planar, in->area, energy, pairs, e))
        return false;
    s.near = out->near = cell_list_new(s.position, s.count, pool, e);
    bool ok = out->near && withdraw_few(&s, out, e), found = true;
    for (int round = 0; ok && found; round++) {
        ok = build_exact(in, &s, round, pool, out, e) &&
             (out->certain_count == 0 || withdraw(in->surface, &s, out, e));
        found = !is_complete(out);
    }
    if (ok) add_distances(&s, out);
    return ok;
}

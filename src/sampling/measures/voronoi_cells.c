// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/voronoi_cells.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"

/* A place can belong to the cell of a point that is farther from it than the nearest point by this, in the
 * largest spacing: the nearest point can be on an opposite wall. */
static const double BEYOND_NEAREST = 0.7;
/* The area of a piece may differ from that of its cells by this fraction of it, and by this multiple of what the
 * bend of the surface adds to certain cells: on meshes, whose triangles meet in edges between the points, the
 * normals give a third of what the edges add. */
static const double AREA_TOLERANCE = 5e-4, BEND_TOLERANCE = 1.2;
/* With a smaller share of certain cells all are computed from triangles: if their areas were wrong, the others
 * would have been computed twice. */
static const double LEAST_CERTAIN = 0.3;

static const char what[] = "the measures of the surface";

void voronoi_cells_free(voronoi_cells *c)
{
    free(c->planar);
    cell_list_free(c->near);
    restricted_voronoi_free(&c->exact);
    *c = (voronoi_cells){0};
}

/* The points whose cells are computed from triangles. */
typedef struct uncertain {
    voronoi_wanted wanted;
    vec3 *position;
    const cell_list *near; /* all points */
} uncertain;

static void free_uncertain(uncertain *u)
{
    cell_list_free(u->wanted.list);
    free(u->position);
}

/* Free *out also after failure. */
static bool list_uncertain(const sites *s, voronoi_cells *c, threads *pool, uncertain *out, error *e)
{
    *out = (uncertain){.near = s->near};
    c->certain_count = 0;
    for (size_t i = 0; i < c->count; i++) c->certain_count += c->planar[i].certain;
    if (c->certain_count == 0) return true;
    const size_t others = c->count - c->certain_count;
    out->wanted = (voronoi_wanted){c->planar, NULL, BEYOND_NEAREST * s->largest_spacing};
    if (others == 0) return true;
    out->position = mem_array(others, sizeof *out->position, what, e);
    if (!out->position) return false;
    for (size_t i = 0, k = 0; i < c->count; i++)
        if (!c->planar[i].certain) out->position[k++] = s->position[i];
    out->wanted.list = cell_list_new(out->position, others, pool, e);
    return out->wanted.list != NULL;
}

static bool is_needed(const void *context, vec3 centre, double radius)
{
    const uncertain *u = context;
    double nearest;
    cell_list_nearest(u->near, centre, 0, &nearest);
    return voronoi_reaches(&u->wanted, centre, radius, nearest);
}

/* Computes the cells that are not certain. */
static bool build_exact(const voronoi_cells_input *in, const sites *s, threads *pool, voronoi_cells *c,
                        error *e)
{
    uncertain u;
    bool ok = list_uncertain(s, c, pool, &u, e);
    if (ok && !in->whole && c->certain_count < c->count)
        ok = facets_build(in->surface, c->certain_count > 0 ? is_needed : NULL, &u, pool, e);
    restricted_voronoi_free(&c->exact);
    ok = ok && restricted_voronoi_build(in->surface, s, &u.wanted, pool, in->area, &c->exact, e);
    for (size_t i = 0; ok && i < c->count; i++) {
        if (!c->planar[i].certain) continue;
        double *farthest = &c->exact.farthest[sites_patch(s, sites_first(s, (uint32_t)i))];
        *farthest = fmax(*farthest, c->planar[i].farthest / s->spacing[i]);
    }
    free_uncertain(&u);
    return ok;
}

/* The areas of the cells of a piece, and what the bend of the surface adds to certain ones. */
typedef struct piece_area {
    double cells, bend;
} piece_area;

/* Withdraws the certain cells of pieces whose cells do not add up to their area; *found: there are any. */
static bool withdraw(const facets *f, const sites *s, voronoi_cells *c, bool *found, error *e)
{
    piece_area *sum = mem_array(f->piece_count, sizeof *sum, what, e);
    *found = false;
    for (uint32_t i = 0; sum && i < c->count; i++) {
        sum[sites_piece(s, i)].cells += c->area[i];
        sum[sites_piece(s, i)].bend += c->planar[i].bend / PLANAR_BEND * c->area[i];
    }
    for (uint32_t i = 0; sum && i < c->count; i++) {
        const double area = f->piece_area[sites_piece(s, i)];
        const piece_area *of = &sum[sites_piece(s, i)];
        if (!c->planar[i].certain ||
            fabs(of->cells - area) <= AREA_TOLERANCE * area + BEND_TOLERANCE * of->bend)
            continue;
        c->planar[i] = (planar_cell){.certain = false};
        *found = true;
    }
    free(sum);
    return sum != NULL;
}

static void withdraw_few(voronoi_cells *c)
{
    size_t certain = 0;
    for (size_t i = 0; i < c->count; i++) certain += c->planar[i].certain;
    for (size_t i = 0; (double)certain < LEAST_CERTAIN * (double)c->count && i < c->count; i++)
        c->planar[i] = (planar_cell){.certain = false};
}

bool voronoi_cells_build(const voronoi_cells_input *in, threads *pool, pair_energies *energy, measures *pairs,
                         voronoi_cells *out, error *e)
{
    sites s = *in->pairs->sites;
    bool found = false;
    *out = (voronoi_cells){.count = s.count, .area = in->area};
    out->planar = mem_array(s.count, sizeof *out->planar, what, e);
    if (!out->planar ||
        !pair_measures_take(in->pairs, pool, in->exact ? NULL : out->planar, in->area, energy, pairs, e))
        return false;
    withdraw_few(out);
    s.near = out->near = cell_list_new(s.position, s.count, pool, e);
    if (!out->near || !build_exact(in, &s, pool, out, e)) return false;
    if (out->certain_count > 0 && !withdraw(in->surface, &s, out, &found, e)) return false;
    return !found || build_exact(in, &s, pool, out, e);
}

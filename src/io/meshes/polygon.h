// SPDX-License-Identifier: Apache-2.0
/* polygon: a polygon of a mesh file as triangles. Pure functions but for allocation; any thread. */
#ifndef HEXAD_IO_MESHES_POLYGON_H
#define HEXAD_IO_MESHES_POLYGON_H

#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* POLYGON_CROSSED: the triangles overlap, because the polygon crosses itself. POLYGON_TOO_LARGE: the limit
 * on the work was exceeded. POLYGON_STOPPED: *stop was set. */
typedef enum polygon_result {
    POLYGON_CUT,
    POLYGON_CROSSED,
    POLYGON_TOO_LARGE,
    POLYGON_STOPPED,
    POLYGON_NO_MEMORY
} polygon_result;

/* Cuts a polygon of `count` >= 3 corners, whose places are place[corner[k]], into count - 2 triangles between
 * its corners, turned as the polygon. out[] holds values of corner[], which are vertex indices. Every corner
 * is used, also one on a straight line, so that neighbours share whole edges.
 *
 *            3
 *           /|\
 *          / | \         corner 1 is reflex: the diagonal from 0 to 2 lies outside. 0 and 2 are ears;
 *         /  1  \        the triangles are 3 0 1 and 3 1 2
 *        / .' '. \
 *       0         2
 *
 * The triangles of a simple planar polygon cover it once, and lie within it. A spike, of which two sides lie
 * on each other to within rounding, becomes a triangle without area. A quadrangle is cut along the shorter of
 * its diagonals that lie inside. A polygon of more corners that is not planar is cut as its projection along
 * the coordinate axis nearest to its normal. A convex polygon becomes a fan. Copies of a polygon are cut
 * alike, whichever corner they begin with and whichever way round they are: where two diagonals are equal,
 * and for the centre of a fan, the corner with the least x is taken; at equal x the one with the least y,
 * then the least z. Polygons that are not convex: ears are clipped (Meisters 1975) with exact orientations
 * (Shewchuk 1997), each tested against the reflex corners in its box alone, which a grid finds. The work is
 * limited to 2^30 such tests, a few seconds. Polygons of 100 000 corners take a thousandth of that, unless
 * they are constructed to be slow. A polygon that crosses itself may have no ear: after a number of searches that grows
 * with its corners, the remaining ones are cut off as they come. `stop` may be NULL.
 */
polygon_result polygon_cut(const double (*place)[3], const uint32_t *corner, size_t count,
                           const volatile sig_atomic_t *stop, uint32_t (*out)[3]);

#endif

/* voronoi: the Voronoi diagram of points, restricted to their surface.
 *
 * Two points are joined when their bisector, in the plane through their midpoint with their mean normal,
 * is not cut away by a third. Seen from both ends the same, so that the edges are those of one
 * triangulation of the surface wherever the points resolve it. Pure functions, safe in any thread.
 *
 * voronoi_edge judges one pair with care; voronoi_star finds all that one point is joined to, from a polygon
 * in its tangent plane where that is sure to say the same. A star's edges have the lengths that its triangles
 * give.
 */
#ifndef HEXAD_SAMPLER_VORONOI_H
#define HEXAD_SAMPLER_VORONOI_H

#include <stdbool.h>
#include <stdint.h>

#include "geometry/vec3.h"
#include "sampler/neighbours.h"

typedef struct voronoi_sites {
    const vec3 *position, *normal;
    const double *spacing;  /* of an ideal packing at each point */
    const neighbours *near; /* lists within VORONOI_REACH times the mean spacing of a pair, or more */
} voronoi_sites;

/* Two points farther apart than this, in spacings, have others between them, even beside a vacancy: where
 * none are seen the two are on sheets that no edge joins, such as the floor of a cup and its outer wall. */
#define VORONOI_REACH 2.2
/* Points whose normals' cosine is below this are on another sheet; those beside a sharp edge are not. */
#define VORONOI_OTHER_SIDE -0.6

/* Whether the two points are joined, and the length of the Voronoi edge between them (0 or more). */
bool voronoi_edge(const voronoi_sites *sites, uint32_t a, uint32_t b, double *length);

#define VORONOI_STAR_MAX 255

typedef struct voronoi_star {
    uint32_t count; /* may be more than the arrays hold, of a point that is joined to a crowd */
    uint32_t point[VORONOI_STAR_MAX];
    uint32_t place[VORONOI_STAR_MAX];  /* of each in the list */
    double distance[VORONOI_STAR_MAX]; /* to each */
    double edge[VORONOI_STAR_MAX];     /* length of the Voronoi edge between */
} voronoi_star;

/* How many of the star's points are in its arrays. */
static inline uint32_t voronoi_star_held(const voronoi_star *s)
{
    return s->count < VORONOI_STAR_MAX ? s->count : VORONOI_STAR_MAX;
}

/* All points of the list of `a` that it is joined to, those on another sheet left out: b is in the star of a
 * where a is in that of b. In no particular order. */
void voronoi_star_at(const voronoi_sites *sites, uint32_t a, voronoi_star *out);

/* The same from the polygon that the bisectors bound in the tangent plane of `a`. False, where the surface
 * bends too much for it or the polygon comes near to one with other edges: `out` is undefined then. */
bool voronoi_star_clear(const voronoi_sites *sites, uint32_t a, voronoi_star *out);

#endif

/* voronoi: the Voronoi diagram of points, restricted to their surface.
 *
 * Two points are joined when their bisector, in the plane through their midpoint with their mean normal,
 * is not cut away by a third. Seen from both ends the same, so that the edges are those of one
 * triangulation of the surface wherever the points resolve it. Pure functions, safe in any thread.
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
    const neighbours *near; /* lists within VORONOI_REACH times the mean spacing of a pair */
} voronoi_sites;

/* Wide enough for the cell of a point beside a vacancy. */
#define VORONOI_REACH 3.0
/* Points whose normals' cosine is below this are on another sheet; those beside a sharp edge are not. */
#define VORONOI_OTHER_SIDE -0.6

/* Whether the two points are joined, and the length of the Voronoi edge between them (0 or more). */
bool voronoi_edge(const voronoi_sites *sites, uint32_t a, uint32_t b, double *length);

#endif

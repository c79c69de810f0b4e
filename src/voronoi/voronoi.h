/* voronoi: the Voronoi diagram of points, restricted to their surface, by its dual triangulation.
 *
 * Three points are a triangle of the surface when it is one of the Delaunay triangulation in space that has
 * the inside on one side and the outside on the other (Edelsbrunner and Shah 1997): of two tetrahedra that
 * share it, the circumcentre of one is inside and that of the other is not, as the normals of the corners
 * say. So the triangles are the same seen from all corners, at creases and corners of the surface too. Points
 * on another sheet are not seen. Pure functions, safe in any thread.
 */
#ifndef HEXAD_VORONOI_VORONOI_H
#define HEXAD_VORONOI_VORONOI_H

#include <stdbool.h>
#include <stdint.h>

#include "geometry/vec3.h"
#include "packing/neighbours.h"

typedef struct voronoi_sites {
    const vec3 *position, *normal;
    const double *spacing;  /* of an ideal packing at each point */
    const neighbours *near; /* lists within VORONOI_REACH times the mean spacing of a pair, or more */
    const uint8_t *flags;   /* of packing.h, of each; NULL: none */
    const uint32_t *index;  /* of each among all, ascending, where these are a part; NULL: they are all */
} voronoi_sites;

/* Two points farther apart than this, in spacings, have others between them, even beside a vacancy: where
 * none are seen the two are on sheets that no edge joins, such as the floor of a cup and its outer wall. */
#define VORONOI_REACH 2.2
/* Points whose normals' cosine is below this are on another sheet; those beside a sharp edge are not. */
#define VORONOI_OTHER_SIDE -0.6

/* Points with longer lists have none: they lie in a heap. */
#define VORONOI_STAR_MAX 256

/* A point's neighbours, in no particular order. */
typedef struct voronoi_star {
    uint32_t count;
    uint32_t point[VORONOI_STAR_MAX];
    uint32_t place[VORONOI_STAR_MAX];    /* of each in the list */
    double distance[VORONOI_STAR_MAX];   /* to each */
    double edge[VORONOI_STAR_MAX];       /* length of the Voronoi edge between; may be negative at corners */
    uint8_t triangles[VORONOI_STAR_MAX]; /* that it is in: 2, but beside boundaries and holes */
    bool pinched; /* one is in more than 2, or there are too many: the triangles do not bound one cell */
    uint32_t triangle_count;
    uint8_t corner[VORONOI_STAR_MAX][2]; /* of each triangle the two others, by their places in `point` */
} voronoi_star;

/* b is in the star of a where a is in that of b. */
void voronoi_star_at(const voronoi_sites *sites, uint32_t a, voronoi_star *out);

/* Of the point's cell; 0 where neighbours lie in one place or on a line with the point, so that it cannot be told. */
double voronoi_star_area(const voronoi_star *star);

/* Its two ways. Triangles are always right. The polygon that the bisectors bound in the tangent plane of `a`
 * takes a twentieth of the time; false, where the surface bends too much for it or another polygon would be
 * nearly as good: `out` is undefined then. */
void voronoi_star_triangles(const voronoi_sites *sites, uint32_t a, voronoi_star *out);
bool voronoi_star_clear(const voronoi_sites *sites, uint32_t a, voronoi_star *out);

#endif

// SPDX-License-Identifier: Apache-2.0
/* voronoi: the Voronoi diagram of points restricted to their surface, by its dual, the restricted Delaunay
 * triangulation.
 *
 *              o outside: the circumcentre of the tetrahedron above
 *              |
 *      a ----- b ----- c   the surface, with three points seen from the side
 *              |
 *              o inside: the circumcentre of the tetrahedron below
 *
 * Three points form a triangle of the surface if it is a triangle of the Delaunay triangulation in space
 * whose dual Voronoi edge crosses the surface (Edelsbrunner and Shah 1997, "Triangulating Topological
 * Spaces"). The edge crosses the surface if one of its ends, the circumcentres of the two tetrahedra that
 * share the triangle, is inside the solid and the other outside. The normals of the corners determine which.
 * The result is therefore the same from each corner, also at creases and corners of the surface. Points on
 * the opposite wall of a thin part are ignored. The star of a point is the set of the triangles that contain
 * it; its neighbours are the other corners of these. World space. Pure functions, any thread.
 */
#ifndef HEXAD_SAMPLING_VORONOI_VORONOI_H
#define HEXAD_SAMPLING_VORONOI_VORONOI_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "geometry/space/vec3.h"
#include "sampling/packing/neighbours.h"

/* The points; arrays are owned by the caller. */
typedef struct voronoi_sites {
    const vec3 *position, *normal; /* normals: unit */
    const double *spacing;         /* of an ideal packing at each point, world units, > 0 */
    /* lists within at least VORONOI_REACH times the mean spacing of a pair */
    const neighbours *near;
    const uint8_t *flags; /* per point, of sampling/packing/point_flags.h; NULL: none */
    /* per point of a subset: its index in the whole set, ascending; NULL: the points are the whole set */
    const uint32_t *index;
} voronoi_sites;

/* Maximum distance of Voronoi neighbours in spacings (the mean of both points). Two points of one wall that
 * are farther apart are not neighbours: other points lie between them, even beside a vacancy. If no point
 * lies between them, they are on two walls that do not meet at a crease, such as the floor of a cup and
 * its outer wall. */
#define VORONOI_REACH 2.2
/* Points whose normals have a smaller cosine than this are on opposite walls. At a sharp edge the cosine
 * is larger. */
#define VORONOI_OPPOSITE_COSINE -0.6

/* Longest neighbour list that is evaluated. For a point with a longer list the points are over-dense:
 * voronoi_star_triangles returns an empty star (count and triangle_count 0) with `pinched` set. */
#define VORONOI_STAR_MAX 256

/* The star of a point. Neighbours are in no particular order. */
typedef struct voronoi_star {
    uint32_t count; /* neighbours */
    uint32_t point[VORONOI_STAR_MAX];
    uint32_t place[VORONOI_STAR_MAX];  /* per neighbour: its entry in the neighbour list */
    double distance[VORONOI_STAR_MAX]; /* per neighbour, world units */
    /* per neighbour: length of the Voronoi edge, world units; may be negative at corners */
    double edge[VORONOI_STAR_MAX];
    /* per neighbour: triangles with it; 2, fewer beside boundaries and holes */
    uint8_t triangles[VORONOI_STAR_MAX];
    /* the triangles do not bound one cell: a neighbour is in more than 2 triangles, there are more than
     * VORONOI_STAR_MAX triangles, or the neighbour list is longer than VORONOI_STAR_MAX */
    bool pinched;
    uint32_t triangle_count;
    uint8_t corner[VORONOI_STAR_MAX][2]; /* per triangle: its two other corners, as indices of `point` */
} voronoi_star;

/* Computes the star of point a: by voronoi_star_planar, or if that fails by voronoi_star_triangles.
 * Symmetric: b is in the star of a if and only if a is in the star of b. */
void voronoi_star_at(const voronoi_sites *sites, uint32_t a, voronoi_star *out);

/* Area of the Voronoi cell of the point, world units squared. 0: undefined, because the point has no
 * neighbours, or they coincide or are collinear with it. */
double voronoi_star_area(const voronoi_star *star);

/* Points of the neighbour list of a point, as separate arrays for SIMD. */
typedef struct voronoi_listed {
    uint32_t first, count; /* the entries of the list: from `first` on */
    bool complete;         /* these are the whole list */
    /* per entry: its offset from the point in the point's tangent frame (z: along the normal), its squared
     * distance, the cosine between the normals, and its spacing */
    double x[VORONOI_STAR_MAX], y[VORONOI_STAR_MAX], z[VORONOI_STAR_MAX], square[VORONOI_STAR_MAX],
        facing[VORONOI_STAR_MAX], spacing[VORONOI_STAR_MAX];
} voronoi_listed;

/* Computes the values of at most VORONOI_STAR_MAX entries of the list of point `a`, from entry `first` on. */
void voronoi_gather_listed(const voronoi_sites *sites, uint32_t a, uint32_t first, voronoi_listed *out);

/* Distance of the points that are tried first for a planar polygon, in spacings: mostly the neighbours alone. */
#define VORONOI_FIRST_RING 1.45

/* When a planar polygon is used. */
typedef struct voronoi_planar_bounds {
    double cosine; /* minimum cosine between the normal of the point and those of the points around it */
    double edge;   /* in spacings: minimum length of an edge, and by which other points miss the polygon */
    /* The cosine holds for the points that can bound the cell, otherwise for the whole list. The edge is at least 1
     * minus the smallest of their cosines. */
    bool near_only;
    /* The surface has no border near: the angle between two neighbours may exceed 90 degrees. Beside a border such an
     * angle means that the corner of the polygon is beyond it. */
    bool wide;
} voronoi_planar_bounds;

/* The two algorithms of voronoi_star_at. voronoi_star_triangles is valid for all points. voronoi_star_planar
 * clips the tangent plane of `a` by bisectors, and takes a twentieth of the time of voronoi_star_triangles.
 * `listed`: the whole list of `a`. Neighbours are in counterclockwise order, at most VORONOI_PLANAR_MAX. It
 * returns false, with *out undefined, if the surface bends too much, if the neighbours do not enclose the
 * point, if another polygon would be nearly as good, or if the list is longer than VORONOI_STAR_MAX. */
#define VORONOI_PLANAR_MAX 32
void voronoi_star_triangles(const voronoi_sites *sites, uint32_t a, voronoi_star *out);
bool voronoi_star_planar(const voronoi_sites *sites, uint32_t a, const voronoi_listed *listed,
                         voronoi_star *out);

/* The neighbours of voronoi_star_planar for a point with the given spacing, as entries of its list. Returns
 * their number; 0 in the cases in which voronoi_star_planar returns false. */
uint32_t voronoi_planar_neighbours(const voronoi_listed *listed, double spacing,
                                   const voronoi_planar_bounds *bounds, uint32_t place[VORONOI_PLANAR_MAX]);

#endif

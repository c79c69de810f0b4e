/* triangulation: the restricted Delaunay triangulation (voronoi.h) of a finished point set, and tests whether it is a surface.
 *
 * Where the points resolve the surface, each edge is in two triangles, or the triangulation ends at a boundary of the surface. Elsewhere, as
 * between walls closer than the spacing, it may have holes and edges of more than two triangles. triangulation_facts counts these from the
 * triangles alone. Before that, holes of up to eight edges are closed if triangles can close them that face the way of their corners' normals.
 * World space.
 */
#ifndef HEXAD_VORONOI_TRIANGULATION_H
#define HEXAD_VORONOI_TRIANGULATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/bbox.h"
#include "geometry/vec3.h"

/* All arrays are owned by the caller. */
typedef struct triangulation_input {
    size_t count;
    const vec3 *position, *normal; /* normals: unit */
    const double *spacing;         /* requested, per point, world units, > 0 */
    bool open;                     /* the surface has boundaries in the faces of `domain` */
    bbox domain;
    /* The following are NULL for a surface without patches. Per point: its label (only points of one label form triangles) and its flags
     * (packing/packing.h). Fixed points may lie on a boundary. */
    const uint32_t *label;
    const uint8_t *flags;
    /* per point: its vertex, a point at the same position; vertices are the first `points` points */
    const uint32_t *point;
    size_t points;
    /* Steps along feature curves, as pairs of points; each once for each label that ends there. NULL: unknown. Holes are closed up to these. */
    const uint32_t (*side)[2];
    size_t side_count;
    /* whether x is on the surface of the label, not beyond its curves */
    bool (*is_within)(const void *context, uint32_t label, vec3 x);
    const void *context;
} triangulation_input;

typedef struct triangulation_facts {
    size_t triangles, edges;
    size_t hole_triangles; /* triangles that close small holes */
    int64_t euler;         /* points - edges + triangles */
    size_t boundary_edges; /* edges of one triangle */
    /* boundary edges with both ends within a spacing of a boundary, or along a curve at which one label ends */
    size_t rim_edges;
    size_t nonmanifold_edges; /* edges of more than two triangles, or of two of opposite orientation */
    size_t seam_edges;        /* nonmanifold edges along curves at which as many labels end */
    /* vertices in no triangle, or where surfaces touch in a point; not at nonmanifold edges */
    size_t nonmanifold_vertices;
    double radius_ratio; /* mean of 2 r_in / R_circ of the triangles; 1: all are equilateral */
} triangulation_facts;

typedef struct triangulation {
    uint32_t (*corner)[3]; /* per triangle, counterclockwise seen from outside, the least index first */
    uint32_t *label;       /* per triangle; NULL if points have none */
    triangulation_facts facts;
} triangulation;

/* Triangulates the points. Free *out also after failure. Errors: limit_memory, cancelled. Deterministic for any number of threads. */
bool triangulation_make(const triangulation_input *in, threads *pool, triangulation *out, error *e);
/* Computes the facts of existing triangles made->corner, of which there are facts.triangles, between vertices of the input. */
bool triangulation_survey(const triangulation_input *in, threads *pool, triangulation *made, error *e);
void triangulation_free(triangulation *t);

/* Whether the triangles are one or several manifold surfaces, which may meet in seams and end only at boundaries of the surface. */
bool triangulation_is_manifold(const triangulation_facts *facts);
/* Whether in addition there is no boundary. */
bool triangulation_is_closed(const triangulation_facts *facts);

#endif

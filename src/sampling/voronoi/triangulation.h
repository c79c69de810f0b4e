// SPDX-License-Identifier: Apache-2.0
/* triangulation: the restricted Delaunay triangulation (voronoi.h) of a finished point set, and tests whether
 * it is a surface.
 *
 * Where the points resolve the surface, each edge is in two triangles, or the triangulation ends at a
 * boundary of the surface. Elsewhere, as between walls closer than the spacing, it may have holes and edges
 * of more than two triangles. triangulation_facts counts these from the triangles alone.
 *
 * triangulation_make closes small holes before it counts. Not closed are
 * - holes of more than eight edges;
 * - holes with a point within a spacing of a boundary of the surface, or without `side` at a fixed point;
 * - holes that cannot be closed by triangles that face the way of the normals of their corners.
 * World space.
 */
#ifndef HEXAD_SAMPLING_VORONOI_TRIANGULATION_H
#define HEXAD_SAMPLING_VORONOI_TRIANGULATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/bbox.h"
#include "geometry/space/vec3.h"

/* All arrays are owned by the caller. */
typedef struct triangulation_input {
    size_t count;
    const vec3 *position, *normal; /* normals: unit */
    const double *spacing;         /* requested, per point, world units, > 0 */
    bool open; /* the surface has boundaries in the faces of `domain`; they count as boundaries below */
    bbox domain;
    /* The following are NULL for a surface without patches. Per point: its label (only points of one label
     * form triangles) and its flags (sampling/packing/point_flags.h). Fixed points may lie on a boundary. */
    const uint32_t *label;
    const uint8_t *flags;
    /* Per point: the index of its vertex, a point at the same position. Several points, one for each label,
     * may have one vertex. The vertices are the points 0 .. points - 1. */
    const uint32_t *point;
    size_t points;
    /* Steps along feature curves, as pairs of points; each occurs once for each label that ends there. NULL:
     * unknown. A hole may have such steps as edges; the triangles that close it end there. Triangles
     * beyond the curves are removed. */
    const uint32_t (*side)[2];
    size_t side_count;
    /* For triangulation_survey: each label has its own vertices. An edge along a curve should then have one triangle
     * for each of its steps. */
    bool ends_at_steps;
    /* Whether x is on the surface of the label, not beyond its curves. Triangles of three fixed points with a
     * centroid beyond are removed. Required if there are flags. */
    bool (*is_within)(const void *context, uint32_t label, vec3 x);
    const void *context;
} triangulation_input;

typedef struct triangulation_facts {
    size_t triangles, edges;
    size_t hole_triangles; /* triangles that close small holes */
    int64_t euler;         /* vertices - edges + triangles */
    size_t boundary_edges; /* edges of one triangle */
    /* boundary edges where the surface really ends: both ends are within a spacing of a boundary of the
     * surface, or the edge is along a curve at which one label ends */
    size_t rim_edges;
    size_t nonmanifold_edges; /* edges of more than two triangles, or of two of opposite orientation */
    /* nonmanifold edges along a curve whose number of triangles is the number of labels that end there */
    size_t seam_edges;
    /* vertices in no triangle, or where surfaces touch in a point; ends of nonmanifold edges are not
     * counted */
    size_t nonmanifold_vertices;
    size_t off_steps;    /* with ends_at_steps: triangles that are missing or in excess along curves */
    double radius_ratio; /* mean of 2 r_in / R_circ of the triangles; 1: all are equilateral */
} triangulation_facts;

typedef struct triangulation {
    uint32_t (*corner)[3]; /* per triangle, counterclockwise seen from outside, the least index first */
    uint32_t *label;       /* per triangle; NULL if points have none */
    triangulation_facts facts;
} triangulation;

/* Triangulates the points, closes small holes and computes the facts. Free *out also after failure. Errors:
 * limit_memory, cancelled. Deterministic for any number of threads. */
bool triangulation_make(const triangulation_input *in, threads *pool, triangulation *out, error *e);
/* Of triangles between points: sets the labels, and replaces points by their vertices. Error: limit_memory. */
bool triangulation_join(const triangulation_input *in, triangulation *made, error *e);
/* Computes the facts of existing triangles: made->corner has made->facts.triangles of them, between vertices
 * of the input. Closes no holes; keeps facts.hole_triangles. faulty[v], for each vertex: whether it is in no
 * triangle, or touches an edge that is a fault, or its triangles form several fans; or NULL. Errors:
 * limit_memory, cancelled. */
bool triangulation_survey(const triangulation_input *in, threads *pool, triangulation *made, bool *faulty,
                          error *e);
void triangulation_free(triangulation *t);

/* The number of faults: nonmanifold edges that are not seam edges, nonmanifold vertices, boundary edges that are
 * not rim edges, and off_steps. */
size_t triangulation_faults(const triangulation_facts *facts);
/* Whether the triangles are one or several manifold surfaces, which may meet in seams and end only at
 * boundaries of the surface: there is a triangle, and there are no faults. True for an open surface that ends
 * at a face of the domain. */
bool triangulation_is_manifold(const triangulation_facts *facts);
/* Whether in addition there is no boundary edge: false for every open surface. */
bool triangulation_is_closed(const triangulation_facts *facts);

#endif

/* triangulation: the triangles of the restricted Delaunay triangulation (voronoi.h) of a finished point set,
 * and whether they are a surface.
 *
 * Where the points resolve the surface the triangles close it, each edge in two of them, or leave off at its
 * boundaries. Elsewhere, as between sheets closer than the spacing, they may not: the facts say so, all of them
 * counted from the triangles alone. Before that holes of up to eight edges are closed, where triangles that
 * face as their corners do can close them.
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

typedef struct triangulation_input {
    size_t count;
    const vec3 *position, *normal;
    const double *spacing; /* requested, of each */
    bool open;             /* boundaries at the faces of `domain` */
    bbox domain;
    /* Of a surface with patches, else NULL. Triangles are between points of one label; flags are those of packing.h, and
     * there are boundaries between points that are fixed. Points of several labels may be one vertex. */
    const uint32_t *label;
    const uint8_t *flags;
    const uint32_t
        *point; /* of each its vertex, which is a point of the same place: one of the first `points` */
    size_t points;
    /* The steps along curves: between which of `count`, once for each label that ends there; NULL: not known. Holes are
     * closed up to them. */
    const uint32_t (*side)[2];
    size_t side_count;
    bool (*is_within)(const void *context, uint32_t label,
                      vec3 x); /* whether its part of the surface has a place there */
    const void *context;
} triangulation_input;

typedef struct triangulation_facts {
    size_t triangles, edges;
    size_t closing;        /* of the triangles those that close small holes which the stars have left */
    int64_t euler;         /* points - edges + triangles */
    size_t boundary_edges; /* in one triangle */
    size_t rim_edges;      /* of them those with both ends within a spacing of a boundary, or along a curve at
                                  * which one label ends */
    size_t nonmanifold_edges;    /* in more than two triangles, or in two that face opposite ways */
    size_t seam_edges;           /* of them those along curves, where as many labels end */
    size_t nonmanifold_vertices; /* in no triangle, or where surfaces touch in a point; not at such edges */
    double radius_ratio;         /* mean of 2 r_in / R_circ over the triangles, 1 where all are equilateral */
} triangulation_facts;

typedef struct triangulation {
    uint32_t (
        *corner)[3]; /* of each triangle, counterclockwise seen from outside; the first has the least index */
    uint32_t *label; /* of each; NULL where points have none */
    triangulation_facts facts;
} triangulation;

/* Release also after failure. Errors: limit_memory, cancelled. Deterministic for any number of threads. */
bool triangulation_make(const triangulation_input *in, threads *pool, triangulation *out, error *e);
/* The facts of triangles that are there already, of the input's vertices: made->corner, facts.triangles of them. */
bool triangulation_survey(const triangulation_input *in, threads *pool, triangulation *made, error *e);
void triangulation_free(triangulation *t);

/* Whether the triangles are a surface, or several that meet in seams, that ends nowhere but at boundaries, and whether it
 * ends nowhere. */
bool triangulation_is_whole(const triangulation_facts *facts);
bool triangulation_is_closed(const triangulation_facts *facts);

#endif

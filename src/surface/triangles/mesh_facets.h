// SPDX-License-Identifier: Apache-2.0
/* mesh_facets: the facets of a mesh (see mesh_curvature.h) that consist of several coplanar triangles, and mean
 * value coordinates in them. Facets are found when they are requested. One thread at a time, except mesh_facet_weigh.
 */
#ifndef HEXAD_SURFACE_TRIANGLES_MESH_FACETS_H
#define HEXAD_SURFACE_TRIANGLES_MESH_FACETS_H

#include "surface/triangles/smooth_sides.h"

/* A corner of a facet: its vertex, as a corner of one of the facet's triangles. */
typedef struct mesh_facet_corner {
    uint32_t triangle;
    uint32_t corner;
} mesh_facet_corner;

typedef struct mesh_facet {
    bool is_apart; /* all sides of its boundary are creases */
    vec3 normal;   /* unit */
    /* its boundary: sides from corner side[k][0] to corner side[k][1], indices into `corner`. Empty if is_apart */
    size_t side_count, corner_count;
    uint32_t (*side)[2];
    mesh_facet_corner *corner;
} mesh_facet;

typedef struct mesh_facets {
    const smooth_sides *sides;
    uint32_t *of; /* per triangle: the index of its facet plus 1; 0: not requested */
    size_t count, room;
    mesh_facet *facet;
    uint32_t *queue; /* triangles of the facet in work */
    size_t queue_count, queue_room;
} mesh_facets;

/* `sides` is not owned. Free *out with mesh_facets_free, also after failure. Error: limit_memory. */
bool mesh_facets_begin(const smooth_sides *sides, mesh_facets *out, error *e);
void mesh_facets_free(mesh_facets *f);

/* Whether the facet of a triangle is the triangle itself. */
static inline bool mesh_facets_is_single(const mesh_facets *f, uint32_t triangle)
{
    return !smooth_sides_has_coplanar(f->sides, triangle);
}

/* Finds the facet of a triangle that has coplanar neighbours. Error: limit_memory. */
bool mesh_facets_request(mesh_facets *f, uint32_t triangle, error *e);

/* The facet, which was requested. */
static inline const mesh_facet *mesh_facets_of(const mesh_facets *f, uint32_t triangle)
{
    return &f->facet[f->of[triangle] - 1];
}

/* Called with the corners of a facet and their weights; a corner occurs once for each of its sides. A call with NULL
 * withdraws the corners before it. */
typedef void mesh_facet_visitor(void *context, const mesh_facet_corner *corner, double weight);

/* The mean value coordinates of a position x in the facet; they are not divided by their sum. */
void mesh_facet_weigh(const mesh_facet *f, const mesh *m, vec3 x, mesh_facet_visitor *visit, void *context);

#endif

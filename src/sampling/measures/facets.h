// SPDX-License-Identifier: Apache-2.0
/* facets: a surface as triangles in a bounding-volume hierarchy, for measures of points on it.
 *
 * An item is a triangle of a mesh, or a grid cell of a scanned surface, whose triangles are computed when
 * they are visited. The items are in Morton order. Each node of the hierarchy bounds the items of a range: a
 * sphere around them, and a cone that contains their normals. Both kinds of surface are therefore measured by
 * one program, and the triangles of a scan are never all in memory.
 *
 * Lengths are world units of the sampled space. Immutable once built; every function is safe in any number of
 * threads.
 */
#ifndef HEXAD_SAMPLING_MEASURES_FACETS_H
#define HEXAD_SAMPLING_MEASURES_FACETS_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/scan/surface.h"

#define FACETS_MIXED UINT32_MAX /* a node whose items have different pieces, or different patches */

/* The surface: a mesh, or a scan. */
typedef struct facets_input {
    size_t triangle_count;         /* > 0: a mesh */
    const vec3 *vertex;            /* of the mesh */
    const uint32_t (*triangle)[3]; /* consistently oriented */
    /* NULL: one patch; else the triangles of patch p are patch_first[p] .. patch_first[p + 1] - 1 */
    const size_t *patch_first;
    const surface *scan;         /* without a mesh: the surface's grid cells */
    size_t patch_count;          /* at least 1 */
    const uint32_t *patch_piece; /* the piece of each patch, or NULL: pieces are computed for each item */
} facets_input;

typedef struct facets_node {
    vec3 centre;
    double radius; /* every place of the items is within this of the centre */
    double area;
    float axis[3],
        angle; /* normals of the items differ from the axis by at most this angle, radians; >= pi: unknown */
    uint32_t piece, patch; /* of all items, or FACETS_MIXED */
    uint32_t begin, end;   /* its items, numbered in Morton order */
    uint32_t right;        /* the number of the second child; the first child follows the node; 0: a leaf */
} facets_node;

typedef struct facets {
    facets_input in;
    size_t item_count; /* of the hierarchy */
    uint32_t *item;    /* the item at each place of the order */
    uint32_t *piece;   /* of each item, or NULL: patch_piece, or all are of piece 0 */
    size_t piece_count;
    double *piece_area; /* per piece */
    double area;        /* area of the surface */
    facets_node *node;  /* node 0 is the root */
    size_t node_count;
    /* unit normals of grid cells, in item order; NULL for a mesh. They distinguish the sides and bound
     * angles */
    float (*face_normal)[3];
} facets;

/* A triangle of the surface. */
typedef struct facet {
    vec3 corner[3];
    vec3 normal; /* unit */
    double area;
    /* lengths on the surface in the item over those in its triangles, which cut off sharp edges: the root of the ratio
     * of their areas; 1 unless field.sharp */
    double stretch;
    uint32_t piece, patch;
    size_t item; /* index of its item in the order */
} facet;

/* Finds the pieces and their areas, without a hierarchy. The arrays of the input are owned by the caller and
 * must outlive *out. Free *out also after failure. Errors: no_surface (area 0), limit_memory. */
bool facets_open(const facets_input *in, facets *out, error *e);

/* An item: a sphere around it, and its area. */
typedef struct facets_item {
    vec3 centre;
    double radius, area;
    vec3 normal; /* unit, of a triangle of a mesh; of a grid cell 0 */
    uint32_t patch, piece;
} facets_item;

/* Which items a hierarchy contains: false if the item is not needed. Called by one thread. Groups of grid cells
 * are asked for at once. */
typedef bool (*facets_need)(const void *context, const facets_item *item);

/* Builds the hierarchy, in place of an earlier one. `need` NULL: of all items. Queries find only items of the
 * hierarchy, which may be empty. Errors: limit_memory, cancelled. */
bool facets_build(facets *f, facets_need need, const void *context, threads *pool, error *e);
void facets_free(facets *f); /* accepts a zeroed object */

/* The item at place k of the order. */
facets_item facets_item_at(const facets *f, size_t k);

/* The items of the surface, also those that are not in the hierarchy: their number, and the k-th of them. */
size_t facets_total(const facets *f);
facets_item facets_any_item(const facets *f, size_t k);

/* Computes the triangles with area of the item at place k of the order; returns their number. */
int facets_expand(const facets *f, size_t k, facet out[FIELD_CELL_TRIANGLES]);

/* A node for the triangles of one item, with their normals. */
facets_node facets_bound_triangles(const facets_item *item, int count, const facet *t);

/* Returns the place of the surface for a place x of a triangle. For a mesh it is x. The triangles of a scan
 * are near the surface: then it is found by Newton's method, or by bisection towards a corner of the cell. */
vec3 facets_onto(const facets *f, const facet *of, vec3 x);

/* Returns the place of the surface for the midpoint of an edge of such a triangle: the nearest one that
 * Newton's method finds, or the midpoint itself. */
vec3 facets_middle(const facets *f, uint32_t patch, vec3 a, vec3 b);

/* The place in the order of the item whose triangles are nearest to x. */
size_t facets_nearest(const facets *f, vec3 x);

/* The distance of x from the nearest triangle of the hierarchy, which is not empty. */
double facets_distance(const facets *f, vec3 x);

/* Finds for each place of a scan the piece of the nearest triangle, without a hierarchy. Errors: limit_memory,
 * cancelled. */
bool facets_find_pieces(const facets *f, const vec3 *x, size_t count, threads *pool, uint32_t *piece,
                        error *e);

/* The piece of the item at place k of the order. */
uint32_t facets_piece(const facets *f, size_t k);

/* The number of pieces of a mesh without patches. Error: limit_memory. */
bool facets_count_pieces(const facets_input *in, size_t *count, error *e);

/* The shape of the surface around a point. */
typedef struct facets_corner {
    double angle; /* of the surface around the point, radians: 2 pi inside a face, pi on a straight border */
    bool border;  /* the point lies on a border */
    bool fork;    /* more than two faces meet in an edge at the point */
} facets_corner;

/* Triangles within `tolerance` of x count as containing x. The angle is 0 if none does. */
void facets_corner_at(const facets *f, vec3 x, double tolerance, facets_corner *out);

#endif

/* star_lanes: clear stars (voronoi.h) of several points side by side, one in each lane of a vector: the same stars as one by one, to
 * the last bit, in six tenths of the time.
 *
 * A clear star is a point's cell in its tangent plane. Distances there are those in space, so that on a sphere the cell's edges are
 * the very ones of the diagram in space; elsewhere these lie off the plane by terms of second order in how far the surface bends
 * within the lists, which STAR_FLAT_FACING and STAR_FLAT_HEIGHT bound. A cell whose every edge is longer than STAR_CLEAR, in
 * spacings, and whose other points would have to come nearer by as much to have one, has the neighbours that the triangles find. */
#ifndef HEXAD_VORONOI_STAR_LANES_H
#define HEXAD_VORONOI_STAR_LANES_H

#include <math.h>
#include <stdint.h>

#include "voronoi/voronoi.h"

/* The cosine of an angle, the sine of its half. */
#define STAR_FLAT_FACING 0.9
#define STAR_FLAT_HEIGHT 0.22
/* Half of STAR_FLAT_FACING's angle away from VORONOI_OTHER_SIDE: on another sheet for every pair. */
#define STAR_OTHER_SIDE -0.77
/* On the tests' sets no clear star differs from the triangles'. */
#define STAR_CLEAR 0.225
/* Points that are looked at first, as far away as this in spacings: mostly the cell's neighbours alone. */
#define STAR_RING_FIRST 1.45

enum { STAR_LANES = 4, STAR_ROWS = 32 };

/* The lists of some points, entry by entry. */
typedef struct star_rows {
    uint32_t most; /* the longest list's length */
    uint32_t point[STAR_LANES], count[STAR_LANES];
    /* of each entry: the way there, its normal as the point sees it, its spacing. Behind a list's end they mean nothing. */
    double x[STAR_ROWS][STAR_LANES], y[STAR_ROWS][STAR_LANES], z[STAR_ROWS][STAR_LANES];
    double nx[STAR_ROWS][STAR_LANES], ny[STAR_ROWS][STAR_LANES], nz[STAR_ROWS][STAR_LANES];
    double spacing[STAR_ROWS][STAR_LANES];
    /* the cosine between both normals, and the squared distance */
    double facing[STAR_ROWS][STAR_LANES], square[STAR_ROWS][STAR_LANES];
} star_rows;

/* A number or a yes (all bits) of each lane, for functions marked ISA_CLONES. */
typedef double row __attribute__((vector_size(8 * STAR_LANES), aligned(8), may_alias));
typedef int64_t mask __attribute__((vector_size(8 * STAR_LANES), aligned(8), may_alias));

/* Lane by lane a where `which` is set, else b; vectors, or a number for all. (No functions: vectors are not handed over alike with and
 * without AVX.) */
#define CHOOSE(which, a, b) ((row)(((mask)(a) & (which)) | ((mask)(b) & ~(which))))
#define ALL(number) ((row){0} + (number))

/* The stars of up to STAR_LANES points, as voronoi_star_at has them. *rows is zeros, or what another call left. False when a list is
 * longer than STAR_ROWS: the rows mean nothing then. */
bool star_lanes_at(const voronoi_sites *sites, const uint32_t *points, uint32_t count, star_rows *rows,
                   voronoi_star *out);

#endif

/* quality: measures of a finished point set, from its points alone.
 *
 * Neighbours are those of the Voronoi diagram restricted to the surface (voronoi.h); the sum of (6 - degree)
 * tells the Euler characteristic.
 *
 * Where two sheets of the surface lie closer than 1.2 spacings, which points are neighbours is not told by
 * the points: a triangle of an ideal packing has a circumradius of 0.58 spacings, and balls that large about
 * places on the two sheets touch then. A point is unresolved when there is another within 1.7 spacings of it
 * (the mean of both; beside a hole of 1.2 in the other sheet), the cosine of whose normals is below -0.4, and
 * either is less than 1.2 spacings off the other's tangent plane. On a crease of right angle the cosine of a
 * spline's normals stays above -0.38. Unresolved points and those joined to them have no cell to be measured,
 * nor have those whose star is pinched or empty; unless the caller knows the cells otherwise. doc/report.md defines each measure.
 */
#ifndef HEXAD_VORONOI_QUALITY_H
#define HEXAD_VORONOI_QUALITY_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/bbox.h"
#include "geometry/vec3.h"

/* When a point is unresolved, see above: the cosine of normals, and distances in spacings. */
#define QUALITY_SHEET_FACING -0.4
#define QUALITY_SHEET_REACH 1.7
#define QUALITY_SHEET_GAP 1.2
/* Of a sine, squared: sharper edges reach no farther. */
#define QUALITY_WEDGE_LEAST 0.01
/* How far from the edge at which two sheets meet they are no farther apart, in spacings; and one more, as rows are at places. */
static inline double quality_wedge_reach(double cosine)
{
    return QUALITY_SHEET_GAP / sqrt(fmax(1 - cosine * cosine, QUALITY_WEDGE_LEAST)) + 1;
}

typedef struct quality_input {
    size_t count;
    const vec3 *position, *normal;
    const double *spacing; /* requested spacing of each, world units */
    double h;              /* spacing of the ideal even packing (packing_spacing) */
    bool sized;            /* the energies' support is that of each pair's spacing, not that of h */
    bool open;             /* boundaries at the faces of `domain` */
    bbox domain;
    /* of a surface with patches, else NULL: points of one label are neighbours, and flags of packing.h: boundaries are where
     * points are fixed, too */
    const uint32_t *label;
    const uint8_t *flags;
    size_t every; /* one point of so many is measured, and counts are of those; 0: all are */
} quality_input;

/* How regular the cells of some points are. NAN where too few are measured to say. */
typedef struct quality_cells {
    double hex_fraction; /* share with six neighbours */
    double edge_cv, area_cv;
} quality_cells;

typedef struct quality {
    quality_cells resolved; /* of points with a cell; so is grading */
    quality_cells all;      /* of these and of those without; near boundaries there are none */
    size_t resolved_count;  /* points with a cell */
    double resolved_share;  /* of the points that are not near a boundary; NAN where all are */
    /* mean E_i / E_ideal - 1 of the cotangent energy, support sqrt(3) h. Sized: sqrt(3) times the mean of the pair's
     * spacings, E_i over its own spacing squared */
    double energy_excess;
    /* the same against perfect order with cells as large on the whole, as many neighbours as the surface's Gaussian curvature
     * demands, and a spacing that grows as much as requested */
    double disorder;
    double min_spacing_ratio; /* smallest distance of neighbours over the mean of their spacings */
    size_t rim_count;         /* points within two spacings of a boundary, left out of the above */
    size_t unresolved_count;  /* others without a cell */
    double euler;             /* sum of (6 - degree) / 6 over all points */
    double grading_cv;        /* of local over requested spacing */
    double grading_exponent;  /* of local against requested, 1 is ideal; 1 when requested is even */
} quality;

/* Of the points that are not near a boundary, those without a cell; NAN where all are near one. 1 - resolved_share is above .02 by a
 * rounding where 2 of 100 points have none. */
static inline double quality_unresolved_share(const quality *q)
{
    const double without = (double)q->unresolved_count;
    return without / (without + (double)q->resolved_count);
}

/* `spacing_local` (count values, or NULL) receives sqrt(2 a / sqrt 3), and where the triangles around a point bound no
 * cell, or the point is fixed, the requested spacing; `degree` (or NULL) the number of
 * Voronoi neighbours. Error: limit_memory. Deterministic for any number of threads. */
bool quality_measure(const quality_input *in, threads *pool, double *spacing_local, double *degree,
                     quality *out, error *e);

#endif

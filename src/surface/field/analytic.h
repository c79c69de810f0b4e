// SPDX-License-Identifier: Apache-2.0
/* analytic: surfaces given by formulas.
 *
 * F < 0 inside. Sphere, torus, box, frustum and half-space are signed distances near their surface. The
 * ellipsoid, the quartic of (15) and the gyroid are polynomial or trigonometric. Gradients and Hessians are
 * exact. The domain is the bounding box of the shape with a margin. Exceptions: quartic: the paper's unit
 * cube, scaled by r / 0.13; gyroid: its box, at whose faces the surface is open; half-space: the given box,
 * although the plane extends beyond it. World units. Immutable after construction, any thread.
 */
#ifndef HEXAD_SURFACE_FIELD_ANALYTIC_H
#define HEXAD_SURFACE_FIELD_ANALYTIC_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/field/cell_grid.h"
#include "surface/field/field.h"

typedef enum analytic_shape {
    ANALYTIC_SPHERE,
    ANALYTIC_TORUS,
    ANALYTIC_BOX,
    ANALYTIC_ELLIPSOID,
    ANALYTIC_QUARTIC,
    ANALYTIC_GYROID,
    ANALYTIC_FRUSTUM, /* cylinders, cones, capsules */
    ANALYTIC_HALFSPACE
} analytic_shape;

/* A frustum of a cone about the axis, between the coordinates `bottom` <= `top` along it, with the radii
 * there. A cylinder if the radii are equal; a segment if both are 0. */
typedef struct analytic_frustum {
    double bottom, top, bottom_radius, top_radius;
} analytic_frustum;

/* World units. Ranges as in the spec: its parser checks them, this module asserts them. */
typedef struct analytic_params {
    analytic_shape shape;
    vec3 center;
    double radius;                     /* sphere */
    vec3 axis;                         /* torus, frustum; half-space: outward normal; any length > 0 */
    double major_radius, minor_radius; /* torus */
    vec3 half_size;                    /* box */
    double rounding;                   /* box, frustum: the radius by which the core is grown */
    analytic_frustum core;             /* frustum; coordinates relative to the centre */
    vec3 radii;                        /* ellipsoid */
    double r;                          /* quartic */
    vec3 size;                         /* gyroid */
    double period;                     /* gyroid */
    bbox bounds;                       /* half-space: the domain; finite */
} analytic_params;

typedef struct analytic {
    field base; /* first: an analytic* is a field* */
    analytic_params params;
    cell_grid grid;
} analytic;

/* Errors: no_surface (no cell is crossed), and those of cell_grid_search. A half-space whose plane misses its
 * bounds has one cell, which is not crossed: its sides are still valid. */
analytic *analytic_new(const analytic_params *params, threads *pool, error *e);
void analytic_free(analytic *a);

/* Decomposes a shape with sharp edges into smooth shapes whose intersection it is: planes, and the lateral
 * surface of a frustum, extended beyond its ends. The result is the shape itself if it has no sharp edges.
 * Returns the number of shapes. */
enum { ANALYTIC_PIECES = 6 };
int analytic_pieces(const analytic_params *shape, analytic_params out[ANALYTIC_PIECES]);

/* A shape for sampling only, without cells. */
analytic *analytic_new_piece(const analytic_params *params);

/* Moves the faces of a frustum inwards by `by` >= 0, world units. False, with *f unchanged: nothing is
 * left. */
bool analytic_shrink(analytic_frustum *f, double by);

#endif

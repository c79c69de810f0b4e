/* analytic: surfaces given by formulas.
 *
 * F < 0 inside. Sphere, torus, box, frustum and half-space are signed distances near their surface; the
 * ellipsoid, the quartic of (15) and the gyroid are polynomial or trigonometric. Gradients and Hessians are
 * exact. The domain is the shape's bounding box with a margin (quartic: the paper's unit cube, scaled with
 * r / 0.13; gyroid: its box, at whose faces the surface is open; half-space: the box it is given, beyond
 * which its plane goes on).
 */
#ifndef HEXAD_FIELD_ANALYTIC_H
#define HEXAD_FIELD_ANALYTIC_H

#include "base/error.h"
#include "base/threads.h"
#include "field/cell_grid.h"
#include "field/field.h"

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

/* A cone that is cut off, about the axis: from `bottom` to `top` along it, of these radii there. A cylinder where
 * both are equal, a segment where both are 0. bottom <= top. */
typedef struct analytic_frustum {
    double bottom, top, bottom_radius, top_radius;
} analytic_frustum;

/* World units; ranges as in the spec (the parser checks them, this module asserts them). */
typedef struct analytic_params {
    analytic_shape shape;
    vec3 center;
    double radius;                     /* sphere */
    vec3 axis;                         /* torus, frustum; half-space: out of it; any length but zero */
    double major_radius, minor_radius; /* torus */
    vec3 half_size;                    /* box */
    double rounding;                   /* box; frustum: how far it is grown from its core */
    analytic_frustum core;             /* frustum; places along the axis from the centre on */
    vec3 radii;                        /* ellipsoid */
    double r;                          /* quartic */
    vec3 size;                         /* gyroid */
    double period;                     /* gyroid */
    bbox bounds;                       /* half-space: where it is asked for; finite */
} analytic_params;

typedef struct analytic {
    field base; /* first: an analytic* is a field* */
    analytic_params params;
    cell_grid grid;
} analytic;

/* A half-space whose plane misses its bounds has one cell, which is not crossed: its sides still count. Errors:
 * no_surface when no cell of another shape is crossed, and those of cell_grid_search. */
analytic *analytic_new(const analytic_params *params, threads *pool, error *e);
void analytic_free(analytic *a);

/* The smooth pieces of a shape with sharp edges, which is their intersection: planes, and the side of a frustum that goes on
 * beyond its ends. The shape itself where it has none. Returns how many. */
enum { ANALYTIC_PIECES = 6 };
int analytic_pieces(const analytic_params *shape, analytic_params out[ANALYTIC_PIECES]);

/* For who asks for F only: it has no cells. */
analytic *analytic_new_piece(const analytic_params *params);

/* Moves the faces of a frustum inwards by `by` >= 0; false, and no change, when nothing is left. */
bool analytic_shrink(analytic_frustum *f, double by);

#endif

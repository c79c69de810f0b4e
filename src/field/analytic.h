/* analytic: surfaces given by formulas.
 *
 * F < 0 inside. Sphere, torus and box are signed distances near their surface; the ellipsoid, the
 * quartic of (15) and the gyroid are polynomial or trigonometric. Gradients and Hessians are exact.
 * The domain is the shape's bounding box with a margin (quartic: the paper's unit cube, scaled with
 * r / 0.13; gyroid: its box, at whose faces the surface is open).
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
    ANALYTIC_GYROID
} analytic_shape;

/* World units; ranges as in the spec (the parser checks them, this module asserts them). */
typedef struct analytic_params {
    analytic_shape shape;
    vec3 center;
    double radius;                     /* sphere */
    vec3 axis;                         /* torus; any length but zero */
    double major_radius, minor_radius; /* torus */
    vec3 half_size;                    /* box */
    double rounding;                   /* box */
    vec3 radii;                        /* ellipsoid */
    double r;                          /* quartic */
    vec3 size;                         /* gyroid */
    double period;                     /* gyroid */
} analytic_params;

typedef struct analytic {
    field base; /* first: an analytic* is a field* */
    analytic_params params;
    cell_grid grid;
} analytic;

/* Errors: no_surface when no cell is crossed, limit_memory, cancelled (through
 * the pool, which may be NULL). */
analytic *analytic_new(const analytic_params *params, threads *pool, error *e);
void analytic_free(analytic *a);

#endif

// SPDX-License-Identifier: Apache-2.0
/* surface: properties of a surface computed from its crossing cells: area, bounding box, and points drawn in
 * proportion to area.
 *
 * Each cell is cut into six tetrahedra, and the surface cuts these into triangles, whose corners are moved
 * onto the surface. The area of a triangle is corrected for the curvature of the surface by the change of the
 * normal between its corners. The remaining error is of fourth order in cell size over radius of curvature.
 */
#ifndef HEXAD_SURFACE_SCAN_SURFACE_H
#define HEXAD_SURFACE_SCAN_SURFACE_H

#include "base/core/error.h"
#include "base/core/rng.h"
#include "base/core/threads.h"
#include "surface/field/field.h"
#include "surface/scan/components.h"

typedef struct surface {
    const field *field; /* not owned */
    double area;        /* world units squared */
    bbox box;           /* of the surface */
    size_t cells;
    /* cells are numbered part after part, so that strata of equal area lie within parts */
    components parts;
    /* cells + 1 values: the area of the cells before each cell; the last value is the whole area */
    double *area_before;
    /* Of each part: its Euler characteristic, by the signs of F at the corners of cells. NAN: no cell has corners of both
     * signs, or cells consist of triangles */
    double *euler;
} surface;

/* The k-th of the surface's cells. k is an index in the order of `parts`. */
void surface_cell(const surface *s, size_t k, field_cell *out);

/* Returns the centre of the k-th cell. *radius: an upper bound of the distance of its corners from the
 * centre. */
vec3 surface_cell_middle(const surface *s, size_t k, double *radius);

/* As cell_group of field_ops. Also false if cells are numbered part after part. */
bool surface_cell_group(const surface *s, size_t k, size_t *end, vec3 *middle, double *radius);

/* The patch of a place x of the k-th cell; 0 without patches. */
uint32_t surface_cell_patch(const surface *s, size_t k, vec3 x);

static inline double surface_cell_area(const surface *s, size_t k)
{
    return s->area_before[k + 1] - s->area_before[k];
}

/* Returns the share of a part (of a surface with patches: of a patch) in the whole. `before`: cells + 1
 * cumulative values, of area (area_before) or of area weighted by a sizing field. */
static inline double surface_part_share(const surface *s, const double *before, size_t part)
{
    return (before[s->parts.begin[part + 1]] - before[s->parts.begin[part]]) / before[s->cells];
}

/* Errors: no_surface (area 0), limit_memory, cancelled (the pool was stopped). Deterministic for any number
 * of threads. */
surface *surface_scan(const field *f, threads *pool, error *e);
void surface_free(surface *s);

/* A cache with the triangles of the last cell from which a point was drawn. If points are drawn in the order
 * of cells, each cell is cut once. Zero it before the first call; use it for one surface only. */
typedef struct surface_last_cell {
    bool known;
    size_t cell;
    int count;
    vec3 at[FIELD_CELL_TRIANGLES][3];
    double area[FIELD_CELL_TRIANGLES]; /* area of the part of each triangle inside the domain */
} surface_last_cell;

/* Returns a point of the triangles of the cell k with before[k] <= where < before[k + 1], uniformly
 * distributed over their area. With area_before, equal lengths of `where` give equal areas. The point is near
 * the surface, within the cell; the caller projects it. `last`: a cache, or NULL; it does not change the
 * result. */
vec3 surface_point(const surface *s, const double *before, double where, rng *r, surface_last_cell *last);

/* Draws a point of one patch, `where` in [0, 1); without patches, of the whole surface. False if the patch
 * has no share, or if the point lies on another patch of its cell; then *out is unchanged, but `r` may
 * have advanced. *hint: a hint for the field of the patch at the point, or FIELD_NO_HINT. */
bool surface_patch_point(const surface *s, const double *before, uint32_t patch, double where, rng *r,
                         vec3 *out, uint32_t *hint);

/* Moves *x onto the surface by Newton's method along the axes that are not in `fixed` (bit k: axis k).
 * Ignores the domain. False if the method does not converge within `reach`; the outputs are unchanged. */
bool surface_slide(const field *f, unsigned fixed, double reach, vec3 *x, vec3 *normal);

/* Returns the point where the surface passes between x, in the k-th cell, and the nearest corner of the cell
 * on the other side, found by bisection. For places where Newton's method fails, as beside a droplet. Returns
 * x if all corners are on its side, or if F is undefined. */
vec3 surface_bisect(const surface *s, size_t k, vec3 x);

/* Computes the triangles of a cell. Their corners lie on the surface to a millionth of the cell. Triangles of
 * adjacent cells have the same corners, to the last bit, on their common face. Parts outside of the domain
 * are not cut off. Returns the number of triangles. */
int surface_cell_triangles(const surface *s, size_t cell, vec3 out[FIELD_CELL_TRIANGLES][3]);

/* surface_cell_triangles for F that is linear between the corners of the cell: the triangles are near the
 * surface, and are computed faster. */
int surface_cell_rough_triangles(const surface *s, size_t cell, vec3 out[FIELD_CELL_TRIANGLES][3]);

#endif

/* surface: quantities of a surface that follow from the crossing cells, before there are particles:
 * its area, its box, and initial points, drawn in proportion to area.
 *
 * Each cell is cut into six tetrahedra and these by the surface into triangles, whose corners are
 * moved onto the surface. A triangle's area is corrected for the surface's curvature by how the normals at
 * its corners turn, which leaves an error of fourth order in cell size over radius of curvature.
 */
#ifndef HEXAD_SURFACE_SURFACE_H
#define HEXAD_SURFACE_SURFACE_H

#include "base/error.h"
#include "base/rng.h"
#include "base/threads.h"
#include "field/field.h"
#include "surface/components.h"

typedef struct surface {
    const field *field; /* not owned */
    double area;        /* world units squared */
    bbox box;           /* of the surface */
    size_t cells;
    components parts;    /* cells are numbered part after part, so that strata of area keep to the parts */
    double *area_before; /* cells + 1: area of the cells before each, the last is the whole */
} surface;

/* The k-th of the surface's cells. */
void surface_cell(const surface *s, size_t k, field_cell *out);

/* Its middle, and a bound of how far its corners are from that. */
vec3 surface_cell_middle(const surface *s, size_t k, double *radius);

/* As field_ops's cell_group; false as well where cells are numbered part after part. */
bool surface_cell_group(const surface *s, size_t k, size_t *end, vec3 *middle, double *radius);

/* The patch of a place of the k-th cell; 0 without patches. */
uint32_t surface_cell_patch(const surface *s, size_t k, vec3 x);

static inline double surface_cell_area(const surface *s, size_t k)
{
    return s->area_before[k + 1] - s->area_before[k];
}

/* Share of a part (with patches: of a patch) in the whole. `before`: per cell and one more the sum of the cells before
 * it, of area (area_before) or of area weighted by a sizing field. */
static inline double surface_part_share(const surface *s, const double *before, size_t part)
{
    return (before[s->parts.begin[part + 1]] - before[s->parts.begin[part]]) / before[s->cells];
}

/* Errors: no_surface (area 0), limit_memory, cancelled (the pool was stopped). Deterministic for any
 * number of threads. */
surface *surface_scan(const field *f, threads *pool, error *e);
void surface_free(surface *s);

/* The triangles of the cell that was drawn from last: draws in the order of cells cut each once. Zeroed before the first;
 * for draws from one surface. */
typedef struct surface_last_cell {
    bool known;
    size_t cell;
    int count;
    vec3 at[FIELD_CELL_TRIANGLES][3];
    double area[FIELD_CELL_TRIANGLES]; /* of what lies in the domain */
} surface_last_cell;

/* A point of the surface's triangles: of the cell k with before[k] <= where < before[k + 1], in proportion to
 * area within it. With area_before equal lengths of `where` give equal areas. The point lies near the
 * surface, within the cell; project it. The same point with `last` and without it, NULL. */
vec3 surface_point(const surface *s, const double *before, double where, rng *r, surface_last_cell *last);

/* The same of the patch alone, `where` in [0, 1); without patches, of the surface. False, nothing drawn but `r` moved on, where
 * the patch has no share or the point fell on another patch of its cell. */
bool surface_patch_point(const surface *s, const double *before, uint32_t patch, double where, rng *r,
                         vec3 *out);

/* Onto the surface by Newton's method along the axes that are not fixed (bit k), without regard to the
 * domain. False, outputs untouched, when that does not end within `reach`. */
bool surface_slide(const field *f, unsigned fixed, double reach, vec3 *x, vec3 *normal);

/* The place where the surface passes between x, in the k-th cell, and the nearest of the cell's corners on the other
 * side, by bisection. For places from which Newton's method leads nowhere, as beside a droplet. x where all corners are
 * on its side, or F is not defined. */
vec3 surface_bisect(const surface *s, size_t k, vec3 x);

/* The triangles of a cell, corners on the surface to a millionth of it; those of neighbouring cells have the
 * same corners, bit by bit, where they meet. What lies outside of the domain is not cut off. Returns how
 * many. */
int surface_cell_triangles(const surface *s, size_t cell, vec3 out[FIELD_CELL_TRIANGLES][3]);

/* The same with F linear between the cell's corners: near the surface, and much sooner. */
int surface_cell_rough_triangles(const surface *s, size_t cell, vec3 out[FIELD_CELL_TRIANGLES][3]);

#endif

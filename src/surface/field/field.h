// SPDX-License-Identifier: Apache-2.0
/* field: the interface of all surfaces: a scalar field F of three-space whose zero set is the surface.
 *
 * Convention: F < 0 inside the solid. The outward normal is +grad F / |grad F| for every source. A source in
 * which the inside is above the isovalue negates its values. Positions, gradients and second derivatives are
 * in world space and world units. F may have any unit: only its zero set and ratios of its derivatives are
 * used.
 *
 * A field is immutable after construction: any number of threads may sample it at once. It is an interface:
 * an implementation has `field` as its first member and sets `ops`. The creator of the implementation owns it
 * and releases it.
 */
#ifndef HEXAD_SURFACE_FIELD_FIELD_H
#define HEXAD_SURFACE_FIELD_FIELD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "geometry/space/bbox.h"
#include "geometry/space/sym3.h"
#include "geometry/space/vec3.h"

typedef struct field field;
struct field_patches; /* surface/field/patches.h */

/* The derivatives that a sample contains. */
typedef enum field_order { FIELD_GRADIENT = 1, FIELD_HESSIAN = 2 } field_order;

typedef struct field_sample {
    double value;  /* F */
    vec3 gradient; /* grad F, per world unit */
    sym3 hessian;  /* second derivatives; unchanged with FIELD_GRADIENT */
} field_sample;

/* The largest second difference of F over the edges of a cell, divided by its slope along the longest edge.
 * FLAT: at most FIELD_FLAT_MOST. GENTLE: at most FIELD_GENTLE_MOST. BENT: larger, or unknown. */
typedef enum field_bend { FIELD_BENT, FIELD_GENTLE, FIELD_FLAT } field_bend;

/* Relative errors of the area of a sphere. With F linear in each cell: 2.6e-5 at a radius of 1 /
 * FIELD_FLAT_MOST cells, a quarter of it at twice the radius. With flat_cell_shortage: 6e-6 at a radius of
 * 1 / FIELD_GENTLE_MOST cells, 3e-5 at half that radius. */
#define FIELD_FLAT_MOST 0.01
#define FIELD_GENTLE_MOST 0.125

enum {
    FIELD_CELL_CORNERS = 8,
    FIELD_CELL_TRIANGLES = 12 /* maximum per cell: two in each of six tetrahedra */
};

/* A grid cell that the surface may cross: a parallelepiped (an affine image of a box). Bits 0, 1 and 2 of k
 * are the position of corner k along the first, second and third axis. */
typedef struct field_cell {
    vec3 corner[FIELD_CELL_CORNERS];
    double value[FIELD_CELL_CORNERS]; /* F at the corners */
    bool hidden_crossing;             /* the surface crosses a face whose corners have one sign */
    field_bend bend;
} field_cell;

typedef struct field_ops {
    /* F and its derivatives at x. False (*out is unchanged) if the field is not defined at x: outside the
     * band of a volume, or at a point without a derivative. */
    bool (*sample)(const field *f, vec3 x, field_order order, field_sample *out);

    /* The number of grid cells that the surface crosses: every cell with corners of both signs (zero counts
     * as outside) and, if `sharp`, cells that a sharp edge of the surface enters between the corners. The
     * order is fixed. The cells resolve the features of the surface: they are voxels for volumes, and a fixed
     * fraction of the shape for formulas. */
    size_t (*cell_count)(const field *f);
    void (*cell)(const field *f, size_t k, field_cell *out);

    /* The centre of cell k. *radius: maximum distance of its corners from the centre. NULL: `cell` is as
     * fast. */
    vec3 (*cell_middle)(const field *f, size_t k, double *radius);

    /* The group of cell k: consecutive cells within a ball, such as those of a block. *middle, *radius: the
     * ball that contains all corners of the group. *end: the last cell of the group plus 1. False: the cell
     * has no group. NULL: no cell has. */
    bool (*cell_group)(const field *f, size_t k, size_t *end, vec3 *middle, double *radius);

    /* The side of the surface on which x lies, for any x: negative inside the solid, positive outside; the
     * magnitude has no meaning. 0 near the surface, where `sample` is defined. Places beyond the end of
     * the data are outside. */
    double (*side)(const field *f, vec3 x);

    /* F and its gradient at VEC3_LANES places. The error of F may be 1e-7 of its largest values nearby
     * (single precision). Lanes with `defined` false are ignored; `defined` becomes false in lanes where the
     * field is not defined. The results of a lane do not depend on other lanes, to the last bit. Arrays do
     * not overlap. NULL: `sample` is as fast. */
    void (*sample_lanes)(const field *f, const vec3_lanes *x, bool defined[VEC3_LANES],
                         double value[VEC3_LANES], vec3_lanes *gradient);

    /* `sample` of the fields of patches, one patch for each lane. Lanes with `defined` false are ignored.
     * The hint of a lane is a value that this function returned for a nearby place of the same patch, or
     * FIELD_NO_HINT. Where two walls of a patch are close to each other, the result may be that of the wall
     * of the hint. NULL: `sample` is as fast. */
    void (*sample_patch_lanes)(const field *f, const uint32_t patch[VEC3_LANES], const vec3_lanes *x,
                               bool defined[VEC3_LANES], uint32_t hint[VEC3_LANES], double value[VEC3_LANES],
                               vec3_lanes *gradient);

    /* As `sample`, with a hint: a value that this function, `within` or `sample_patch_lanes` returned for a
     * nearby place, or FIELD_NO_HINT. Where two walls of a patch are close to each other, the result may be
     * that of the wall of the hint, although the other wall is closer. NULL: `sample` is as fast. */
    bool (*sample_near)(const field *f, vec3 x, field_order order, uint32_t *hint, field_sample *out);

    /* The first crossing of the ray from x, a place of the surface, in the direction of the unit vector `along`, at a
     * distance below `within`: *distance, and the surface's unit normal there. `hint`: of x, as `sample_near` returned
     * it. False, outputs unchanged: there is none. NULL: crossings follow from samples along the ray. */
    bool (*first_crossing)(const field *f, vec3 x, vec3 along, double within, uint32_t hint, double *distance,
                           vec3 *normal);

    /* The triangles of cell k, with corners on the surface. Returns their number. Triangles of adjacent cells
     * share whole sides or do not overlap. For such a field `cell` returns a bounding box of the triangles,
     * with values that have no meaning. Required if there are patches. NULL: the surface in a cell follows
     * from the signs of F at its corners. */
    int (*cell_triangles)(const field *f, size_t k, vec3 out[FIELD_CELL_TRIANGLES][3]);

    /* The hint for `sample_near` of the patch on which cell k lies, at places of the cell. NULL: there is
     * none. */
    uint32_t (*cell_hint)(const field *f, size_t k);

    /* For the field of a patch that ends in curves: whether the place of its zero set closest to x lies
     * between the curves, not in the continuation beyond them. NULL: always. The hint is one that
     * `sample_near` or `sample_patch_lanes` returned for this place, or FIELD_NO_HINT. */
    bool (*within)(const field *f, vec3 x, uint32_t *hint);

    /* The patch of a place on or near the surface in cell k. Required if there are patches. */
    uint32_t (*patch_at)(const field *f, size_t k, vec3 x);

    /* Frees caches of sampled places. Loops over all cells call it periodically, when no thread uses the
     * field. Results do not depend on it. NULL: there are no caches. */
    void (*forget)(const field *f);
} field_ops;

struct field {
    const field_ops *ops;
    bbox domain; /* world box that contains the surface */
    /* If `open`: the surface ends at the faces of this box, which are faces of the domain. Infinite in
     * directions in which the surface does not end. */
    bbox boundary_box;
    /* L of the curvature scale: longest side of the bounding box of the surface (volumes) or of the domain
     * (formulas) */
    double extent;
    double cell_size; /* longest edge of a cell, world units; of the smallest cells if `uneven` */
    /* Cells have several sizes, each twice the previous one. Adjacent cells have the same size or consecutive
     * sizes. */
    bool uneven;
    bool joined; /* the cells are known to be connected by shared faces */
    bool open;   /* the surface is cut by faces of the domain and has boundaries there */
    bool sharp;  /* F approximates a distance near the surface, and has kinks where smooth parts meet */
    /* Extent of the solid beyond the low and high faces of the domain, where there is no surface, world
     * units: to the end of the data, or INFINITY. 0: it does not extend beyond. */
    vec3 solid_below, solid_above;
    /* NULL: the surface is one smooth patch, or is treated as one. Otherwise the surface consists of these
     * patches, `sample` returns the field of the closest one, and `open` is false: boundaries are curves. */
    const struct field_patches *patches;
};

#define FIELD_NO_HINT UINT32_MAX

enum { FIELD_ALL_FACES = 63 };

/* Sets the faces of the domain that cut the surface: bit 2 k is the low face of axis k, bit 2 k + 1 the
 * high face. */
static inline void field_set_boundary(field *f, unsigned faces)
{
    f->boundary_box = (bbox){{-INFINITY, -INFINITY, -INFINITY}, {INFINITY, INFINITY, INFINITY}};
    f->open = faces != 0;
    for (int axis = 0; axis < 3; axis++) {
        if (faces >> 2 * axis & 1) vec3_set(&f->boundary_box.min, axis, vec3_get(f->domain.min, axis));
        if (faces >> 2 * axis & 2) vec3_set(&f->boundary_box.max, axis, vec3_get(f->domain.max, axis));
    }
}

/* A box that contains the solid, as far as it is known. */
static inline bbox field_solid_box(const field *f)
{
    return (bbox){vec3_sub(f->domain.min, f->solid_below), vec3_add(f->domain.max, f->solid_above)};
}

/* Sets the result of field_solid_box. The domain is set before. */
static inline void field_set_solid_box(field *f, bbox box)
{
    for (int axis = 0; axis < 3; axis++) {
        vec3_set(&f->solid_below, axis, fmax(vec3_get(f->domain.min, axis) - vec3_get(box.min, axis), 0));
        vec3_set(&f->solid_above, axis, fmax(vec3_get(box.max, axis) - vec3_get(f->domain.max, axis), 0));
    }
}

static inline vec3 field_cell_middle(const field_cell *cell)
{
    return vec3_scale(vec3_add(cell->corner[0], cell->corner[7]), 0.5);
}

/* The longest edge. */
static inline double field_cell_edge(const field_cell *cell)
{
    double longest = 0;
    for (int axis = 0; axis < 3; axis++)
        longest = fmax(longest, vec3_norm(vec3_sub(cell->corner[1 << axis], cell->corner[0])));
    return longest;
}

/* The size of a cell of the field, world units. */
static inline double field_cell_size(const field *f, const field_cell *cell)
{
    return f->uneven ? field_cell_edge(cell) : f->cell_size;
}

/* The faces of a cell that the surface crosses, from the signs at the corners: bits as in
 * field_set_boundary. */
static inline unsigned field_cell_passed_faces(const field_cell *cell)
{
    static const unsigned corners[6] = {0x55, 0xaa, 0x33, 0xcc, 0x0f, 0xf0};
    unsigned faces = 0, inside = 0;
    for (int c = 0; c < 8; c++) inside |= (unsigned)(cell->value[c] < 0) << c;
    for (int face = 0; face < 6; face++) {
        const unsigned on = inside & corners[face];
        faces |= (unsigned)(cell->hidden_crossing || (on != 0 && on != corners[face])) << face;
    }
    return faces;
}

static inline vec3 field_triangle_middle(const vec3 corner[3])
{
    return vec3_scale(vec3_add(corner[0], vec3_add(corner[1], corner[2])), 1.0 / 3);
}

static inline bool field_sample_at(const field *f, vec3 x, field_order order, field_sample *out)
{
    return f->ops->sample(f, x, order, out);
}

/* See `sample_near` in field_ops; for any field. */
static inline bool field_sample_near(const field *f, vec3 x, field_order order, uint32_t *hint,
                                     field_sample *out)
{
    return f->ops->sample_near ? f->ops->sample_near(f, x, order, hint, out)
                               : f->ops->sample(f, x, order, out);
}

/* See `sample_lanes` in field_ops; for any field. */
void field_sample_lanes(const field *f, const vec3_lanes *x, bool defined[VEC3_LANES],
                        double value[VEC3_LANES], vec3_lanes *gradient);

/* Principal curvatures of the level set through a sample taken with FIELD_HESSIAN, 1 / world unit: the
 * eigenvalues in the tangent plane of P H P / |grad F|, P = I - n n'. *kappa1 >= *kappa2, positive where the
 * solid is convex (sphere of radius R: both 1/R). Returns the Frobenius norm sqrt(kappa1^2 + kappa2^2). All
 * are 0 where the gradient vanishes. Source: Kindlmann et al. 2003, "Curvature-Based Transfer Functions",
 * section 3. */
double field_curvature(const field_sample *s, double *kappa1, double *kappa2);

/* Unit vector along the principal direction of the larger or the smaller curvature. Its sign is arbitrary:
 * the first component that is not nearly zero is positive. */
vec3 field_principal_direction(const field_sample *s, bool larger);

#endif

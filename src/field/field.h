/* field: a scalar field F of three-space whose zero set is the surface.
 *
 * Convention: F < 0 inside the solid, so the normal, out of the solid, is +grad F / |grad F|
 * whatever the source; who builds a field from "inside is above the isovalue" negates it. All
 * positions, gradients and second derivatives are in world space and world units; F may have any
 * unit, since only its zero set and ratios of its derivatives are used.
 *
 * A field is immutable once built: any number of threads may sample it at once. It is an interface:
 * an implementation puts `field` first in its own struct and fills in `ops`; who makes the
 * implementation owns it and releases it.
 */
#ifndef HEXAD_FIELD_FIELD_H
#define HEXAD_FIELD_FIELD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "geometry/bbox.h"
#include "geometry/sym3.h"
#include "geometry/vec3.h"

typedef struct field field;
struct field_patches; /* field/patches.h */

/* How much of a sample is wanted. */
typedef enum field_order { FIELD_GRADIENT = 1, FIELD_HESSIAN = 2 } field_order;

typedef struct field_sample {
    double value;  /* F */
    vec3 gradient; /* grad F, per world unit */
    sym3 hessian;  /* second derivatives; untouched with FIELD_GRADIENT */
} field_sample;

/* How large the second differences of F over a cell's edges are beside its slope along the longest: at most FIELD_FLAT_MOST, at most
 * FIELD_GENTLE_MOST; FIELD_BENT: larger, or it is not known. */
typedef enum field_bend { FIELD_BENT, FIELD_GENTLE, FIELD_FLAT } field_bend;

/* A ball of 1 / FIELD_FLAT_MOST cells, with F linear in each, has 2.6e-5 of its area too little; one of twice as many a fourth of
 * that. With flat_cell_shortage one of 1 / FIELD_GENTLE_MOST cells is right to 6e-6, of half as many to 3e-5. */
#define FIELD_FLAT_MOST 0.01
#define FIELD_GENTLE_MOST 0.125

/* A hexahedral cell that the surface may cross: corner k has bit 0 of k along the first axis, bit 1
 * along the second, bit 2 along the third. The cell is a parallelepiped (an affine image of a box).*/
typedef struct field_cell {
    vec3 corner[8];
    double value[8]; /* F at the corners */
    bool grazed;     /* the surface is known to pass a face whose corners are on one side */
    field_bend bend;
} field_cell;

enum { FIELD_CELL_TRIANGLES = 12 }; /* the most in a cell: two in each of six tetrahedra */

typedef struct field_ops {
    /* F and its derivatives at x. False (out untouched) where the field is not defined: outside the
     * band of a volume, or at a point where it has no derivative. */
    bool (*sample)(const field *f, vec3 x, field_order order, field_sample *out);

    /* The cells that the surface crosses: every cell with corners of both signs (zero counts as
     * outside) and, where F is sharp, those that an edge of the surface enters between their corners.
     * Their order is fixed. They are small enough to see the surface's features: a voxel for volumes, a
     * fixed fraction of the shape for formulas. */
    size_t (*cell_count)(const field *f);
    void (*cell)(const field *f, size_t k, field_cell *out);

    /* The middle of cell k, whose corners are no farther from it than *radius. NULL: nothing is faster than `cell`. */
    vec3 (*cell_middle)(const field *f, size_t k, double *radius);

    /* Of cells that follow each other and lie together, as those of a block: the middle of cell k's, no corner of which is farther from it
     * than *radius, and in *end the number behind the last of them. False where it is in none. NULL: no cell is in one. */
    bool (*cell_group)(const field *f, size_t k, size_t *end, vec3 *middle, double *radius);

    /* On which side of the surface x lies, wherever that is: negative inside the solid, positive outside; the
     * size says nothing. 0 near the surface, where `sample` tells. What lies beyond the end of data is
     * outside. */
    double (*side)(const field *f, vec3 x);

    /* F and its gradient at VEC3_LANES places, for steps to which single precision is enough: F may be off by some 1e-7
     * of its largest values nearby. Only lanes that are `defined` before count; where the field is not, the lane's
     * entry becomes false. The same to the last bit whatever the other lanes hold. Arrays do not overlap. NULL: nothing is
     * faster than `sample`. */
    void (*sample_lanes)(const field *f, const vec3_lanes *x, bool defined[VEC3_LANES],
                         double value[VEC3_LANES], vec3_lanes *gradient);

    /* `sample` of patches' own fields, a patch for each lane; only lanes that are `defined` count. Faster where a lane's hint is
     * what this call left there for a place of the patch nearby. One for another sheet of the patch may tell of that, where x
     * is near to both. NULL: nothing is faster than `sample`. */
    void (*sample_patch_lanes)(const field *f, const uint32_t patch[VEC3_LANES], const vec3_lanes *x,
                               bool defined[VEC3_LANES], uint32_t hint[VEC3_LANES], double value[VEC3_LANES],
                               vec3_lanes *gradient);

    /* `sample`, faster where *hint is what this call, `within` or `sample_patch_lanes` left there for a place nearby; FIELD_NO_HINT:
     * there is none. Of a patch whose sheets are near each other it may tell of the hint's sheet, though another one is nearer. NULL:
     * nothing is faster than `sample`. */
    bool (*sample_near)(const field *f, vec3 x, field_order order, uint32_t *hint, field_sample *out);

    /* The triangles of which cell k consists, corners on the surface; returns how many. Triangles of cells that touch meet
     * in whole sides or do not overlap. Of such a field `cell` gives a box round them; its values say nothing. Needed where
     * there are patches. NULL: the cell is cut by where F changes sign. */
    int (*cell_triangles)(const field *f, size_t k, vec3 out[FIELD_CELL_TRIANGLES][3]);

    /* Of the field of a patch that ends in curves: whether the place of its zero set at or next to x lies between the curves,
     * and not where the patch only goes on beyond them. NULL: it always does. The hint is what `sample_near` or
     * `sample_patch_lanes` left there for this place, or none. */
    bool (*within)(const field *f, vec3 x, uint32_t *hint);

    /* To which patch a place on or near the surface in cell k belongs. Needed where there are patches. */
    uint32_t (*patch_at)(const field *f, size_t k, vec3 x);

    /* Who goes through all cells in their order says so from time to time, when no thread looks at the field: what it
     * keeps of places that were looked at may go. What it tells does not hang on it. NULL: it keeps nothing. */
    void (*forget)(const field *f);
} field_ops;

struct field {
    const field_ops *ops;
    bbox domain;       /* world box that holds the surface */
    bbox boundary_box; /* where `open`: the surface ends at the faces of this box, which are faces of the
                       * domain; infinite on the sides where it does not */
    double extent;     /* L of the curvature scale: longest side of the surface's box (volumes) or of
                       * the domain (formulas) */
    double cell_size;  /* longest edge of a cell, world units; of the smallest cells where they are uneven */
    bool
        uneven; /* cells are of several sizes, each twice the one before; those that touch of one or two of them */
    bool joined; /* the cells are known to hang together, by faces that they share */
    bool open;   /* the surface is cut by faces of the domain and has boundaries there */
    bool sharp;  /* F is about a distance near the surface, and has kinks where smooth parts meet */
    /* How far the solid goes on beyond the low and high faces of the domain, where no surface is: to the end of the data, or
     * INFINITY. 0 where it does not. */
    vec3 solid_below, solid_above;
    /* NULL: the surface is one smooth piece, or taken for one. Else it consists of these, `sample` gives the one nearest to
     * x, and `open` is false: where the surface ends there are curves. */
    const struct field_patches *patches;
};

#define FIELD_NO_HINT UINT32_MAX

enum { FIELD_ALL_FACES = 63 };

/* Says which faces of its domain cut the surface: bit 2 k the low one of axis k, bit 2 k + 1 the high one. */
static inline void field_set_boundary(field *f, unsigned faces)
{
    f->boundary_box = (bbox){{-INFINITY, -INFINITY, -INFINITY}, {INFINITY, INFINITY, INFINITY}};
    f->open = faces != 0;
    for (int axis = 0; axis < 3; axis++) {
        if (faces >> 2 * axis & 1) vec3_set(&f->boundary_box.min, axis, vec3_get(f->domain.min, axis));
        if (faces >> 2 * axis & 2) vec3_set(&f->boundary_box.max, axis, vec3_get(f->domain.max, axis));
    }
}

/* The box that holds the solid, as far as it is known. */
static inline bbox field_solid_box(const field *f)
{
    return (bbox){vec3_sub(f->domain.min, f->solid_below), vec3_add(f->domain.max, f->solid_above)};
}

/* Says what that box is, once the domain is set. */
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

/* The field's cell size, at a cell of it. */
static inline double field_cell_size(const field *f, const field_cell *cell)
{
    return f->uneven ? field_cell_edge(cell) : f->cell_size;
}

/* The faces that the surface passes, as far as corners tell: bit 2 k the low one of axis k, bit 2 k + 1 the high one. */
static inline unsigned field_cell_passed_faces(const field_cell *cell)
{
    static const unsigned corners[6] = {0x55, 0xaa, 0x33, 0xcc, 0x0f, 0xf0};
    unsigned faces = 0, inside = 0;
    for (int c = 0; c < 8; c++) inside |= (unsigned)(cell->value[c] < 0) << c;
    for (int face = 0; face < 6; face++) {
        const unsigned on = inside & corners[face];
        faces |= (unsigned)(cell->grazed || (on != 0 && on != corners[face])) << face;
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

/* As in field_ops, of any field. */
static inline bool field_sample_near(const field *f, vec3 x, field_order order, uint32_t *hint,
                                     field_sample *out)
{
    return f->ops->sample_near ? f->ops->sample_near(f, x, order, hint, out)
                               : f->ops->sample(f, x, order, out);
}

/* As in field_ops, of any field. */
void field_sample_lanes(const field *f, const vec3_lanes *x, bool defined[VEC3_LANES],
                        double value[VEC3_LANES], vec3_lanes *gradient);

/* Principal curvatures of the level set through a sample taken with FIELD_HESSIAN:
 * the eigenvalues in the tangent plane of P H P / |grad F|, P = I - n n'.
 * *kappa1 >= *kappa2, positive where the solid is convex (sphere of radius R: both 1/R); the
 * returned kappa is the Frobenius norm sqrt(kappa1^2 + kappa2^2). 0 where the gradient vanishes.
 * Source: Kindlmann et al. 2003, "Curvature-Based Transfer Functions", section 3. */
double field_curvature(const field_sample *s, double *kappa1, double *kappa2);

#endif

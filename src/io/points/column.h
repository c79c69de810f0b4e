// SPDX-License-Identifier: Apache-2.0
/* column: a point set as named columns of numbers, for PLY and other row formats.
 *
 * Columns are chosen by name, or by the name of an application, which stands for the columns that it reads.
 * An attribute `v` of three components has the columns v_x, v_y and v_z (a color _r _g _b _a, texture
 * coordinates _s _t). The points also have:
 *     red green blue   the color, 0 to 255
 *     s t              the first texture coordinates
 *     radius pscale    half the achieved spacing
 *     quality          kappa
 */
#ifndef HEXAD_IO_POINTS_COLUMN_H
#define HEXAD_IO_POINTS_COLUMN_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"
#include "io/points/points.h"
#include "io/points/property.h"

enum { COLUMN_NAME_SIZE = 80, COLUMNS_MAX = 160 };

typedef enum column_type {
    COLUMN_REAL,
    COLUMN_UINT,
    COLUMN_INT,
    COLUMN_UCHAR,
    COLUMN_DOUBLE,    /* whole numbers of more than 32 bits, whatever the precision of reals */
    COLUMN_LONG_REAL, /* real numbers that are doubles, whatever the precision of the others */
    COLUMN_TYPES
} column_type;

typedef struct column {
    char name[COLUMN_NAME_SIZE];
    column_type type;
    const double *values; /* one per `stride` elements, times `scale`; NULL: see `whole` */
    size_t stride;
    double scale;
    /* values of an integer column; NULL, with `values` NULL: the indices of the points, from 0 */
    const uint32_t *whole;
} column;

typedef struct columns {
    size_t count;
    column list[COLUMNS_MAX];
} columns;

/* Chooses the columns with these names, in this order, and for a set with ids those that the next frame of a
 * sequence reads. "all": all properties of the points, color and texture coordinates if attributes have them,
 * and all attributes. "default": of these the position, normal, achieved spacing, color, texture coordinates,
 * orientation, id and velocity, the requested spacing if set->is_graded, and the attributes except that of
 * set->kappa_defined. `names` NULL: "default". x, y and z always come first. Errors: attribute_missing (the
 * set lacks a name). */
bool columns_choose(const points *set, const char *const *names, size_t name_count, columns *out, error *e);

/* Whether one of the names is a column of the color. */
bool columns_need_color(const char *const *names, size_t name_count);

/* Whether one of the names may be a column of the curvature, of `kappa_defined`, or of colors that show it. */
bool columns_have_curvature(const char *const *names, size_t name_count);

/* Whether one of the names is "all". */
bool columns_have_all(const char *const *names, size_t name_count);

/* False if the name is a property of the points with a different type. */
bool columns_suits(const char *name, column_type type);

/* Whether the name is reserved: the points have a property of that name in one of the formats. */
bool columns_is_own(const char *name);

/* Whether the name is reserved if the points have orientations: orient or one of its columns. */
bool columns_is_of_orient(const char *name);

/* Allocates the arrays of a set of set->count points that the columns fill, zeroed, and sets the pointers in
 * both. A column has values of its own if it belongs to no array of the set, as those of attributes, and none
 * if other columns of its array are missing. The caller frees `storage`. False: out of memory. */
bool columns_lay_out(columns *list, points *set, void **storage, error *e);

/* Sets row i of a column that was laid out. */
void column_store(const column *c, size_t i, double value);

/* Whether a column is one of a property's components. Both are of the same set. */
bool columns_have_property(const columns *list, const property *p);

/* The number in row i. For integer types it is whole and within the range of the type. */
double column_value(const column *c, size_t i);

/* The type for whole numbers from `least` to `most`: the first of COLUMN_INT, COLUMN_UINT and COLUMN_DOUBLE
 * that can hold them. */
column_type column_type_of_range(double least, double most);

#endif

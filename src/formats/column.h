/* column: a point set as named columns of numbers, as PLY and other formats of rows write it.
 *
 * Columns are chosen by name, or by the name of an application, which stands for the columns that it reads. An
 * attribute `v` of three components is the columns v_x, v_y and v_z (a color _r _g _b _a, texture coordinates _s _t).
 * Beside their own names the points have:
 *   red green blue   the color, 0 to 255             s t           the first texture coordinates
 *   radius pscale    half the achieved spacing       quality       kappa
 */
#ifndef HEXAD_FORMATS_COLUMN_H
#define HEXAD_FORMATS_COLUMN_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"
#include "formats/points.h"

enum { COLUMN_NAME_SIZE = 80, COLUMNS_MAX = 160 };

typedef enum column_type {
    COLUMN_REAL,
    COLUMN_UINT,
    COLUMN_INT,
    COLUMN_UCHAR,
    COLUMN_DOUBLE, /* whole numbers beyond 32 bits, whatever the precision of real ones */
    COLUMN_TYPES
} column_type;

typedef struct column {
    char name[COLUMN_NAME_SIZE];
    column_type type;
    const double *values; /* one every `stride`, times `scale`; NULL: see `whole` */
    size_t stride;
    double scale;
    const uint32_t *whole; /* NULL beside no values: the places of the points, from 0 */
} column;

typedef struct columns {
    size_t count;
    column list[COLUMNS_MAX];
} columns;

/* The columns with these names, in their order, and for a set with ids those from which the next frame of a sequence
 * begins; `names` NULL: all that the points have of their own, color and texture
 * coordinates if attributes give them, and all attributes. x, y and z come first, whether they are named or not. Errors:
 * attribute_missing for a name that the set does not have. */
bool columns_choose(const points *set, const char *const *names, size_t name_count, columns *out, error *e);

/* Whether one of the names is a column of the color. */
bool columns_need_color(const char *const *names, size_t name_count);

/* False for the name of a column of the points' own that has another type. */
bool columns_suits(const char *name, column_type type);

/* Whether an attribute may not be called so, since the points have something of that name in one of the formats. */
bool columns_is_own(const char *name);

/* Takes memory for the arrays of a set of set->count points that the columns fill, all zeros, and sets the pointers of
 * both. A column that is of no array, or of one that lacks other columns, has no values then. `storage` is to be freed.
 * False: no memory. */
bool columns_lay_out(columns *list, points *set, void **storage, error *e);

/* Puts a number into row i of a column that was laid out. */
void column_store(const column *c, size_t i, double value);

/* The number in row i; of COLUMN_UCHAR and the like a whole one within its range. */
double column_value(const column *c, size_t i);

/* The type that whole numbers from `least` to `most` need: COLUMN_INT if that will do, else COLUMN_UINT or COLUMN_DOUBLE. */
column_type column_type_of_range(double least, double most);

#endif

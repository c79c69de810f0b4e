// SPDX-License-Identifier: Apache-2.0
/* spec_table: the only table of parameters of a job's spec, constant data.
 *
 * Private to src/spec and its tests. Rows are in the order of the help and of the normalised spec; a group
 * comes before its members. Parsing, defaults, ranges, messages and help are derived from it.
 */
#ifndef HEXAD_SPEC_SPEC_TABLE_H
#define HEXAD_SPEC_SPEC_TABLE_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/build_part.h"
#include "base/core/help_text.h"
#include "spec/spec.h"

typedef enum spec_type {
    SPEC_TYPE_GROUP,    /* an object with members of its own */
    SPEC_TYPE_NUMBER,   /* double */
    SPEC_TYPE_INTEGER,  /* int */
    SPEC_TYPE_LARGE,    /* integer to 2^53: int64_t or uint64_t */
    SPEC_TYPE_BOOL,     /* bool */
    SPEC_TYPE_WORD,     /* one of `words`; an enum, in the order of the words */
    SPEC_TYPE_WORDS,    /* array of at least one of `words`; unsigned, a bit for each in their order */
    SPEC_TYPE_STRING,   /* char *; low and high bound its length in characters */
    SPEC_TYPE_VECTOR,   /* three numbers: vec3; the bounds hold for each */
    SPEC_TYPE_TRIPLE,   /* three integers: int[3]; the bounds hold for each */
    SPEC_TYPE_NUMBERS,  /* array of numbers: double * and, at `has`, their number; the bounds hold for each */
    SPEC_TYPE_INTEGERS, /* array of integers: spec_list; the bounds hold for each */
    SPEC_TYPE_LISTS,    /* array of arrays of integers: spec_list * and, at `has`, their number; the bounds
                         * hold for each integer */
    SPEC_TYPE_SIZE,     /* pixels: one integer or [width, height]; two ints */
    SPEC_TYPE_SURFACE,  /* an object with the members of /surface: a further part of the surface; or, if it
                         * is stored, a spec_surface */
    SPEC_TYPE_SURFACES, /* an array of such objects, low to high of them */
    SPEC_TYPE_GROUPS,   /* an array of objects with members, low to high of them */
    SPEC_TYPE_FRAME_VALUES, /* values by frame, see spec/frame_values.h; stored as a bool: they are given */
    SPEC_TYPE_FILES,        /* string or array of strings: spec_files; low and high bound their number */
    SPEC_TYPE_LABELS        /* array of strings: char ** and, at `has`, their number */
} spec_type;

/* "Exactly one of" and "at most one of" among the members of a group. */
typedef enum spec_choice {
    SPEC_CHOICE_NONE,
    SPEC_CHOICE_SURFACE,
    SPEC_CHOICE_COEFFICIENTS,
    SPEC_CHOICE_TARGET,
    SPEC_CHOICE_CURVATURE,
    SPEC_CHOICE_SCALE,
    SPEC_CHOICE_REGION,
    SPEC_CHOICE_GRADING, /* choices from here on: at most one; before: exactly one */
    SPEC_CHOICE_VOXELS,
    SPEC_CHOICE_LENS,
    SPEC_CHOICE_COUNT
} spec_choice;

enum {
    SPEC_REQUIRED = 1,  /* must be given if the shape has it */
    SPEC_LOW_OPEN = 2,  /* the value must exceed the low bound */
    SPEC_OPTIONAL = 4,  /* group: has no defaults; `has` stores whether it is given */
    SPEC_SWITCH = 8,    /* group: may also be true or false, which `has` stores */
    SPEC_OR_ZERO = 16,  /* 0 is permitted although it is below the low bound */
    SPEC_OR_ONE = 32,   /* strings: a single string stands for an array of one */
    SPEC_DEPENDENT = 64 /* the default depends on other members, see spec/relations.c */
};

/* Possible defaults of /solver/method, which depend on other groups. A member of one of these methods
 * belongs to all of them. */
#define SPEC_DEFAULT_METHODS (1u << SPEC_METHOD_SIZED | 1u << SPEC_METHOD_PAPER)

#define SPEC_LABEL_LENGTH_MAX 100 /* characters */
#define SPEC_MAJORITY_MAX 24      /* voxels */

#define SPEC_NOWHERE ((size_t)-1) /* not stored: only checked */

typedef struct spec_row {
    const char *pointer; /* JSON Pointer of the member */
    size_t key_offset;   /* of the last part of the pointer */
    option_rank rank;    /* of a group: that of its most basic member, or more basic */
    spec_type type;
    unsigned flags;
    spec_choice choice;
    unsigned methods; /* bit per spec_method that has the member; 0: all */
    unsigned shapes;  /* bit per spec_shape that has the member; 0: independent of the shape */
    double low, high;
    const char *otherwise;    /* the default as JSON; NULL: none */
    const char *const *words; /* of SPEC_TYPE_WORD and SPEC_TYPE_WORDS, ended by NULL */
    size_t offset,
        has; /* in struct spec, or for members of surfaces in struct spec_surface; `has`: offset of a bool
              * (for lists: of a size_t) */
    const char *title; /* a few words for a form and the help; NULL: the key says it */
    const char *unit;  /* NULL: none */
    build_part part;   /* part of the build to which the member belongs, and for a group all of its members */
    const char *prose;
} spec_row;

extern const spec_row spec_rows[];
extern const size_t spec_row_count;

/* The row of a group's member, NULL if there is none. `group` is a pointer ("" is the root). */
const spec_row *spec_row_find(const char *group, const char *key);
/* The same from a group's first member; NULL as `first`: there are no members. */
const spec_row *spec_row_find_from(const spec_row *first, const char *key);

/* The first member of a group, NULL if there is none. */
const spec_row *spec_row_first(const char *group);
const spec_row *spec_row_first_below(const spec_row *group);

/* The member of the same group that follows, in the order of the table. Returns NULL after the last member. */
const spec_row *spec_row_next(const spec_row *member);

/* Whether the row is a direct member of the group. */
bool spec_row_is_member(const spec_row *row, const char *group);

/* The last part of the row's pointer. */
const char *spec_row_key(const spec_row *row);

#endif

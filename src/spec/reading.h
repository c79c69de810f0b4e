// SPDX-License-Identifier: Apache-2.0
/* reading: the state of reading a spec from a document, with the faults found so far.
 *
 * Reading has two phases. In the first, groups are read one after another, and all faults within them are
 * added. In this phase the spec and its surfaces are incomplete. Their types have no definition, so that
 * they cannot be passed to functions that take a spec or a surface; code of this phase accesses single
 * members with reading_target. The second phase (spec/relations.h) begins only if there is no fault:
 * reading_whole then returns the spec.
 *
 * Private to src/spec. A reading belongs to one thread.
 */
#ifndef HEXAD_SPEC_READING_H
#define HEXAD_SPEC_READING_H

#include <stdbool.h>
#include <stddef.h>

#include "base/json/json.h"
#include "spec/spec.h"
#include "spec/spec_table.h"

enum { READING_SHOWN_MAX = 64 }; /* maximum bytes of a given text that a message repeats */

typedef struct partial_spec partial_spec;       /* a spec that is being read; has no definition */
typedef struct partial_surface partial_surface; /* a surface that is being read; has no definition */

/* A member that is absent and whose default depends on other members. The normalised document has null in
 * its place. */
typedef struct absent_member {
    const spec_row *row;
    partial_surface *surface; /* the surface to which the row belongs; NULL: none */
    json *normal;             /* its group in the normalised document */
} absent_member;

typedef struct reading {
    partial_spec *partial;
    const spec
        *known; /* the spec of another frame of the same sequence, from which surfaces and the queue are
                 * borrowed instead of read; or NULL */
    partial_surface *surface; /* the current surface: that of the spec, or a part of it */
    int depth;                /* nesting depth of surfaces */
    size_t surfaces;          /* number of surfaces read so far */
    size_t slices;            /* number of slices of their image stacks */
    size_t name_bytes;        /* total length of the slices' file names */
    spec_faults faults;
    size_t total;     /* number of faults, including those that were not stored */
    bool complete;    /* all groups have been read */
    bool shape_known; /* the shape of the surface's formula is valid */
    unsigned methods; /* bit for each spec_method that is possible; 0: the method has a fault */
    absent_member *absent;
    size_t absent_count;
} reading;

/* Starts reading into the spec, which is owned by the caller. `known` may be NULL. reading_close frees
 * everything except the spec. */
void reading_open(reading *r, spec *s, const spec *known);
void reading_close(reading *r);

/* The spec, if all groups have been read without a fault; else NULL. */
spec *reading_whole(const reading *r);

/* The address of the member at this offset of struct spec; members of surfaces are in r->surface. */
void *reading_target(reading *r, size_t offset);

/* Adds an absent member whose default depends on other members. */
void reading_add_absent(reading *r, const spec_row *row, json *normal);

/* Adds a fault at this place. Beyond SPEC_MAX_FAULTS faults are only counted. */
void reading_add_fault(reading *r, const json_at *at, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Adds the fault that the member requires a part that is not built; its code is not_supported. */
void reading_add_missing_part(reading *r, const json_at *at, const char *why);

/* Adds the fault that the value is not of this kind ("an integer"), or is out of the row's range. */
void reading_add_wrong_value(reading *r, const json_at *at, const spec_row *row, const char *kind);

/* reading_add_fault for a text that begins with "must be", with the value after it: "(given 7)". If the member is
 * absent, the text says instead that it is required. */
void reading_add_mismatch(reading *r, const json_at *at, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Copies a text, at most READING_SHOWN_MAX bytes of it and never a part of a character. */
void reading_shorten(const char *text, char out[READING_SHOWN_MAX + 4]);

#endif

// SPDX-License-Identifier: Apache-2.0
/* reading: a spec while it is being read from a document, and the faults found in it so far.
 *
 * Reading has two phases. In the first, groups are read one after another, and all faults within them are
 * noted. The spec and its surfaces are incomplete then: their types have no definition, so that they cannot
 * be given to a function that takes a spec or a surface. Code of this phase reaches single members by
 * reading_target. The second phase (spec/relations.h) begins only if there is no fault: reading_whole then
 * returns the spec.
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

enum { READING_SHOWN_MAX = 64 }; /* bytes of a given text that a message repeats */

typedef struct partial_spec partial_spec;       /* a spec that is being read: no definition */
typedef struct partial_surface partial_surface; /* likewise its surface, or a part of it */

/* A member that is absent and whose default depends on other members. The normalised document has null in
 * its place. */
typedef struct absent_member {
    const spec_row *row;
    partial_surface *surface; /* that the row belongs to, if it is a surface's */
    json *normal;             /* the group in the normalised document */
} absent_member;

typedef struct reading {
    partial_spec *partial;
    const spec
        *known; /* another frame of the same sequence: surfaces and the queue are not read, but borrowed
                 * from it; or NULL */
    partial_surface *surface; /* the spec's, or the part of it that is being read */
    int depth;                /* surfaces within surfaces */
    size_t surfaces;          /* read so far */
    size_t slices;            /* of their stacks of images */
    size_t name_bytes;        /* of the file names of these */
    spec_faults faults;
    size_t total;     /* faults found, kept or not */
    bool complete;    /* all groups have been read */
    bool shape_known; /* the shape of the surface's formula has been read */
    unsigned methods; /* a bit for each spec_method that the solver may have; 0: its method has a fault */
    absent_member *absent;
    size_t absent_count;
} reading;

/* Begins to read into the spec, which stays the caller's. `known` may be NULL. reading_close frees what the
 * reading holds besides the spec. */
void reading_open(reading *r, spec *s, const spec *known);
void reading_close(reading *r);

/* The spec, if all groups have been read without a fault; else NULL. */
spec *reading_whole(const reading *r);

/* Where a member at this offset of struct spec is stored; members of the surface belong to r->surface. */
void *reading_target(reading *r, size_t offset);

/* Notes that a member is absent whose default depends on other members. */
void reading_add_absent(reading *r, const spec_row *row, json *normal);

/* Notes a fault at this place. Beyond SPEC_MAX_FAULTS faults are only counted. */
void reading_add_fault(reading *r, const json_at *at, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Notes that the member requires a part that is not built; its code is not_supported. */
void reading_add_missing_part(reading *r, const json_at *at, const char *why);

/* Notes that the value is not of this kind ("an integer") or is out of the row's range. */
void reading_add_wrong_value(reading *r, const json_at *at, const spec_row *row, const char *kind);

/* reading_add_fault, with the value behind the text: "(given 7)". */
void reading_add_mismatch(reading *r, const json_at *at, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Copies a text, at most READING_SHOWN_MAX bytes of it and never a part of a character. */
void reading_shorten(const char *text, char out[READING_SHOWN_MAX + 4]);

#endif

/* reading: a spec while it is being read from a document, and the faults found in it so far.
 *
 * Private to src/spec. A reading belongs to one thread.
 */
#ifndef HEXAD_SPEC_READING_H
#define HEXAD_SPEC_READING_H

#include <stdbool.h>
#include <stddef.h>

#include "json/json.h"
#include "spec/spec.h"
#include "spec/spec_table.h"

enum { READING_SHOWN_MAX = 64 }; /* bytes of a given text that a message repeats */

typedef struct reading {
    spec *s;
    const spec *
        known; /* another frame of the same sequence: surfaces and the queue are not read, but borrowed from it; or NULL */
    spec_surface *surface; /* the spec's, or the part of it that is being read */
    int depth;             /* surfaces within surfaces */
    size_t surfaces;       /* read so far */
    spec_faults faults;
    size_t total;     /* faults found, kept or not */
    bool shape_known; /* surface->analytic.shape holds what was given */
} reading;

/* Where a member at this offset of struct spec is stored; members of the surface belong to r->surface. */
void *reading_target(reading *r, size_t offset);

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

// SPDX-License-Identifier: Apache-2.0
/* ply_rows: the rows of the elements of a PLY file, in the order of the file, in text and in both binary byte
 * orders. In text a row is a line, and empty lines may precede it. Runs in the process that reads.
 */
#ifndef HEXAD_IO_MESHES_PLY_ROWS_H
#define HEXAD_IO_MESHES_PLY_ROWS_H

#include "base/core/ply_header.h"

typedef struct ply_rows {
    const char *data, *at, *end; /* the file; the next byte to read */
    ply_layout layout;
    const ply_element *element;
    uint64_t row;      /* index of the row that is read; the caller increments it */
    const char *fault; /* what is wrong with the row: the predicate of a sentence; NULL: nothing */
} ply_rows;

/* Begins at the first row of the first element. data[size] is 0. */
ply_rows ply_rows_begin(const ply_header *h, const char *data, size_t size);

/* Continues with the first row of an element. The rows of the elements before it have been read. */
void ply_rows_enter(ply_rows *r, const ply_element *element);

/* Upper bound on the rows of the element, by the bytes left. */
size_t ply_rows_at_most(const ply_rows *r);

/* Takes number k of a list. False: reading ends. */
typedef bool ply_rows_take(void *context, size_t k, double number);

/* Reads a row. The number of property k, unless it is a list, goes to number[slot[k]] if slot[k] >= 0; slot may
 * be NULL. The numbers of `list` go to `take`; NULL: the element has no list that is needed. False: the row is
 * faulty, or `take` has returned false. */
bool ply_rows_read(ply_rows *r, const int *slot, double *number, const ply_property *list,
                   ply_rows_take *take, void *context);

/* Skips all rows of the element. Lines of text are not parsed. False: the data end early. */
bool ply_rows_skip(ply_rows *r);

/* Sets the fault of the row. Returns false. */
bool ply_rows_refuse(ply_rows *r, const char *fault);

#endif

// SPDX-License-Identifier: Apache-2.0
/* ply: writes points.ply and mesh.ply, and reads points.ply.
 *
 * The element `vertex` has a property per column; real numbers are all floats or all doubles. A set with
 * triangles has a second element, `face`, with the list `vertex_indices` of three. Faces between labels also
 * have label_a and label_b: int, or uint or double if a number needs it. The header has no date and no path:
 * the same points give the same bytes, for any pool. An ASCII number is the shortest text that reads back to
 * the same value of the property's type. No function keeps state; a file belongs to one thread at a time.
 * LC_NUMERIC must be the C locale.
 */
#ifndef HEXAD_IO_POINTS_PLY_H
#define HEXAD_IO_POINTS_PLY_H

#include <stdbool.h>
#include <stdio.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "io/points/column.h"
#include "io/points/points.h"

typedef enum ply_format { PLY_BINARY_LITTLE_ENDIAN, PLY_ASCII } ply_format;
typedef enum ply_precision { PLY_FLOAT, PLY_DOUBLE } ply_precision;

/* Writes at the current position and flushes. The caller creates, syncs and renames the file. `comments`:
 * lines "comment ...", each with its line end, in place of "comment hexad"; or NULL. Errors: internal (a
 * value is not finite, or not as a float; the message has the point and the property), cancelled. The file
 * is not usable after an error. */
bool ply_write(FILE *file, const points *set, const columns *what, ply_format format, ply_precision precision,
               const char *comments, threads *pool, error *e);

/* A point set that was read. */
typedef struct ply_file {
    points points; /* arrays owned by this struct; NULL if the file lacks a column of the array */
    ply_format format;
    ply_precision precision;
    columns columns; /* columns of the file */
    void *storage;   /* private */
} ply_file;

/* Reads a seekable file from its start to its end. Accepts any header of points with columns that ply_write
 * writes, and then the rows as it writes them. Error: input_damaged (a wrong header, a wrong count, trailing bytes, values that are not finite).
 * Memory is allocated only if the size of the file is consistent with the count. The caller frees *out
 * with ply_file_free. */
bool ply_read(FILE *file, ply_file *out, error *e);
void ply_file_free(ply_file *file); /* accepts NULL and a zeroed struct */

/* The contents of a file. */
typedef struct ply_job {
    const points *set;
    columns what;
    ply_format format;
    ply_precision precision;
    const char *comments; /* as in ply_write */
    threads *pool;
} ply_job;

/* ply_write as a function with a context: `job` is a const ply_job. */
bool ply_write_job(FILE *file, void *job, error *e);

#endif

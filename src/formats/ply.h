/* ply: points.ply and mesh.ply, written and, for verification, read back.
 *
 * The element `vertex` has a property for each column; real numbers are all floats or all doubles. A set with triangles
 * has a second element, `face`, with the list `vertex_indices` of three. Faces between labels also have label_a and label_b: int, or
 * uint or double if a number needs it. The header holds neither a date nor a path: the same points give the same bytes, for any
 * pool. ASCII numbers are the shortest text that reads back to the same value of the property's type.
 * Nothing here keeps state; a file belongs to one thread at a time. LC_NUMERIC must be the C locale.
 */
#ifndef HEXAD_FORMATS_PLY_H
#define HEXAD_FORMATS_PLY_H

#include <stdbool.h>
#include <stdio.h>

#include "base/error.h"
#include "base/threads.h"
#include "formats/column.h"
#include "formats/points.h"

typedef enum ply_format { PLY_BINARY_LITTLE_ENDIAN, PLY_ASCII } ply_format;
typedef enum ply_precision { PLY_FLOAT, PLY_DOUBLE } ply_precision;

/* Writes at the file's position and flushes; the caller made the file and syncs and renames it.
 * A value that is not finite, or not as a float, is an error that names point and property, found
 * before anything is written beyond it: the file is then of no use. `cancelled` when the pool was told to
 * stop. `comments`: lines "comment ...", each with its end, in place of "comment hexad"; or NULL. */
bool ply_write(FILE *file, const points *set, const columns *what, ply_format format, ply_precision precision,
               const char *comments, threads *pool, error *e);

/* Reads a file as ply_read does, point after point, and compares it with the set that was written. Takes no
 * memory that grows with the set. Errors: those of ply_read, input_damaged where a value differs,
 * cancelled. */
bool ply_verify(FILE *file, const points *set, const columns *what, ply_format format,
                ply_precision precision, threads *pool, error *e);

/* A point set as it stands in a file. */
typedef struct ply_file {
    points points; /* arrays owned by this struct; NULL where the file lacks a column of one */
    ply_format format;
    ply_precision precision;
    columns columns; /* of the file */
    void *storage;   /* private, as triangles */
    uint32_t (*triangles)[3];
    int64_t (*triangle_labels)[2];
    bool has_labels; /* its faces have */
    column_type label_type;
} ply_file;

/* Reads a seekable file from its start to its end, strictly: only what ply_write writes (comments
 * apart) is accepted. A wrong header, a count that is not the file's, bytes that are left over, and
 * values that are not finite are errors (input_damaged). Memory is taken only after the size of the
 * file has vouched for the count. On success the caller frees with ply_file_free. */
bool ply_read(FILE *file, ply_file *out, error *e);
void ply_file_free(ply_file *file); /* accepts NULL and a zeroed struct */

/* What a file is to hold, and how; its name stands in errors. */
typedef struct ply_job {
    const char *name;
    const points *set;
    columns what;
    ply_format format;
    ply_precision precision;
    threads *pool;
} ply_job;

/* The above two: `job` is a const ply_job. */
bool ply_write_job(FILE *file, void *job, error *e);
bool ply_verify_job(FILE *file, void *job, error *e);

#endif

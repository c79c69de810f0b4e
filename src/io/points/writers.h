// SPDX-License-Identifier: Apache-2.0
/* writers: the table of the functions that write points and their mesh, by format, except PLY and OpenVDB. A
 * new format needs a file with a function, a row in writers.c, and its row in base/core/file_format.c.
 *
 * The same points give the same bytes: files have no dates and no paths. No function keeps state.
 */
#ifndef HEXAD_IO_POINTS_WRITERS_H
#define HEXAD_IO_POINTS_WRITERS_H

#include <stdbool.h>
#include <stdio.h>

#include "base/core/error.h"
#include "base/core/file_format.h"
#include "io/points/points.h"
#include "io/points/scene.h"

/* The files of a format. POINTS: the points of one result. SEQUENCE and STAGE are written with the first
 * frame and refer to the files of all frames; STAGE belongs above the directories of the frames. */
typedef enum writer_part { WRITER_POINTS, WRITER_SEQUENCE, WRITER_STAGE, WRITER_PARTS } writer_part;

typedef bool writer_function(FILE *file, const points *set, const scene *place, error *e);

typedef struct writer {
    /* Writes to an empty file from its start, and flushes it. The stream need not have a descriptor, nor be
     * readable. NULL: no such file. */
    writer_function *write[WRITER_PARTS];
    bool has_colors;    /* colors are written even without a color attribute */
    bool has_mesh;      /* writes meshes */
    bool has_instances; /* writes instances (scene.h) */
} writer;

extern const writer writers[FILE_FORMATS];

/* The name of a file in a result. The caller frees it. */
char *writers_name(file_format format, writer_part part, bool of_mesh);

#endif

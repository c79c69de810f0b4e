/* format: the formats of points and of their mesh beside PLY and OpenVDB, as rows of a table. A new one is a file with two functions and a
 * row in format.c.
 *
 * Files are the same bytes for the same points: without dates and paths. Nothing here keeps state.
 */
#ifndef HEXAD_FORMATS_FORMAT_H
#define HEXAD_FORMATS_FORMAT_H

#include <stdbool.h>
#include <stdio.h>

#include "base/error.h"
#include "formats/points.h"
#include "formats/scene.h"

typedef struct point_format {
    const char *file; /* its name in a result */
    bool colored;     /* it has colors even where no attribute gives them */
    bool of_sequence; /* it is of all frames, and lies beside the first */
    bool of_mesh;
    /* Writes at the beginning of an empty file, which is flushed. */
    bool (*write)(FILE *file, const points *set, const scene *place, error *e);
    /* Reads the file again and compares it with the set. Error: input_damaged where they differ. */
    bool (*verify)(FILE *file, const points *set, const scene *place, error *e);
} point_format;

typedef enum format_name {
    FORMAT_NPZ,
    FORMAT_GLB,
    FORMAT_USDA,
    FORMAT_USDA_SEQUENCE,
    FORMAT_MESH_USDA,
    FORMAT_MESH_USDA_SEQUENCE,
    FORMATS
} format_name;

extern const point_format formats[FORMATS];

#endif

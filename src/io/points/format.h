/* format: the table of formats of points and of their mesh, other than PLY and OpenVDB. A new format needs a file with
 * one function and a row in format.c.
 *
 * The same points give the same bytes: files have no dates and no paths. No function keeps state.
 */
#ifndef HEXAD_IO_POINTS_FORMAT_H
#define HEXAD_IO_POINTS_FORMAT_H

#include <stdbool.h>
#include <stdio.h>

#include "base/core/error.h"
#include "io/points/points.h"
#include "io/points/scene.h"

typedef struct point_format {
    const char *file; /* name of the file in a result */
    bool colored;     /* has colors even without a color attribute */
    bool of_sequence; /* covers all frames; is written with the first one */
    bool of_mesh;
    /* Writes to an empty file from its start, and flushes it. The stream need not have a descriptor, nor be readable. */
    bool (*write)(FILE *file, const points *set, const scene *place, error *e);
} point_format;

typedef enum format_name {
    FORMAT_NPZ,
    FORMAT_GLB,
    FORMAT_USDA,
    FORMAT_USDA_SEQUENCE,
    FORMAT_USDA_STAGE,
    FORMAT_MESH_USDA,
    FORMAT_MESH_USDA_SEQUENCE,
    FORMAT_MESH_USDA_STAGE,
    FORMATS
} format_name;

extern const point_format formats[FORMATS];

#endif

// SPDX-License-Identifier: Apache-2.0
/* mesh_array: meshes and points from arrays in memory, checked as those of files (mesh_file.h). Pure functions but
 * for allocation; any thread. */
#ifndef HEXAD_IO_MESHES_MESH_ARRAY_H
#define HEXAD_IO_MESHES_MESH_ARRAY_H

#include "base/core/array_view.h"
#include "io/meshes/mesh_file.h"

typedef struct mesh_array {
    array_view vertices; /* (V, 3), of any type */
    /* integers: (F, n), the vertices of the n >= 3 corners of each face; with counts (C), the vertices of the corners
     * of all faces, one face after the other */
    array_view faces;
    array_view counts; /* integers (F): the number of corners of each face; without data: there are none */
} mesh_array;

/* As mesh_file_read. Errors: input_damaged, input_unsupported, no_surface, limit_memory, cancelled. */
bool mesh_array_read(const mesh_array *a, size_t memory_limit, mesh *out, mesh_notes *notes, error *e);

/* As mesh_file_read_polygons. */
bool mesh_array_read_polygons(const mesh_array *a, size_t memory_limit, mesh *out, mesh_polygons *polygons,
                              error *e);

/* Points (N, 3), as mesh_file_read_points. */
bool mesh_array_read_points(const array_view *a, size_t memory_limit, vec3 **out, size_t *count, error *e);

#endif

// SPDX-License-Identifier: Apache-2.0
/* map: a scalar grid of a VDB file, a dense array, or a value of the vertices of a mesh file as a function of
 * space, for painted maps.
 *
 * Values are interpolated trilinearly between voxels. Outside active voxels the value is the background, if
 * that is above 0; otherwise inactive voxels are ignored. The grid has its own transform. The value of a mesh is
 * that of the nearest point of its triangles, interpolated linearly between the vertices. World space.
 * Immutable after construction, any thread.
 */
#ifndef HEXAD_SURFACE_VOLUME_MAP_H
#define HEXAD_SURFACE_VOLUME_MAP_H

#include <stddef.h>

#include "base/core/error.h"
#include "geometry/space/vec3.h"
#include "io/meshes/mesh_file.h"
#include "io/volumes/array_slices.h"

typedef struct map map;

/* `fd` is open for reading and is not closed; `grid` as in volume_request; `path` is for messages only. The
 * caller frees the map with map_close. Errors: those of grid_selection_find and vdb_load_grid, input_damaged
 * (an active voxel is not finite); messages have the file and the grid. */
map *map_open(int fd, const char *path, const char *grid, size_t memory_limit, error *e);

/* A dense array as a map: its elements are voxels, and beyond them there are none. The grid and its array outlive
 * the map. Errors: those of array_grid_check, input_damaged (an element is not finite). */
map *map_of_array(const array_grid *grid, error *e);

/* The array `name` of the vertices of a mesh file (mesh_file_read_values). `component`: index of the component, or
 * MAP_NO_COMPONENT for an array of one. The file need not outlive the map. Errors: those of
 * mesh_file_read_values (also for `notes`) and mesh_values_find, input_unsupported (the component), input_damaged (the value of a
 * vertex of a triangle is not finite), limit_memory; messages have the file. */
enum { MAP_NO_COMPONENT = -1 };
map *map_of_vertices(const mesh_file *file, const char *name, int component, mesh_notes *notes, error *e);

void map_close(map *m);
size_t map_memory(const map *m); /* bytes; NULL: 0 */

/* The value at x; NaN if all voxels around it are ignored. `m` is a map; the type is that of a callback's
 * context. */
double map_value(const void *m, vec3 x);

/* Whether the triangles of a mesh are within `distance` of x; or whether a voxel has a value there: at x, or at
 * `distance` or half of it along an axis. The background is no value. */
bool map_is_near(const map *m, vec3 x, double distance);

#endif

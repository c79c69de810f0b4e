/* map: a scalar grid of a VDB file as a function of space, for what is painted beside a surface.
 *
 * Between voxels the value is trilinear. Where nothing is painted the value is the background's if that is above 0;
 * otherwise inactive voxels do not count. The grid has a transform of its own. World space. Immutable once open, safe in any thread.
 */
#ifndef HEXAD_VOLUME_MAP_H
#define HEXAD_VOLUME_MAP_H

#include <stddef.h>

#include "base/error.h"
#include "geometry/vec3.h"

typedef struct map map;

/* `fd` is open for reading and stays the caller's; `grid` as in volume_request; `path` is for messages only.
 * Errors: those of grid_selection_find and vdb_load_grid, input_damaged for an active voxel that is not finite;
 * each names the file and the grid. */
map *map_open(int fd, const char *path, const char *grid, size_t memory_limit, error *e);
void map_close(map *m);
size_t map_memory(const map *m); /* bytes that it holds; 0 for NULL */

/* The value at x; NaN where no voxel around it counts. `m` is a map, void for a callback's sake. */
double map_value(const void *m, vec3 x);

#endif

// SPDX-License-Identifier: Apache-2.0
/* grid_selection: selects a grid of a file.
 *
 * A request is NULL for the only scalar grid, a name, or "name[1]" if several grids have the same name
 * (counted from 0 in the order of the file); "" is an unnamed grid. A grid whose name equals the request
 * takes precedence, so that names with brackets work.
 */
#ifndef HEXAD_SURFACE_VOLUME_GRID_SELECTION_H
#define HEXAD_SURFACE_VOLUME_GRID_SELECTION_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"
#include "io/vdb/vdb.h"

/* The unique name of a grid: "name[1]" if several have the same name. */
void grid_selection_name(const vdb_listing *listing, size_t index, char out[VDB_NAME_SIZE]);

/* Finds a grid: its index in the listing and its unique name. Errors, with a list of the grids: grid_missing,
 * grid_ambiguous, input_unsupported (not float or double). */
bool grid_selection_find(const vdb_listing *listing, const char *request, size_t *index,
                         char unique[VDB_NAME_SIZE], error *e);

/* grid_selection_find for an attribute, which may be any grid of numbers or vectors. Error:
 * attribute_missing. */
bool grid_selection_find_numeric(const vdb_listing *listing, const char *request, size_t *index, error *e);

/* grid_selection_find in a file; also returns the grid's class. Errors: also those of vdb_list_grids. */
bool grid_selection_find_in_file(int fd, const char *request, size_t *index, vdb_class *grid_class,
                                 char unique[VDB_NAME_SIZE], error *e);

#endif

/* grid_selection: which grid of a file is meant.
 *
 * A request is NULL for the only scalar grid, a name, or "name[1]" where several grids have one name
 * (counted from 0 in the order of the file); "" is an unnamed grid. A grid whose own name is the
 * request comes first, so that a name that ends in brackets can be asked for.
 */
#ifndef HEXAD_VOLUME_GRID_SELECTION_H
#define HEXAD_VOLUME_GRID_SELECTION_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"
#include "vdb/vdb.h"

/* The name of a grid that tells it from the others: "name[1]" among equals. */
void grid_selection_name(const vdb_listing *listing, size_t index, char out[VDB_NAME_SIZE]);

/* The grid's number in the listing and the name that tells it from the others ("name[1]" among
 * equals). Errors, each listing what the file holds: grid_missing, grid_ambiguous,
 * input_unsupported for a grid that is not float or double. */
bool grid_selection_find(const vdb_listing *listing, const char *request, size_t *index,
                         char unique[VDB_NAME_SIZE], error *e);

/* The same for an attribute, which any grid of numbers or vectors may be; what is not there is attribute_missing. */
bool grid_selection_find_numeric(const vdb_listing *listing, const char *request, size_t *index, error *e);

/* The same of a file, with the grid's class. Errors: those of vdb_list_grids as well. */
bool grid_selection_find_in_file(int fd, const char *request, size_t *index, vdb_class *grid_class,
                                 char unique[VDB_NAME_SIZE], error *e);

#endif

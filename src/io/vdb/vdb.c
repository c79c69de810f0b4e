// SPDX-License-Identifier: Apache-2.0
#include "io/vdb/vdb.h"

#include <stdlib.h>
#include <strings.h>

/* All arrays were allocated by the shim with calloc. */

void vdb_listing_free(vdb_listing *listing)
{
    free(listing->entries);
    *listing = (vdb_listing){0};
}

void vdb_grid_free(vdb_grid *grid)
{
    if (!grid) return;
    free(grid->leaf_origin);
    free(grid->leaf_values);
    free(grid->leaf_active);
    free(grid->tiles);
    free(grid);
}

bool vdb_is_unit(const char *name)
{
    return strcasecmp(name, "unit") == 0 || strcasecmp(name, "units") == 0;
}

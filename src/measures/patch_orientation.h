/* patch_orientation: which patches of a mesh must be turned so that patches that meet in an edge of two triangles agree.
 *
 * Vertices belong to one patch each; patches meet where edges have equal coordinates. Pure functions.
 */
#ifndef HEXAD_MEASURES_PATCH_ORIENTATION_H
#define HEXAD_MEASURES_PATCH_ORIENTATION_H

#include <stdbool.h>

#include "measures/facets.h"

/* turned[p] (patch_count values): the normals of patch p must be reversed. The first patch of each piece is not turned; of a piece that cannot
 * be oriented any solution is returned. Error: limit_memory. */
bool patch_orientation_find(const facets_input *in, bool *turned, error *e);

#endif

/* roof: where a triangle is nearest for sure.
 *
 * The roofs of a triangle rise from its sides on both faces, so steeply that a ball which touches the triangle, and whose radius is
 * at most half of its foot's distance from any side, lies under them. Where no other triangle is under them either, a place
 * whose distance from its foot is that small is nearest to this triangle, wherever the search for it began. Pure
 * functions.
 */
#ifndef HEXAD_MESH_ROOF_H
#define HEXAD_MESH_ROOF_H

#include "mesh/nearest_triangle.h"

/* Whether no other triangle of the tree is under the roofs of triangle n of its mesh. May be false where it is so: the triangle is
 * a needle, or rounding might matter. */
bool roof_is_clear(const nearest_triangle *tree, const mesh *m, size_t n);

/* Feet whose weight of some corner is less are so near to a side that roofs say nothing. */
#define ROOF_LEAST_WEIGHT 1e-7

#endif

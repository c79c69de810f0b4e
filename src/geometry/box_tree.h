/* box_tree: which of some boxes are near a place, by a tree of halves along Morton's curve. Boxes may differ in size as
 * they like.
 */
#ifndef HEXAD_GEOMETRY_BOX_TREE_H
#define HEXAD_GEOMETRY_BOX_TREE_H

#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "geometry/bbox.h"

typedef struct box_tree box_tree;

/* A tree of `count` boxes, fewer than 2^31, none of them empty; they are copied. On failure NULL and limit_memory. */
box_tree *box_tree_new(const bbox *box, size_t count, error *e);
void box_tree_free(box_tree *t);

/* Makes a box so large that it holds x. */
void box_tree_extend(box_tree *t, uint32_t box, vec3 x);

/* The boxes that come within `reach` of x along each axis, ascending; *count of them. Stays until the next call. */
const uint32_t *box_tree_find(box_tree *t, vec3 x, double reach, size_t *count);

#endif

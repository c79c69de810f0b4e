// SPDX-License-Identifier: Apache-2.0
/* orientation: connected sets of triangles, and which triangles must be reversed for a consistent
 * orientation.
 *
 * A union-find forest over the triangles. Each triangle stores whether its orientation is opposite to that of
 * its parent. The least triangle of a set is its root. Free with orientation_free. Single-threaded:
 * orientation_find compresses paths.
 */
#ifndef HEXAD_GEOMETRY_MESH_ORIENTATION_H
#define HEXAD_GEOMETRY_MESH_ORIENTATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"

typedef struct orientation {
    uint32_t *parent;
    bool *turned;   /* per triangle: its orientation is opposite to that of its parent */
    bool *conflict; /* per root: the set is not orientable */
} orientation;

/* Makes one set per triangle. Free *out also after failure. Error: limit_memory. */
bool orientation_init(orientation *out, size_t triangles, error *e);
void orientation_free(orientation *o);

/* The root of the set of a triangle. *turned: the orientation of the triangle is opposite to that of the
 * root. */
uint32_t orientation_find(orientation *o, uint32_t triangle, bool *turned);

/* Joins the sets of two triangles. `against`: one of the two must be reversed for a consistent
 * orientation. */
void orientation_join(orientation *o, uint32_t a, uint32_t b, bool against);

#endif

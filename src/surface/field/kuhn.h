// SPDX-License-Identifier: Apache-2.0
/* kuhn: Kuhn's decomposition of a cell into six tetrahedra. Each has the corners on a path of three edges
 * from corner 0 to corner 7, one path for each order of the axes. Corners are numbered as in field_cell. Pure
 * functions.
 */
#ifndef HEXAD_SURFACE_FIELD_KUHN_H
#define HEXAD_SURFACE_FIELD_KUHN_H

enum { KUHN_TETRAHEDRA = 6 };

typedef struct kuhn_path {
    int axis[3], corner[4];
} kuhn_path;

/* The path of tetrahedron k; the orders of the axes ascend. */
static inline kuhn_path kuhn_path_of(int k)
{
    const int first = k / 2, second = k % 2 + (k % 2 >= first);
    const kuhn_path path = {{first, second, 3 - first - second},
                            {0, 1 << first, 1 << first | 1 << second, 7}};
    return path;
}

#endif

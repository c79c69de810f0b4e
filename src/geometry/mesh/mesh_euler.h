// SPDX-License-Identifier: Apache-2.0
/* mesh_euler: the Euler characteristic of a mesh: vertices minus edges plus triangles. An edge, and a vertex, of several
 * triangles counts once. */
#ifndef HEXAD_GEOMETRY_MESH_MESH_EULER_H
#define HEXAD_GEOMETRY_MESH_MESH_EULER_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"

/* Adds to *euler. Without `borders`, edges of one triangle and their vertices do not count. Triangles with two equal
 * corners are ignored. Errors: limit_memory, cancelled. */
bool mesh_euler_add(const mesh *m, bool borders, threads *pool, double *euler, error *e);

#endif

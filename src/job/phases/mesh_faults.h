// SPDX-License-Identifier: Apache-2.0
/* mesh_faults: finds the vertices at which triangles between points are not a manifold, or have a boundary
 * where the surface has none. The same definitions as triangulation_survey, which counts them.
 */
#ifndef HEXAD_JOB_PHASES_MESH_FAULTS_H
#define HEXAD_JOB_PHASES_MESH_FAULTS_H

#include "base/core/error.h"
#include "sampling/voronoi/triangulation.h"

/* The number of edges and vertices at which the triangles are not a manifold or have an unexpected
 * boundary. */
size_t mesh_faults_count(const triangulation_facts *facts);

/* Sets faulty[v] for each vertex, 0 .. in->points - 1: whether it is in no triangle, or touches a faulty edge,
 * or its triangles form several fans. `made` has corners and facts.triangles. *count: the faulty vertices.
 * Error: limit_memory. */
bool mesh_faults_mark(const triangulation_input *in, const triangulation *made, bool *faulty, size_t *count,
                      error *e);

#endif

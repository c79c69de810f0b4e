// SPDX-License-Identifier: Apache-2.0
/* seams: closes open edges that coincide with others within a tolerance, or on which vertices of other
 * triangles lie, as between separately triangulated faces of a CAD model.
 *
 * Units: those of the mesh. Single-threaded; no shared state.
 */
#ifndef HEXAD_GEOMETRY_MESH_SEAMS_H
#define HEXAD_GEOMETRY_MESH_SEAMS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "geometry/mesh/mesh.h"

/* An edge of one triangle. */
typedef struct seam_edge {
    uint32_t from, to; /* vertices, in the triangle's order */
    uint32_t triangle;
} seam_edge;

/* Joins vertices of open edges whose distance is at most `tolerance`, each with one other vertex, and drops
 * triangles that then have two equal corners. Adds the number of removed vertices to *joined. Error:
 * limit_memory. */
bool seams_join(mesh *m, const seam_edge *edges, size_t count, double tolerance, size_t *joined, error *e);

/* Splits triangles at vertices of other open edges that lie within `tolerance` of their open edges. A
 * triangle with several such edges is split at one; call again with the remaining open edges. Adds the number
 * of split triangles to *split. Error: limit_memory. */
bool seams_split(mesh *m, const seam_edge *edges, size_t count, double tolerance, size_t *split, error *e);

#endif

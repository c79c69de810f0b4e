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

/* Vertices are joined, and lie on an edge, within `tolerance`, but at most within a tenth of the shortest edge at either
 * of them, and the rounding of their coordinates (rounding.h): a part that is small beside the whole mesh keeps its shape. */

/* Joins vertices of open edges, each with one other vertex, and drops
 * triangles that then have two equal corners. Adds the number of removed vertices to *joined. Error:
 * limit_memory. */
bool seams_join(mesh *m, const seam_edge *edges, size_t count, double tolerance, size_t *joined, error *e);

/* Splits triangles at vertices of other open edges that lie on their open edges. A
 * triangle with several such edges is split at one; call again with the remaining open edges. Adds the number
 * of split triangles to *split. Error: limit_memory. */
bool seams_split(mesh *m, const seam_edge *edges, size_t count, double tolerance, size_t *split, error *e);

#endif

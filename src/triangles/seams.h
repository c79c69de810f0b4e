/* seams: open edges that meet others but for rounding, or on which vertices of other triangles lie, as where patches of
 * a CAD model meet that were cut into triangles each for itself.
 *
 * Units: the mesh's. Threads: none; no shared state.
 */
#ifndef HEXAD_TRIANGLES_SEAMS_H
#define HEXAD_TRIANGLES_SEAMS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "triangles/mesh.h"

/* An edge of one triangle only. */
typedef struct seam_edge {
    uint32_t from, to; /* vertices, in the triangle's order */
    uint32_t triangle;
} seam_edge;

/* Joins vertices of open edges whose distance is at most `tolerance`, each with one of them, and drops triangles that
 * have two equal corners then. Adds to *joined the number of vertices that are gone. Errors: limit_memory. */
bool seams_join(mesh *m, const seam_edge *edges, size_t count, double tolerance, size_t *joined, error *e);

/* Splits triangles at vertices of other open edges that lie within `tolerance` of theirs; of a triangle with several
 * such edges one, so that it takes another call with what is open then. Adds to *split the number of triangles that
 * were split. Errors: limit_memory. */
bool seams_split(mesh *m, const seam_edge *edges, size_t count, double tolerance, size_t *split, error *e);

#endif

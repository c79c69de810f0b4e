/* flat_triangles: removes triangles without area that have three distinct corners.
 *
 * The corners of such a triangle lie on a line to within the rounding of their coordinates, so that rounding alone decides where its
 * normal points. If two corners coincide to within rounding, their edge is collapsed. Otherwise one corner lies on the longest side:
 * the triangle is removed, and the other triangles at that side are split at the corner. Both keep closed surfaces closed, and move
 * the surface by no more than the rounding.
 *
 * Threads: those of a pool, or NULL, whose number does not show; no shared state.
 */
#ifndef HEXAD_TRIANGLES_FLAT_TRIANGLES_H
#define HEXAD_TRIANGLES_FLAT_TRIANGLES_H

#include <stdbool.h>

#include "base/error.h"
#include "base/threads.h"
#include "triangles/mesh.h"
#include "triangles/rounding.h"

/* If there are flat triangles, equal vertices are joined, the flat triangles are removed and a note gives their number. Otherwise
 * the mesh stays as it is. Triangles with two equal corners are left to mesh_weld. Errors: limit_memory, cancelled; the mesh is
 * valid, but may be changed. */
bool flat_triangles_remove(mesh *m, threads *pool, mesh_notes *notes, error *e);

/* The same without a note, of triangles that are flat to within this rounding. */
bool flat_triangles_remove_thin(mesh *m, const rounding *r, error *e);

#endif

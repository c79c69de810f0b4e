/* surface_mesh: the triangles between points on a triangle mesh: the dual of the points' cells along the surface
 * (geodesic_cells), with edges flipped until the angles opposite to each sum up to at most 180 degrees.
 *
 * Where cells are discs the triangles have the topology of the mesh, however near opposite walls are and however sharp
 * its edges. Cells that meet in several places, as on a fin, one that another surrounds, as at a tip, and one around a
 * neck are repaired where points are available: then no edge has four triangles. Where the mesh ends they do, up to the
 * edges between the points along its boundary. World space. Threads: none.
 */
#ifndef HEXAD_REMESH_SURFACE_MESH_H
#define HEXAD_REMESH_SURFACE_MESH_H

#include "base/error.h"
#include "triangles/mesh.h"

typedef struct surface_mesh_input {
    const mesh *m;
    size_t count;
    const vec3 *position; /* on the mesh */
    const double *spacing;
    const uint32_t *name; /* the vertex that the point is; several points may be one */
    size_t names;
    /* Steps along curves, each between two of the points: their edges stay. */
    const uint32_t (*side)[2];
    size_t side_count;
} surface_mesh_input;

/* Triangles counterclockwise as those of the mesh are, to be freed. Error: limit_memory. Deterministic. */
bool surface_mesh_make(const surface_mesh_input *in, uint32_t (**triangle)[3], size_t *count, error *e);

#endif

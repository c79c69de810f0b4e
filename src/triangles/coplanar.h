/* coplanar: faces of different parts of a mesh that lie in one plane and overlap, as where a box stands on a larger face.
 *
 * A part is a set of triangles of one plane that are connected by sides of two triangles. Where two parts overlap, both are cut along
 * each other's outlines, and neighbours out of the plane with them, so that closed meshes stay closed. Then, of faces that look the same
 * way, that of the first part stays. Faces that look opposite ways touch: in a closed mesh neither stays, as they bound nothing, unless
 * that leaves a hole (contacts.h). There, and in an open mesh, where orientation says nothing, that of the first part stays. A part that
 * overlaps itself is left alone.
 *
 * Threads: none; no shared state.
 */
#ifndef HEXAD_TRIANGLES_COPLANAR_H
#define HEXAD_TRIANGLES_COPLANAR_H

#include <stdbool.h>

#include "base/error.h"
#include "triangles/mesh.h"
#include "triangles/mesh_edges.h"
#include "triangles/rounding.h"

/* Times the rounding: corners as near are one, and overlaps as thin are none. Crossings of sides are computed twice, each off by the more
 * the flatter they cross. Triangles as thin may be left by cuts: flat_triangles_remove_thin takes them away. */
#define COPLANAR_THIN 4

typedef struct coplanar_overlap {
    /* area, counted once, where faces look the same way; where some look opposite ways and one stays; where none does */
    double same, opposite, contact;
    bool
        unfinished; /* the cuts did not come to an end: the mesh is as it was, overlaps included, and the areas are 0 */
} coplanar_overlap;

/* The mesh is welded, and has these edges. Planes are one to within the rounding. If triangles were cut, the mesh is not welded
 * afterwards; else it is as it was. Errors: limit_memory, input_unsupported. */
bool coplanar_cut(mesh *m, const mesh_edges *edges, const rounding *r, coplanar_overlap *out, error *e);

#endif

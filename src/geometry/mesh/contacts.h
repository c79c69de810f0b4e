// SPDX-License-Identifier: Apache-2.0
/* contacts: distinguishes contacts of solids from coincident faces of opposite orientation whose removal
 * would leave a hole.
 *
 * Where closed shells touch, two coincident faces have opposite orientations. They bound nothing, and both
 * are removed. Such pairs also occur where a surface is in the file twice and one face is reversed, or where
 * a face is in the file together with its back, as leaves are: removing both would leave a hole, or lose the
 * sheet. A set of cancelling faces connected by edges is a contact if other faces meet at its border, at least
 * two at each edge of it.
 * Single-threaded; no shared state.
 */
#ifndef HEXAD_GEOMETRY_MESH_CONTACTS_H
#define HEXAD_GEOMETRY_MESH_CONTACTS_H

#include <stdbool.h>

#include "base/core/error.h"
#include "geometry/mesh/mesh.h"
#include "geometry/mesh/mesh_edges.h"

/* State of a triangle. */
enum {
    CONTACTS_REMAINS,
    CONTACTS_REMOVED, /* removed for another reason, and ignored here */
    CONTACTS_CANCELS, /* another triangle coincides with it in the opposite orientation */
    CONTACTS_NEEDED   /* cancels as above, but is no contact: one of the two is kept */
};

/* `face`: the state of each triangle. Changes CONTACTS_CANCELS to CONTACTS_NEEDED where faces are not in
 * contact. Error: limit_memory. */
bool contacts_find_needed(const mesh *m, unsigned char *face, error *e);

/* Sets closed[t] for each triangle: an even number of triangles meets at each edge of its connected component.
 * Error: limit_memory. */
bool contacts_find_closed(const mesh *m, const mesh_edges *edges, bool *closed, error *e);

#endif

// SPDX-License-Identifier: Apache-2.0
/* contacts: distinguishes contacts of solids from coincident faces of opposite orientation whose removal
 * would leave a hole.
 *
 * Where closed shells touch, two coincident faces have opposite orientations. They bound nothing, and both
 * are removed. Such pairs also occur where a surface is in the file twice and one face is reversed, or where
 * a face is in the file together with its back. Removing both would then leave a hole. A set of cancelling
 * faces connected by edges is a contact if none of their edges has exactly one remaining face.
 * Single-threaded; no shared state.
 */
#ifndef HEXAD_GEOMETRY_MESH_CONTACTS_H
#define HEXAD_GEOMETRY_MESH_CONTACTS_H

#include <stdbool.h>

#include "base/core/error.h"
#include "geometry/mesh/mesh.h"

/* State of a triangle. */
enum {
    CONTACTS_REMAINS,
    CONTACTS_REMOVED, /* removed for another reason, and ignored here */
    CONTACTS_CANCELS, /* another triangle coincides with it in the opposite orientation */
    CONTACTS_NEEDED   /* cancels as above, but its removal would leave a hole */
};

/* `face`: the state of each triangle. Changes CONTACTS_CANCELS to CONTACTS_NEEDED where faces are not in
 * contact. Error: limit_memory. */
bool contacts_find_needed(const mesh *m, unsigned char *face, error *e);

#endif

/* contacts: which faces that cancel each other are a contact of solids, and which would leave a hole.
 *
 * Where closed shells touch, two faces look opposite ways. They bound nothing, and both are removed. Two faces also look opposite ways
 * where a surface is in the file twice and one face is turned, or where a face is in the file with its back. If both are removed there,
 * the surface has a hole. Cancelling faces that are connected by edges are a contact if none of their edges has exactly one remaining
 * face. Threads: none; no shared state.
 */
#ifndef HEXAD_TRIANGLES_CONTACTS_H
#define HEXAD_TRIANGLES_CONTACTS_H

#include <stdbool.h>

#include "base/error.h"
#include "triangles/mesh.h"

/* Of a triangle. */
enum {
    CONTACTS_REMAINS,
    CONTACTS_REMOVED, /* for another reason: it does not count */
    CONTACTS_CANCELS,
    CONTACTS_NEEDED /* it cancels, and would leave a hole */
};

/* `face` has one of these for each triangle. Those that cancel become CONTACTS_NEEDED where they are no contact. Errors: limit_memory. */
bool contacts_find_needed(const mesh *m, unsigned char *face, error *e);

#endif

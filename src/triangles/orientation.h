/* orientation: sets of triangles that hang together, and which of them must be turned for all to agree.
 *
 * A forest over the triangles, each with whether it lies against its parent. The least triangle of a set is its root.
 * Ownership: orientation_free. Threads: none; finding makes ways shorter.
 */
#ifndef HEXAD_TRIANGLES_ORIENTATION_H
#define HEXAD_TRIANGLES_ORIENTATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"

typedef struct orientation {
    uint32_t *parent;
    bool *turned;   /* against the parent's orientation */
    bool *conflict; /* of a root: no way of turning makes all of its triangles agree */
} orientation;

/* Each triangle alone. Errors: limit_memory; free *out then, too. */
bool orientation_init(orientation *out, size_t triangles, error *e);
void orientation_free(orientation *o);

/* The root of a triangle's set; *turned: the triangle lies against it. */
uint32_t orientation_find(orientation *o, uint32_t triangle, bool *turned);

/* Puts two triangles into one set; `against`: one of them must be turned for both to agree. */
void orientation_join(orientation *o, uint32_t a, uint32_t b, bool against);

#endif

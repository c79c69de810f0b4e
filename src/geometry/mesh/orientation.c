// SPDX-License-Identifier: Apache-2.0
#include "geometry/mesh/orientation.h"

#include <stdlib.h>

#include "base/core/memory.h"
#include "base/core/sets.h"

bool orientation_init(orientation *out, size_t triangles, error *e)
{
    const char *what = "the orientation of the mesh";
    out->parent = mem_array(triangles, sizeof *out->parent, what, e);
    out->turned = mem_array(triangles, sizeof *out->turned, what, e);
    out->conflict = mem_array(triangles, sizeof *out->conflict, what, e);
    if (!out->parent || !out->turned || !out->conflict) return false;
    sets_reset(out->parent, triangles);
    return true;
}

void orientation_free(orientation *o)
{
    free(o->parent);
    free(o->turned);
    free(o->conflict);
    *o = (orientation){0};
}

uint32_t orientation_find(orientation *o, uint32_t n, bool *turned)
{
    uint32_t root = n;
    bool all = false;
    while (o->parent[root] != root) {
        all ^= o->turned[root];
        root = o->parent[root];
    }
    *turned = all;
    while (o->parent[n] != root && n != root) { /* path compression */
        uint32_t next = o->parent[n];
        bool rest = all ^ o->turned[n];
        o->parent[n] = root;
        o->turned[n] = all;
        all = rest;
        n = next;
    }
    return root;
}

void orientation_join(orientation *o, uint32_t a, uint32_t b, bool against)
{
    bool ta, tb;
    uint32_t ra = orientation_find(o, a, &ta), rb = orientation_find(o, b, &tb);
    bool differs = ta ^ tb ^ against;
    if (ra == rb) {
        if (differs) o->conflict[ra] = true;
        return;
    }
    uint32_t low = ra < rb ? ra : rb, high = ra < rb ? rb : ra;
    o->parent[high] = low;
    o->turned[high] = differs;
    o->conflict[low] |= o->conflict[high];
}

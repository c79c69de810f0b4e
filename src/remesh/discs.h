/* discs: which vertices of a triangle mesh have a disc of triangles around them. World space. Threads: none. */
#ifndef HEXAD_REMESH_DISCS_H
#define HEXAD_REMESH_DISCS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"

/* Of each vertex, of `names`, whether the triangles around it are a disc: one fan that closes. Error: limit_memory. */
bool discs_find(const uint32_t (*triangle)[3], size_t count, size_t names, bool *disc, error *e);

#endif

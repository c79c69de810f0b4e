// SPDX-License-Identifier: Apache-2.0
/* linked_mesh: a mesh with a linked list of the corners at each vertex, for adding, changing and dropping
 * single triangles.
 *
 * Corner c is corner c % 3 of triangle c / 3. Triangles with two equal corners are in no list.
 * Single-threaded.
 */
#ifndef HEXAD_GEOMETRY_MESH_LINKED_MESH_H
#define HEXAD_GEOMETRY_MESH_LINKED_MESH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "geometry/mesh/mesh.h"

#define LINKED_MESH_NONE UINT32_MAX

typedef struct linked_mesh {
    mesh *m;
    uint32_t *next, *previous; /* per corner: in the list of its vertex */
    uint32_t *head, *degree;   /* per vertex: its first corner, and the number of its corners */
    bool *dead;                /* per triangle: dropped */
    size_t triangle_room, next_room, previous_room, dead_room, vertex_room, head_room, degree_room;
} linked_mesh;

/* Makes the lists. Vertices of equal position must have been joined. The mesh remains the caller's; its
 * arrays grow. Error: limit_memory. */
bool linked_mesh_begin(mesh *m, linked_mesh *out, error *e);
/* Removes dropped triangles from the mesh, keeping the order of the others, and frees the lists. */
void linked_mesh_end(linked_mesh *l);

static inline bool linked_mesh_is_proper(const uint32_t t[3])
{
    return t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
}

/* The corner of a triangle at v; -1: none. */
static inline int linked_mesh_corner(const uint32_t t[3], uint32_t v)
{
    return t[0] == v ? 0 : t[1] == v ? 1 : t[2] == v ? 2 : -1;
}

void linked_mesh_drop(linked_mesh *l, uint32_t triangle);
/* Moves a corner of a triangle to another vertex. */
void linked_mesh_move(linked_mesh *l, uint32_t corner, uint32_t vertex);
/* Errors: limit_memory, input_unsupported (too many triangles). */
bool linked_mesh_add(linked_mesh *l, const uint32_t corner[3], uint32_t *triangle, error *e);
bool linked_mesh_add_vertex(linked_mesh *l, vec3 place, uint32_t *vertex, error *e);

#endif

// SPDX-License-Identifier: Apache-2.0
#include "geometry/mesh/linked_mesh.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

static const char what[] = "the triangles of the mesh";

static void link_corner(linked_mesh *l, uint32_t c)
{
    const uint32_t v = l->m->triangle[c / 3][c % 3], first = l->head[v];
    l->next[c] = first;
    l->previous[c] = LINKED_MESH_NONE;
    if (first != LINKED_MESH_NONE) l->previous[first] = c;
    l->head[v] = c;
    l->degree[v]++;
}

static void unlink_corner(linked_mesh *l, uint32_t c)
{
    const uint32_t v = l->m->triangle[c / 3][c % 3], next = l->next[c], previous = l->previous[c];
    if (next != LINKED_MESH_NONE) l->previous[next] = previous;
    if (previous != LINKED_MESH_NONE)
        l->next[previous] = next;
    else
        l->head[v] = next;
    l->degree[v]--;
}

bool linked_mesh_begin(mesh *m, linked_mesh *out, error *e)
{
    linked_mesh l = {.m = m,
                     .triangle_room = m->triangle_count,
                     .next_room = 3 * m->triangle_count,
                     .previous_room = 3 * m->triangle_count,
                     .dead_room = m->triangle_count,
                     .vertex_room = m->vertex_count,
                     .head_room = m->vertex_count,
                     .degree_room = m->vertex_count};
    l.next = mem_array(l.next_room, sizeof *l.next, what, e);
    l.previous = mem_array(l.previous_room, sizeof *l.previous, what, e);
    l.head = mem_array(l.head_room, sizeof *l.head, what, e);
    l.degree = mem_array(l.degree_room, sizeof *l.degree, what, e);
    l.dead = mem_array(l.dead_room, sizeof *l.dead, what, e);
    if (!l.next || !l.previous || !l.head || !l.degree || !l.dead) {
        linked_mesh_end(&l);
        return false;
    }
    memset(l.head, 0xFF, m->vertex_count * sizeof *l.head);
    for (uint32_t t = 0; t < m->triangle_count; t++)
        for (uint32_t k = 0; k < 3 && linked_mesh_is_proper(m->triangle[t]); k++) link_corner(&l, 3 * t + k);
    *out = l;
    return true;
}

void linked_mesh_end(linked_mesh *l)
{
    size_t kept = 0;
    for (size_t t = 0; l->dead && t < l->m->triangle_count; t++)
        if (!l->dead[t]) memmove(l->m->triangle[kept++], l->m->triangle[t], sizeof l->m->triangle[0]);
    if (l->dead) l->m->triangle_count = kept;
    free(l->next);
    free(l->previous);
    free(l->head);
    free(l->degree);
    free(l->dead);
    *l = (linked_mesh){0};
}

void linked_mesh_drop(linked_mesh *l, uint32_t triangle)
{
    for (uint32_t k = 0; k < 3; k++) unlink_corner(l, 3 * triangle + k);
    l->dead[triangle] = true;
}

void linked_mesh_move(linked_mesh *l, uint32_t corner, uint32_t vertex)
{
    unlink_corner(l, corner);
    l->m->triangle[corner / 3][corner % 3] = vertex;
    link_corner(l, corner);
}

bool linked_mesh_add(linked_mesh *l, const uint32_t corner[3], uint32_t *triangle, error *e)
{
    const size_t n = l->m->triangle_count;
    if (n + 1 >= UINT32_MAX / 3)
        return error_set(e, ERROR_INPUT_UNSUPPORTED, "the mesh has too many triangles for 32 bits");
    if (!MEM_GROW(l->m->triangle, n, &l->triangle_room, what, e) ||
        !MEM_GROW(l->dead, n, &l->dead_room, what, e))
        return false;
    for (size_t k = 0; k < 3; k++)
        if (!MEM_GROW(l->next, 3 * n + k, &l->next_room, what, e) ||
            !MEM_GROW(l->previous, 3 * n + k, &l->previous_room, what, e))
            return false;
    memcpy(l->m->triangle[n], corner, sizeof *l->m->triangle);
    l->dead[n] = false;
    l->m->triangle_count++;
    *triangle = (uint32_t)n;
    for (uint32_t k = 0; k < 3; k++) link_corner(l, 3 * *triangle + k);
    return true;
}

bool linked_mesh_add_vertex(linked_mesh *l, vec3 place, uint32_t *vertex, error *e)
{
    const size_t n = l->m->vertex_count;
    if (n + 1 >= UINT32_MAX)
        return error_set(e, ERROR_INPUT_UNSUPPORTED, "the mesh has too many vertices for 32 bits");
    if (!MEM_GROW(l->m->vertex, n, &l->vertex_room, what, e) ||
        !MEM_GROW(l->head, n, &l->head_room, what, e) || !MEM_GROW(l->degree, n, &l->degree_room, what, e))
        return false;
    l->m->vertex[n] = place;
    l->head[n] = LINKED_MESH_NONE;
    l->degree[n] = 0;
    l->m->vertex_count++;
    *vertex = (uint32_t)n;
    return true;
}

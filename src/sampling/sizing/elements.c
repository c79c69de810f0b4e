// SPDX-License-Identifier: Apache-2.0
#include "sampling/sizing/elements.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"

/* The axis closest to a normal: 0 to 2 in its positive direction, 3 to 5 in its negative direction. */
static int direction_of(vec3 n)
{
    int axis = fabs(n.x) >= fabs(n.y) && fabs(n.x) >= fabs(n.z) ? 0 : fabs(n.y) >= fabs(n.z) ? 1 : 2;
    return vec3_get(n, axis) >= 0 ? axis : axis + 3;
}

elements_cube elements_cube_of(const elements *s, vec3 x)
{
    vec3 u = vec3_scale(vec3_sub(x, s->origin), 1 / s->edge);
    return (elements_cube){{(int32_t)floor(u.x), (int32_t)floor(u.y), (int32_t)floor(u.z)}};
}

uint32_t elements_find(const elements *s, vec3 x, vec3 normal, uint32_t patch)
{
    int direction = direction_of(normal);
    uint32_t k = elements_first_of(s, elements_cube_of(s, x), 0, 0, 0, patch);
    while (k != BLOCK_MAP_NONE && s->element[k].direction != direction) k = s->element[k].next_of_patch;
    return k;
}

/* The first element of a cube and a patch, for reading and writing. NULL: out of memory. */
static uint32_t *first_of_pair(elements *s, uint32_t cube, uint32_t patch, error *e)
{
    if (!s->by_patch) return &s->first[cube];
    uint32_t before = s->pairs.count, number;
    if (!block_map_find_or_add(&s->pairs, (int32_t)cube, (int32_t)patch, 0, &number, e)) return NULL;
    if (number == before) s->first_of_pair[number] = BLOCK_MAP_NONE;
    return &s->first_of_pair[number];
}

/* The element of a cube, a direction and a patch; created if it does not exist. */
static element *element_of(elements *s, vec3 position, vec3 normal, uint32_t patch, error *e)
{
    elements_cube at = elements_cube_of(s, position);
    uint32_t before = s->map.count, number;
    int direction = direction_of(normal);
    if (!block_map_find_or_add(&s->map, at.at[0], at.at[1], at.at[2], &number, e)) return NULL;
    if (number == before) s->first[number] = BLOCK_MAP_NONE;
    uint32_t *first = first_of_pair(s, number, patch, e);
    if (!first) return NULL;
    for (uint32_t k = *first; k != BLOCK_MAP_NONE; k = s->element[k].next_of_patch)
        if (s->element[k].direction == direction) return &s->element[k];
    element *n = &s->element[s->count];
    n->direction = direction;
    n->patch = patch;
    n->next = s->first[number];
    n->next_of_patch = *first;
    *first = s->first[number] = s->count++;
    return n;
}

/* Adds samples in the order of cells. */
bool elements_make(const surface *scan, const cell_samples *sample, double edge, elements *out, error *e)
{
    const char *what = "the surface's elements";
    elements *s = out;
    *s = (elements){.edge = edge, .origin = scan->box.min, .by_patch = scan->field->patches != NULL};
    if (!block_map_init(&s->map, scan->cells / 2, e)) return false;
    if (s->by_patch) {
        s->first_of_pair = mem_array(scan->cells, sizeof *s->first_of_pair, what, e);
        if (!s->first_of_pair || !block_map_init(&s->pairs, scan->cells / 2, e)) return false;
    }
    s->element = mem_array(scan->cells, sizeof *s->element, what, e);
    s->first = mem_array(scan->cells, sizeof *s->first, what, e);
    if (!s->element || !s->first) return false;
    for (size_t k = 0; k < scan->cells; k++) {
        double area = surface_cell_area(scan, k);
        if (!sample->found[k] || !(area > 0)) continue;
        element *n = element_of(s, sample->position[k], sample->normal[k], sample->patch[k], e);
        if (!n) return false;
        n->area += area;
        n->position = vec3_axpy(area, sample->position[k], n->position);
        n->normal = vec3_axpy(area, sample->normal[k], n->normal);
    }
    for (uint32_t k = 0; k < s->count; k++) {
        element *n = &s->element[k];
        n->position = vec3_scale(n->position, 1 / n->area);
        n->normal = vec3_unit(n->normal);
    }
    return true;
}

void elements_free(elements *s)
{
    block_map_free(&s->map);
    free(s->element);
    free(s->first);
    block_map_free(&s->pairs);
    free(s->first_of_pair);
    *s = (elements){0};
}

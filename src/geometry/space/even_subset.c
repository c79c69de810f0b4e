// SPDX-License-Identifier: Apache-2.0
#include "geometry/space/even_subset.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

/* Points that are considered for each wanted one. More: smaller gaps between the chosen points, and more time. */
enum { CONSIDERED_FOR_EACH = 4 };

/* The number of chosen points, as a share of that in a hexagonal packing whose spacing is the reach: a value of random
 * sequential packings. Larger: fewer points are chosen. */
#define RANDOM_DENSITY 0.6

#define NONE UINT32_MAX

/* A chosen point; positions are relative to the first point. */
typedef struct chosen_point {
    float x, y, z, nx, ny, nz, reach;
    uint32_t next; /* in the same list of the table */
} chosen_point;

/* The chosen points in lists by cubes. The edge of the cubes is 2 to 4 times the reach of a point, so that each reach has
 * cubes of its own. */
typedef struct chosen_table {
    chosen_point *point;
    size_t count, limit;
    uint32_t *head; /* lists of the hash table */
    uint32_t mask;
} chosen_table;

/* The cubes of a reach: floor(log2(reach)). */
static int level_of(float reach)
{
    uint32_t bits;
    memcpy(&bits, &reach, sizeof bits);
    return (int)(bits >> 23) - 127;
}

static float per_edge(int level)
{
    const uint32_t bits = (uint32_t)(125 - level) << 23; /* 2^(-level - 2) */
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* The largest integer up to x. */
static int floor_of(float x)
{
    const int i = (int)x;
    return i - (x < (float)i);
}

static uint32_t list_of(const chosen_table *t, int level, int x, int y, int z)
{
    uint64_t key = (uint32_t)x * UINT64_C(0x9E3779B97F4A7C15) ^ (uint32_t)y * UINT64_C(0xC2B2AE3D27D4EB4F) ^
                   (uint32_t)z * UINT64_C(0x165667B19E3779F9) ^
                   (uint32_t)level * UINT64_C(0x27D4EB2F165667C5);
    return (uint32_t)(key >> 40) & t->mask;
}

/* Whether a chosen point of this list is on the same side and nearer than the reach of q. */
static bool is_near(const chosen_table *t, uint32_t list, const chosen_point *q)
{
    for (uint32_t i = t->head[list]; i != NONE; i = t->point[i].next) {
        const chosen_point *c = &t->point[i];
        float dx = c->x - q->x, dy = c->y - q->y, dz = c->z - q->z;
        if (dx * dx + dy * dy + dz * dz < q->reach * q->reach &&
            c->nx * q->nx + c->ny * q->ny + c->nz * q->nz > 0)
            return true;
    }
    return false;
}

/* Whether a chosen point of this level is in the way of q. The cube of q is searched first. */
static bool is_blocked(const chosen_table *t, int level, const chosen_point *q)
{
    const float per = per_edge(level), reach = q->reach;
    const int x = floor_of(q->x * per), y = floor_of(q->y * per), z = floor_of(q->z * per);
    if (is_near(t, list_of(t, level, x, y, z), q)) return true;
    const int x0 = floor_of((q->x - reach) * per), x1 = floor_of((q->x + reach) * per),
              y0 = floor_of((q->y - reach) * per), y1 = floor_of((q->y + reach) * per),
              z0 = floor_of((q->z - reach) * per), z1 = floor_of((q->z + reach) * per);
    for (int k = z0; k <= z1; k++)
        for (int j = y0; j <= y1; j++)
            for (int i = x0; i <= x1; i++)
                if ((i != x || j != y || k != z) && is_near(t, list_of(t, level, i, j, k), q)) return true;
    return false;
}

/* Sizes of neighbours differ by less than a quarter, so the reach of a point nearby belongs to one of two levels. */
static bool is_free(const chosen_table *t, bool is_even, const chosen_point *q)
{
    const int level = level_of(q->reach), low = level_of(0.8f * q->reach), high = level_of(1.25f * q->reach);
    if (is_blocked(t, level, q)) return false;
    if (is_even || (low == level && high == level)) return true;
    return !is_blocked(t, low < level ? low : high, q);
}

static void add(chosen_table *t, const chosen_point *q)
{
    const int level = level_of(q->reach);
    const float per = per_edge(level);
    uint32_t list = list_of(t, level, floor_of(q->x * per), floor_of(q->y * per), floor_of(q->z * per));
    t->point[t->count] = *q;
    t->point[t->count].next = t->head[list];
    t->head[list] = (uint32_t)t->count++;
}

static chosen_point point_of(const even_subset_points *p, size_t i, double reach)
{
    const vec3 x = vec3_sub(p->position[i], p->position[0]), n = p->normal[i];
    return (chosen_point){.x = (float)x.x,
                          .y = (float)x.y,
                          .z = (float)x.z,
                          .nx = (float)n.x,
                          .ny = (float)n.y,
                          .nz = (float)n.z,
                          .reach = (float)(reach * (p->size ? p->size[i] : 1))};
}

bool even_subset_choose(const even_subset_points *p, size_t wanted, even_subset *s, error *e)
{
    const size_t most = CONSIDERED_FOR_EACH * wanted, step = (p->count + most - 1) / most;
    uint32_t lists = 1;
    while (lists < wanted) lists *= 2;
    chosen_table t = {.limit = 2 * wanted, .mask = lists - 1};
    *s = (even_subset){.reach = p->spacing * sqrt(RANDOM_DENSITY * (double)p->count / (double)wanted)};
    t.point = mem_array(t.limit, sizeof *t.point, "a subset of points", e);
    t.head = mem_array(lists, sizeof *t.head, "a subset of points", e);
    s->chosen = mem_array(t.limit, sizeof *s->chosen, "a subset of points", e);
    const bool ok = t.point && t.head && s->chosen;
    for (uint32_t i = 0; ok && i < lists; i++) t.head[i] = NONE;
    for (size_t i = 0; ok && i < p->count && t.count < t.limit; i += step) {
        const chosen_point q = point_of(p, i, s->reach);
        if (!is_free(&t, !p->size, &q)) continue;
        s->chosen[t.count] = (uint32_t)i;
        add(&t, &q);
    }
    s->count = t.count;
    free(t.point);
    free(t.head);
    return ok;
}

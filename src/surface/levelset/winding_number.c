// SPDX-License-Identifier: Apache-2.0
#include "surface/levelset/winding_number.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

enum { CHUNK = 4096 }; /* triangles, or lines, of a task */

static int64_t turn(const winding_point *a, const winding_point *b, int64_t x, int64_t y)
{
    return ((int64_t)b->x - a->x) * (y - a->y) - ((int64_t)b->y - a->y) * (x - a->x);
}

/* Whether (x + eps, y + eps^2) lies to the left of the edge from a to b, which has different ends. */
static bool is_left(const winding_point *a, const winding_point *b, int64_t turned)
{
    if (turned != 0) return turned > 0;
    return a->y != b->y ? b->y < a->y : b->x > a->x;
}

int winding_cross(const winding_point *a, const winding_point *b, const winding_point *c, int32_t x,
                  int32_t y, double *z)
{
    int64_t at_c = turn(a, b, x, y), at_a = turn(b, c, x, y), at_b = turn(c, a, x, y),
            area = at_a + at_b + at_c;
    if (area == 0) return 0;
    bool left = is_left(a, b, at_c);
    if (is_left(b, c, at_a) != left || is_left(c, a, at_b) != left) return 0;
    *z = ((double)at_a * a->z + (double)at_b * b->z + (double)at_c * c->z) / (double)area;
    return left ? 1 : -1;
}

static int32_t least(int32_t a, int32_t b, int32_t c)
{
    int32_t m = a < b ? a : b;
    return m < c ? m : c;
}

/* The range of lines that cross an interval, voxels; high < low: none. */
static void range_of(int32_t a, int32_t b, int32_t c, int32_t *low, int32_t *high)
{
    int32_t min = least(a, b, c), max = -least(-a, -b, -c);
    *low = (min + (1 << WINDING_BITS) - 1) >> WINDING_BITS;
    *high = max >> WINDING_BITS;
    if (*low < 0) *low = 0;
}

typedef struct crossing_job {
    winding_columns *columns;
    const mesh *m;
    const uint32_t *first_of_solid;
    bool place; /* store the crossings; false: count them */
} crossing_job;

/* Counts the crossings of one triangle in c->first, or stores them. */
static void scan_triangle(const crossing_job *s, const winding_point p[3], uint32_t solid)
{
    winding_columns *c = s->columns;
    int32_t x0, x1, y0, y1;
    range_of(p[0].x, p[1].x, p[2].x, &x0, &x1);
    range_of(p[0].y, p[1].y, p[2].y, &y0, &y1);
    for (int32_t x = x0; x <= x1; x++)
        for (int32_t y = y0; y <= y1; y++) {
            double z;
            int sign = winding_cross(&p[0], &p[1], &p[2], x << WINDING_BITS, y << WINDING_BITS, &z);
            if (!sign) continue;
            uint64_t *first = &c->first[(size_t)x * (size_t)c->ny + (size_t)y];
            const uint64_t at = __atomic_fetch_add(first, 1, __ATOMIC_RELAXED);
            if (s->place) c->crossings[at] = (crossing){z, solid, sign};
        }
}

static void scan_chunk(void *context, int worker, size_t begin, size_t end)
{
    const crossing_job *s = context;
    uint32_t solid = 0;
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        while (n >= s->first_of_solid[solid + 1]) solid++;
        const uint32_t *t = s->m->triangle[n];
        const vec3 *v = s->m->vertex;
        const winding_point p[3] = {winding_fix(v[t[0]]), winding_fix(v[t[1]]), winding_fix(v[t[2]])};
        scan_triangle(s, p, solid);
    }
}

static int by_solid_upwards(const void *left, const void *right)
{
    const crossing *a = left, *b = right;
    if (a->solid != b->solid) return a->solid < b->solid ? -1 : 1;
    return (a->z > b->z) - (a->z < b->z);
}

/* Sorts the crossings of each line, whose order depends on the threads. Crossings of one solid at one
 * height are equivalent in any order. */
static void sort_chunk(void *context, int worker, size_t begin, size_t end)
{
    const winding_columns *c = context;
    (void)worker;
    for (size_t n = begin; n < end; n++)
        qsort(c->crossings + c->first[n], c->first[n + 1] - c->first[n], sizeof *c->crossings,
              by_solid_upwards);
}

bool winding_make(const mesh *m, const uint32_t *first_of_solid, size_t solid_count, threads *pool,
                  size_t memory_limit, winding_columns *out, error *e)
{
    const winding_point high = winding_fix(bbox_of_points(m->vertex, m->vertex_count, pool).max);
    winding_columns c = {.nx = (high.x >> WINDING_BITS) + 1, .ny = (high.y >> WINDING_BITS) + 1};
    crossing_job s = {&c, m, first_of_solid, false};
    const size_t triangles = first_of_solid[solid_count];
    size_t lines = (size_t)c.nx * (size_t)c.ny;
    if ((lines + 1) * sizeof *c.first > memory_limit) goto too_large;
    if (!(c.first = mem_array(lines + 1, sizeof *c.first, "the lines through the mesh", e))) return false;
    threads_run(pool, triangles, CHUNK, scan_chunk, &s);
    uint64_t total = 0;
    for (size_t n = 0; n <= lines; n++) {
        uint64_t count = c.first[n];
        c.first[n] = total;
        total += count;
    }
    if (total > mem_left(memory_limit, (lines + 1) * sizeof *c.first) / sizeof *c.crossings) goto too_large;
    if (!(c.crossings = mem_array(total, sizeof *c.crossings, "the lines through the mesh", e))) {
        winding_free(&c);
        return false;
    }
    s.place = true;
    threads_run(pool, triangles, CHUNK, scan_chunk, &s); /* afterwards first[n] is the end of line n */
    memmove(c.first + 1, c.first, lines * sizeof *c.first);
    c.first[0] = 0;
    if (threads_stopped(pool)) { /* incomplete */
        winding_free(&c);
        return error_set(e, ERROR_CANCELLED, "stopped");
    }
    threads_run(pool, lines, CHUNK, sort_chunk, &c);
    *out = c;
    return true;
too_large:
    winding_free(&c);
    return error_set(e, ERROR_LIMIT_MEMORY,
                     "the %zu lines through its voxels need more than the limit of %zu MiB: raise "
                     "limits.memory_mb or use larger voxels",
                     lines, memory_limit >> 20);
}

void winding_free(winding_columns *c)
{
    free(c->first);
    free(c->crossings);
    *c = (winding_columns){0};
}

unsigned winding_inside(const winding_columns *c, uint32_t solid, bool by_parity, int32_t x, int32_t y,
                        int32_t z0)
{
    if (x < 0 || y < 0 || x >= c->nx || y >= c->ny) return 0;
    size_t line = (size_t)x * (size_t)c->ny + (size_t)y;
    uint64_t low = c->first[line], end = c->first[line + 1];
    for (uint64_t high = end; low < high;) { /* the first crossing of the solid */
        uint64_t middle = low + (high - low) / 2;
        if (c->crossings[middle].solid < solid)
            low = middle + 1;
        else
            high = middle;
    }
    unsigned inside = 0;
    int winding = 0, z = 0; /* minus the sum below z, which equals the sum above z */
    for (uint64_t n = low; z < 8; n++) {
        bool last = n == end || c->crossings[n].solid != solid;
        for (; z < 8 && (last || z0 + z < c->crossings[n].z); z++)
            inside |= (unsigned)(by_parity ? winding & 1 : winding != 0) << z;
        if (last) break;
        winding += by_parity ? 1 : c->crossings[n].sign;
    }
    return inside;
}

bool winding_covers(const winding_columns *c, const bool *by_parity, const uint32_t *stamp, uint32_t stamped,
                    const int32_t at[3])
{
    if (at[0] < 0 || at[1] < 0 || at[0] >= c->nx || at[1] >= c->ny) return false;
    size_t line = (size_t)at[0] * (size_t)c->ny + (size_t)at[1];
    for (uint64_t n = c->first[line]; n < c->first[line + 1];) {
        uint32_t solid = c->crossings[n].solid;
        int winding = 0, below = 0;
        for (; n < c->first[line + 1] && c->crossings[n].solid == solid; n++)
            if (c->crossings[n].z <= at[2]) {
                winding += c->crossings[n].sign;
                below++;
            }
        if ((by_parity[solid] ? below & 1 : winding != 0) && !(stamp && stamp[solid] == stamped)) return true;
    }
    return false;
}

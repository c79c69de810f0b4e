// SPDX-License-Identifier: Apache-2.0
#include "geometry/mesh/rounding.h"

#include <math.h>
#include <stdatomic.h>

#include "base/core/precision.h"

/* Unit roundoffs of floats and doubles. */
static const double of_float = 0x1p-24, of_double = 0x1p-53;
/* Rounding operations in an affine map of a coordinate: three products and three sums. */
static const double map_operations = 6;
/* The error of a map whose terms are as large as the largest coordinate of the mesh counts at most as this fraction of the
 * longest side of a triangle: a part that is far away does not make the triangles of the others flat. */
static const double of_side = 1e-6;
/* Triangles in a chunk of work. */
enum { CHUNK = 4096 };

typedef struct double_search {
    const mesh *m;
    atomic_bool has_double; /* a coordinate is not representable as a float */
} double_search;

double rounding_largest_coordinate(vec3 v)
{
    return fmax(fabs(v.x), fmax(fabs(v.y), fabs(v.z)));
}

static bool is_float(double value)
{
    return precision_as_float(value) == value;
}

static void look_chunk(void *context, int worker, size_t begin, size_t end)
{
    double_search *l = context;
    bool floats = true;
    (void)worker;
    for (size_t n = begin; n < end && floats; n++)
        for (int k = 0; k < 3; k++) {
            const vec3 v = l->m->vertex[l->m->triangle[n][k]];
            floats &= is_float(v.x) && is_float(v.y) && is_float(v.z);
        }
    if (!floats) atomic_store_explicit(&l->has_double, true, memory_order_relaxed);
}

rounding rounding_at_most(const mesh *m, threads *pool)
{
    const bbox box = mesh_box(m, pool);
    const double largest = fmax(rounding_largest_coordinate(box.min), rounding_largest_coordinate(box.max));
    return (rounding){.absolute = map_operations * of_double * largest, .relative = of_float};
}

rounding rounding_of(const mesh *m, threads *pool)
{
    double_search l = {.m = m};
    rounding r = rounding_at_most(m, pool);
    threads_run(pool, m->triangle_count, CHUNK, look_chunk, &l);
    if (l.has_double) r.relative = 0;
    return r;
}

double rounding_reach(const rounding *r, const vec3 corner[3])
{
    double largest = 0, longest = 0;
    for (int k = 0; k < 3; k++) {
        largest = fmax(largest, rounding_largest_coordinate(corner[k]));
        longest = fmax(longest, vec3_norm2(vec3_sub(corner[k], corner[(k + 1) % 3])));
    }
    const double own = (map_operations * of_double + r->relative) * largest;
    return 2 * sqrt(3) * (own + fmin(r->absolute, of_side * sqrt(longest)));
}

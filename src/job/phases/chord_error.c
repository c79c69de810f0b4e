// SPDX-License-Identifier: Apache-2.0
#include "job/phases/chord_error.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "surface/field/projection.h"

/* Triangles in a chunk of work. */
enum { GRAIN = 1024 };
/* Maximum number of steps of a projection, and its tolerances in spacings (projection_limits). The error of a
 * deviation is far below a thousandth of the spacing. */
enum { STEPS = 20 };
static const double ACCEPT = 1e-6, SHORTCUT = 1e-4;

typedef struct chord_job {
    const field *field;
    const vec3 *vertex;
    const uint32_t (*triangle)[3];
    double h;
    double *worst; /* of each chunk */
} chord_job;

/* The distance of x from the surface. INFINITY: unknown. */
static double distance_of(const chord_job *job, vec3 x, uint32_t *hint)
{
    const projection_limits limits = {STEPS, ACCEPT * job->h, SHORTCUT * job->h, SHORTCUT * job->h};
    vec3 place = x, normal;
    return projection_find_near(job->field, &limits, hint, &place, &normal) ? vec3_norm(vec3_sub(place, x))
                                                                            : INFINITY;
}

/* The place inside a triangle at which a quadratic function is largest that is 0 at the corners, and m[k] in the
 * middle of the side from corner k to the next one. False: the function is largest on a side. */
static bool find_peak(const vec3 corner[3], const double m[3], vec3 *out)
{
    const double mixed = m[1] + m[2] - m[0], det = 4 * m[1] * m[2] - mixed * mixed,
                 a = m[1] * (2 * m[2] - mixed) / det, b = m[2] * (2 * m[1] - mixed) / det;
    if (!(det > 0) || !(a > 0) || !(b > 0) || !(a + b < 1)) return false;
    *out =
        vec3_axpy(a, vec3_sub(corner[0], corner[2]), vec3_axpy(b, vec3_sub(corner[1], corner[2]), corner[2]));
    return true;
}

static double largest_of_triangle(const chord_job *job, const uint32_t t[3], uint32_t *hint)
{
    vec3 corner[3], peak;
    double m[3];
    for (int k = 0; k < 3; k++) corner[k] = job->vertex[t[k]];
    for (int k = 0; k < 3; k++)
        m[k] = distance_of(job, vec3_scale(vec3_add(corner[k], corner[(k + 1) % 3]), 0.5), hint);
    double largest = fmax(m[0], fmax(m[1], m[2]));
    if (find_peak(corner, m, &peak)) largest = fmax(largest, distance_of(job, peak, hint));
    return largest;
}

static void measure_chunk(void *context, int worker, size_t begin, size_t end)
{
    const chord_job *job = context;
    uint32_t hint = FIELD_NO_HINT;
    double worst = 0;
    (void)worker;
    for (size_t k = begin; k < end; k++)
        worst = fmax(worst, largest_of_triangle(job, job->triangle[k], &hint));
    job->worst[begin / GRAIN] = worst;
}

double chord_error_largest(const field *f, const vec3 *vertex, const uint32_t (*triangle)[3], size_t count,
                           double h, threads *pool)
{
    const size_t chunks = count / GRAIN + 1;
    chord_job job = {f, vertex, triangle, h, mem_alloc(chunks * sizeof *job.worst)};
    double worst = 0;
    threads_run(pool, count, GRAIN, measure_chunk, &job);
    for (size_t k = 0; k < chunks; k++) worst = fmax(worst, job.worst[k]);
    free(job.worst);
    return worst;
}

// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/registration.h"

#include <stdbool.h>
#include <stdlib.h>

#include "base/core/compare.h"
#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "geometry/space/cholesky.h"

/* Number of points that are used, evenly spaced by index. They determine the seven unknowns to a hundredth
 * of the rms distance. */
static const size_t SAMPLES = 10000;
/* Minimum number of points with a distance for the seven unknowns. */
static const size_t SAMPLES_LEAST = 20;
/* A weight is 1/2 at the Cauchy scale: CAUCHY_MEDIANS times the median distance, but at least CAUCHY_LEAST
 * spacings, because smaller distances are caused by changes of shape. */
static const double CAUCHY_MEDIANS = 1.5, CAUCHY_LEAST = 0.05;
/* Relative weight of the motion itself, as a regularisation: among equally good motions the smallest is
 * chosen. It reduces the estimated motion by a few 1e-4. */
static const double REST_WEIGHT = 1e-4;
/* If the remaining misfit exceeds this fraction of the misfit without motion, the result is the identity: if
 * the whole surface changes its shape, some motion always fits slightly better. */
static const double EXPLAINED = 0.5;
/* Maximum number of Gauss-Newton steps, and the length of a step, in spacings, below which the iteration
 * ends. */
enum { STEPS_MOST = 60 };
static const double STEP_LAST = 1e-6;
/* Below this angle (radians) the series of the rotation's coefficients is exact to rounding. */
static const double ANGLE_SMALL = 1e-4;

static vec3 rotate(vec3 rotation, vec3 v)
{
    double angle = vec3_norm(rotation);
    if (angle == 0) return v;
    const elementary_sines turn = elementary_sincos(angle);
    vec3 axis = vec3_scale(rotation, 1 / angle);
    vec3 turned = vec3_add(vec3_scale(v, turn.cos), vec3_scale(vec3_cross(axis, v), turn.sin));
    return vec3_axpy((1 - turn.cos) * vec3_dot(axis, v), axis, turned);
}

vec3 registration_apply(const registration *m, vec3 x)
{
    vec3 arm = vec3_scale(rotate(m->rotation, vec3_sub(x, m->centre)), elementary_exp(m->growth));
    return vec3_add(vec3_add(m->centre, m->translation), arm);
}

vec3 registration_turn(const registration *m, vec3 n)
{
    return rotate(m->rotation, n);
}

/* J: left Jacobian of the rotation, I + a [w] + b [w]^2. Changing the rotation vector by dw moves r by (J
 * dw) x r, so that the derivative along n is J^T (r x n). */
void registration_derive(const registration *m, vec3 x, vec3 along, double out[REGISTRATION_UNKNOWNS])
{
    vec3 w = m->rotation, arm = vec3_scale(rotate(w, vec3_sub(x, m->centre)), elementary_exp(m->growth));
    double angle = vec3_norm(w), a = 0.5, b = 1.0 / 6;
    if (angle > ANGLE_SMALL) {
        a = (1 - elementary_cos(angle)) / (angle * angle);
        b = (angle - elementary_sin(angle)) / (angle * angle * angle);
    }
    vec3 torque = vec3_cross(arm, along), once = vec3_cross(w, torque);
    torque = vec3_axpy(b, vec3_cross(w, once), vec3_axpy(-a, once, torque));
    for (int axis = 0; axis < 3; axis++) {
        out[axis] = vec3_get(along, axis);
        out[3 + axis] = vec3_get(torque, axis);
    }
    out[6] = vec3_dot(along, arm);
}

/* The distance of a moved point to the surface. */
typedef struct residual {
    double distance; /* signed; INFINITY: the field is not defined there */
    vec3 normal;
} residual;

typedef struct fit {
    const field *f;
    const vec3 *x;
    uint32_t *hint; /* per used point, see `sample_near` in field_ops */
    size_t stride;  /* stride of the used points */
    size_t count;
    registration at;
    double size; /* rms distance of the points from their centre: converts rotation and growth to lengths */
    residual *residuals;
    double *sorted;
} fit;

static void sample_chunk(void *context, int worker, size_t begin, size_t end)
{
    fit *h = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        field_sample s;
        h->residuals[k].distance = INFINITY;
        const vec3 x = registration_apply(&h->at, h->x[k * h->stride]);
        if (!field_sample_near(h->f, x, FIELD_GRADIENT, &h->hint[k], &s)) continue;
        double length = vec3_norm(s.gradient);
        if (!(length > 0)) continue;
        h->residuals[k] = (residual){s.value / length, vec3_scale(s.gradient, 1 / length)};
    }
}

/* Finds the median distance. Returns the number of points that have one. */
static size_t find_median(fit *h, double *median)
{
    size_t found = 0;
    for (size_t k = 0; k < h->count; k++)
        if (h->residuals[k].distance != INFINITY) h->sorted[found++] = fabs(h->residuals[k].distance);
    qsort(h->sorted, found, sizeof *h->sorted, compare_doubles);
    *median = found > 0 ? h->sorted[found / 2] : INFINITY;
    return found;
}

/* Misfit of the motion, 0 to 1. Distances far beyond `scale` count as missing. */
static double misfit(const fit *h, double scale)
{
    double sum = 0;
    for (size_t k = 0; k < h->count; k++) {
        double r = h->residuals[k].distance;
        sum += r == INFINITY ? 1 : r * r / (r * r + scale * scale);
    }
    return sum / (double)h->count;
}

/* The normal equations of the weighted distances, with all unknowns scaled to lengths. A weight is 1/2 at
 * `cauchy_scale`. */
static void set_up(const fit *h, double cauchy_scale, double a[REGISTRATION_UNKNOWNS][REGISTRATION_UNKNOWNS],
                   double b[REGISTRATION_UNKNOWNS])
{
    const vec3 t = h->at.translation, w = h->at.rotation;
    const double unknown[] = {
        t.x, t.y, t.z, w.x * h->size, w.y * h->size, w.z * h->size, h->at.growth * h->size};
    double weights = 0;
    for (int i = 0; i < REGISTRATION_UNKNOWNS; i++) {
        b[i] = 0;
        for (int j = 0; j < REGISTRATION_UNKNOWNS; j++) a[i][j] = 0;
    }
    for (size_t k = 0; k < h->count; k++) {
        double r = h->residuals[k].distance, d[REGISTRATION_UNKNOWNS];
        if (r == INFINITY) continue;
        double weight = 1 / (1 + r * r / (cauchy_scale * cauchy_scale));
        registration_derive(&h->at, h->x[k * h->stride], h->residuals[k].normal, d);
        for (int i = 3; i < REGISTRATION_UNKNOWNS; i++) d[i] /= h->size;
        weights += weight;
        for (int i = 0; i < REGISTRATION_UNKNOWNS; i++) {
            b[i] -= weight * r * d[i];
            for (int j = 0; j <= i; j++) a[i][j] += weight * d[i] * d[j];
        }
    }
    for (int i = 0; i < REGISTRATION_UNKNOWNS; i++) {
        a[i][i] += REST_WEIGHT * weights;
        b[i] -= REST_WEIGHT * weights * unknown[i];
    }
}

/* One Gauss-Newton step. Returns its length. */
static double step(fit *h, double cauchy_scale)
{
    double a[REGISTRATION_UNKNOWNS][REGISTRATION_UNKNOWNS], b[REGISTRATION_UNKNOWNS], length2 = 0;
    set_up(h, cauchy_scale, a, b);
    cholesky_solve(&a[0][0], REGISTRATION_UNKNOWNS, REGISTRATION_UNKNOWNS, b);
    h->at.translation = vec3_add(h->at.translation, vec3_make(b[0], b[1], b[2]));
    h->at.rotation = vec3_axpy(1 / h->size, vec3_make(b[3], b[4], b[5]), h->at.rotation);
    h->at.growth += b[6] / h->size;
    for (int i = 0; i < REGISTRATION_UNKNOWNS; i++) length2 += b[i] * b[i];
    return sqrt(length2);
}

static registration find_motion(fit *h, double spacing, threads *pool)
{
    registration rest = h->at;
    threads_run(pool, h->count, 256, sample_chunk, h);
    double before = misfit(h, spacing), median;
    for (int k = 0; k < STEPS_MOST && find_median(h, &median) >= SAMPLES_LEAST; k++) {
        double length = step(h, fmax(CAUCHY_MEDIANS * median, CAUCHY_LEAST * spacing));
        threads_run(pool, h->count, 256, sample_chunk, h);
        if (!(length > STEP_LAST * spacing)) break;
    }
    return misfit(h, spacing) < EXPLAINED * before ? h->at : rest;
}

registration registration_find(const field *f, const vec3 *x, size_t count, double spacing, threads *pool)
{
    fit h = {.f = f, .x = x, .stride = (count + SAMPLES - 1) / SAMPLES};
    double squares = 0;
    if (count == 0) return h.at;
    h.count = (count - 1) / h.stride + 1;
    for (size_t k = 0; k < h.count; k++)
        h.at.centre = vec3_axpy(1 / (double)h.count, x[k * h.stride], h.at.centre);
    for (size_t k = 0; k < h.count; k++) squares += vec3_norm2(vec3_sub(x[k * h.stride], h.at.centre));
    h.size = sqrt(squares / (double)h.count);
    if (!(h.size > 0)) return h.at;
    h.residuals = mem_alloc(h.count * sizeof *h.residuals);
    h.sorted = mem_alloc(h.count * sizeof *h.sorted);
    h.hint = mem_alloc(h.count * sizeof *h.hint);
    for (size_t k = 0; k < h.count; k++) h.hint[k] = FIELD_NO_HINT;
    registration found = find_motion(&h, spacing, pool);
    free(h.residuals);
    free(h.sorted);
    free(h.hint);
    return found;
}

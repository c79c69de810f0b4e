#include "field/spline.h"

#include <string.h>

/* The arithmetic is in doubles whatever the coefficients are. In floats it is a quarter faster, but the
 * value then jitters by some 1e-7 of the coefficients, and a minimiser that compares energies to ten
 * digits and differences of values sees that jitter. */
typedef double lanes __attribute__((vector_size(32)));
typedef float narrow __attribute__((vector_size(16)));

/* The coefficients of a cell: one of the two pointers. A constant where the functions below are expanded, so
 * that nothing is decided at run time. */
typedef struct support {
    const float *single;
    const double *wide;
    size_t row, slab;
} support;

/* Vectors go by pointer: passed by value, they have one ABI with AVX and another without. */
ISA_INLINE void load_rows(const support *s, int i, lanes rows[4])
{
    for (int j = 0; j < 4; j++) {
        size_t at = (size_t)i * s->slab + (size_t)j * s->row;
        if (s->wide) {
            memcpy(&rows[j], s->wide + at, sizeof rows[j]);
        } else {
            narrow n;
            memcpy(&n, s->single + at, sizeof n);
            rows[j] = __builtin_convertvector(n, lanes);
        }
    }
}

ISA_INLINE double dot(const lanes *a, const lanes *b)
{
    lanes p = *a * *b;
    return (p[0] + p[1]) + (p[2] + p[3]);
}

ISA_INLINE void value_weights(double t, double w[4])
{
    double s = 1 - t;
    w[0] = s * s * s * (1.0 / 6);
    w[1] = (4 + t * t * (3 * t - 6)) * (1.0 / 6);
    w[2] = (4 + s * s * (3 * s - 6)) * (1.0 / 6);
    w[3] = t * t * t * (1.0 / 6);
}

ISA_INLINE void slope_weights(double t, double w[4])
{
    double s = 1 - t;
    w[0] = -0.5 * s * s;
    w[1] = t * (1.5 * t - 2);
    w[2] = -s * (1.5 * s - 2);
    w[3] = 0.5 * t * t;
}

ISA_INLINE void bend_weights(double t, double w[4])
{
    w[0] = 1 - t;
    w[1] = 3 * t - 2;
    w[2] = 1 - 3 * t;
    w[3] = t;
}

ISA_INLINE void gradient(const support *c, const double t[3], spline_jet *out)
{
    double vx[4], vy[4], sx[4], sy[4];
    lanes vz, sz, value = {0}, along_x = {0}, along_y = {0};
    value_weights(t[0], vx);
    value_weights(t[1], vy);
    value_weights(t[2], (double *)&vz);
    slope_weights(t[0], sx);
    slope_weights(t[1], sy);
    slope_weights(t[2], (double *)&sz);
#pragma GCC unroll 4
    for (int i = 0; i < 4; i++) {
        lanes r[4];
        load_rows(c, i, r);
        lanes v = r[0] * vy[0] + r[1] * vy[1] + r[2] * vy[2] + r[3] * vy[3];
        lanes s = r[0] * sy[0] + r[1] * sy[1] + r[2] * sy[2] + r[3] * sy[3];
        value += v * vx[i];
        along_x += v * sx[i];
        along_y += s * vx[i];
    }
    out->f = dot(&value, &vz);
    out->d[0] = dot(&along_x, &vz);
    out->d[1] = dot(&along_y, &vz);
    out->d[2] = dot(&value, &sz);
}

ISA_INLINE void hessian(const support *c, const double t[3], spline_jet *out)
{
    double vx[4], vy[4], sx[4], sy[4], bx[4], by[4];
    lanes vz, sz, bz, vv = {0}, sv = {0}, vs = {0}, ss = {0}, bv = {0}, vb = {0};
    value_weights(t[0], vx);
    value_weights(t[1], vy);
    value_weights(t[2], (double *)&vz);
    slope_weights(t[0], sx);
    slope_weights(t[1], sy);
    slope_weights(t[2], (double *)&sz);
    bend_weights(t[0], bx);
    bend_weights(t[1], by);
    bend_weights(t[2], (double *)&bz);
#pragma GCC unroll 4
    for (int i = 0; i < 4; i++) {
        lanes r[4];
        load_rows(c, i, r);
        lanes v = r[0] * vy[0] + r[1] * vy[1] + r[2] * vy[2] + r[3] * vy[3];
        lanes s = r[0] * sy[0] + r[1] * sy[1] + r[2] * sy[2] + r[3] * sy[3];
        lanes b = r[0] * by[0] + r[1] * by[1] + r[2] * by[2] + r[3] * by[3];
        vv += v * vx[i];
        sv += v * sx[i];
        bv += v * bx[i];
        vs += s * vx[i];
        ss += s * sx[i];
        vb += b * vx[i];
    }
    out->f = dot(&vv, &vz);
    out->d[0] = dot(&sv, &vz);
    out->d[1] = dot(&vs, &vz);
    out->d[2] = dot(&vv, &sz);
    out->xx = dot(&bv, &vz);
    out->yy = dot(&vb, &vz);
    out->zz = dot(&vv, &bz);
    out->xy = dot(&ss, &vz);
    out->xz = dot(&sv, &sz);
    out->yz = dot(&vs, &sz);
}

#define VERSION(isa, target)                                                                                 \
    target static void gradient_##isa(const float *corner, size_t row, size_t slab, const double t[3],       \
                                      spline_jet *out)                                                       \
    {                                                                                                        \
        gradient(&(support){corner, NULL, row, slab}, t, out);                                               \
    }                                                                                                        \
    target static void hessian_##isa(const float *corner, size_t row, size_t slab, const double t[3],        \
                                     spline_jet *out)                                                        \
    {                                                                                                        \
        hessian(&(support){corner, NULL, row, slab}, t, out);                                                \
    }                                                                                                        \
    target static void gradient_wide_##isa(const double *corner, size_t row, size_t slab, const double t[3], \
                                           spline_jet *out)                                                  \
    {                                                                                                        \
        gradient(&(support){NULL, corner, row, slab}, t, out);                                               \
    }                                                                                                        \
    target static void hessian_wide_##isa(const double *corner, size_t row, size_t slab, const double t[3],  \
                                          spline_jet *out)                                                   \
    {                                                                                                        \
        hessian(&(support){NULL, corner, row, slab}, t, out);                                                \
    }                                                                                                        \
    static const spline version_##isa = {gradient_##isa, hessian_##isa, gradient_wide_##isa,                 \
                                         hessian_wide_##isa};
VERSION(portable, )
VERSION(avx2, ISA_TARGET_AVX2)

/* A cell's rows have four coefficients: wider vectors have nothing to hold. */
const spline *spline_for(isa which)
{
    return which == ISA_PORTABLE ? &version_portable : &version_avx2;
}

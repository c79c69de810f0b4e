// SPDX-License-Identifier: Apache-2.0
/* spline_cell: the functions that spline.c compiles once for each instruction set. VERSION(name): the name
 * for that set. VERSION_WIDEN(n): converts four floats to doubles. VERSION_ROWS: rows of four floats in a
 * vector. It is included several times by spline.c only and has no include guard. Inlining generic functions
 * into one compiled for a wider instruction set would not work: the compiler has then split their vectors
 * already.
 */

/* Vectors are passed by pointer: by value, the ABI with AVX differs from that without. */
static inline __attribute__((always_inline)) void VERSION(load_rows)(const support *s, int i, lanes rows[4])
{
    for (int j = 0; j < 4; j++) {
        size_t at = (size_t)i * s->slab + (size_t)j * s->row;
        if (s->wide) {
            memcpy(&rows[j], s->wide + at, sizeof rows[j]);
        } else {
            narrow n;
            memcpy(&n, s->single + at, sizeof n);
            rows[j] = VERSION_WIDEN(n);
        }
    }
}

static inline double VERSION(dot)(const lanes *a, const lanes *b)
{
    lanes p = *a * *b;
    return (p[0] + p[1]) + (p[2] + p[3]);
}

static inline void VERSION(value_weights)(double t, double w[4])
{
    double s = 1 - t;
    w[0] = s * s * s * (1.0 / 6);
    w[1] = (4 + t * t * (3 * t - 6)) * (1.0 / 6);
    w[2] = (4 + s * s * (3 * s - 6)) * (1.0 / 6);
    w[3] = t * t * t * (1.0 / 6);
}

static inline void VERSION(slope_weights)(double t, double w[4])
{
    double s = 1 - t;
    w[0] = -0.5 * s * s;
    w[1] = t * (1.5 * t - 2);
    w[2] = -s * (1.5 * s - 2);
    w[3] = 0.5 * t * t;
}

static inline void VERSION(bend_weights)(double t, double w[4])
{
    w[0] = 1 - t;
    w[1] = 3 * t - 2;
    w[2] = 1 - 3 * t;
    w[3] = t;
}

/* `bends`: second derivatives are computed, too. It is a constant, so that a call without them does no work
 * for them. */
static inline __attribute__((always_inline)) void VERSION(jet)(const support *c, const double t[3],
                                                               bool bends, spline_jet *out)
{
    double vx[4], vy[4], sx[4], sy[4], bx[4] = {0}, by[4] = {0};
    lanes vz, sz, bz = {0}, vv = {0}, sv = {0}, vs = {0}, ss = {0}, bv = {0}, vb = {0};
    VERSION(value_weights)(t[0], vx);
    VERSION(value_weights)(t[1], vy);
    VERSION(value_weights)(t[2], (double *)&vz);
    VERSION(slope_weights)(t[0], sx);
    VERSION(slope_weights)(t[1], sy);
    VERSION(slope_weights)(t[2], (double *)&sz);
    if (bends) {
        VERSION(bend_weights)(t[0], bx);
        VERSION(bend_weights)(t[1], by);
        VERSION(bend_weights)(t[2], (double *)&bz);
    }
#pragma GCC unroll 4
    for (int i = 0; i < 4; i++) {
        lanes r[4];
        VERSION(load_rows)(c, i, r);
        lanes v = r[0] * vy[0] + r[1] * vy[1] + r[2] * vy[2] + r[3] * vy[3];
        lanes s = r[0] * sy[0] + r[1] * sy[1] + r[2] * sy[2] + r[3] * sy[3];
        vv += v * vx[i];
        sv += v * sx[i];
        vs += s * vx[i];
        if (!bends) continue;
        const lanes b = r[0] * by[0] + r[1] * by[1] + r[2] * by[2] + r[3] * by[3];
        bv += v * bx[i];
        ss += s * sx[i];
        vb += b * vx[i];
    }
    out->f = VERSION(dot)(&vv, &vz);
    out->d[0] = VERSION(dot)(&sv, &vz);
    out->d[1] = VERSION(dot)(&vs, &vz);
    out->d[2] = VERSION(dot)(&vv, &sz);
    if (!bends) return;
    out->xx = VERSION(dot)(&bv, &vz);
    out->yy = VERSION(dot)(&vb, &vz);
    out->zz = VERSION(dot)(&vv, &bz);
    out->xy = VERSION(dot)(&ss, &vz);
    out->xz = VERSION(dot)(&sv, &sz);
    out->yz = VERSION(dot)(&vs, &sz);
}

static void VERSION(gradient_single)(const float *corner, size_t row, size_t slab, const double t[3],
                                     spline_jet *out)
{
    VERSION(jet)(&(support){corner, NULL, row, slab}, t, false, out);
}

static void VERSION(hessian_single)(const float *corner, size_t row, size_t slab, const double t[3],
                                    spline_jet *out)
{
    VERSION(jet)(&(support){corner, NULL, row, slab}, t, true, out);
}

static void VERSION(gradient_wide)(const double *corner, size_t row, size_t slab, const double t[3],
                                   spline_jet *out)
{
    VERSION(jet)(&(support){NULL, corner, row, slab}, t, false, out);
}

static void VERSION(hessian_wide)(const double *corner, size_t row, size_t slab, const double t[3],
                                  spline_jet *out)
{
    VERSION(jet)(&(support){NULL, corner, row, slab}, t, true, out);
}

/* ---- lanes, in single precision: VERSION_ROWS of a layer's four rows in one vector */

typedef float VERSION(rows) __attribute__((vector_size(16 * VERSION_ROWS)));

/* The four weights along an axis and their derivatives, in one vector where it is wide enough. */
static inline __attribute__((always_inline)) void VERSION(weigh)(float t, narrow *value, narrow *slope)
{
    const cubic *of = weight_cubics;
#if VERSION_ROWS == 1
    const narrow at = {t, t, t, t};
    *value = ((of[3].value * at + of[2].value) * at + of[1].value) * at + of[0].value;
    *slope = ((of[3].slope * at + of[2].slope) * at + of[1].slope) * at + of[0].slope;
#else
    const VERSION(rows) at = {t, t, t, t, t, t, t, t};
    VERSION(rows) c[4], both;
    memcpy(c, of, sizeof c);
    both = ((c[3] * at + c[2]) * at + c[1]) * at + c[0];
    *value = __builtin_shufflevector(both, both, 0, 1, 2, 3);
    *slope = __builtin_shufflevector(both, both, 4, 5, 6, 7);
#endif
}

/* The weights along the last axis, repeated for each row; and each weight along the second axis, repeated for
 * the length of a row. */
static inline __attribute__((always_inline)) void
VERSION(spread)(const narrow *along_row, const narrow *across, VERSION(rows) * repeated, VERSION(rows) * each)
{
    const narrow a = *along_row, w = *across;
#if VERSION_ROWS == 1
    *repeated = a;
    for (int k = 0; k < 4; k++) each[k] = (narrow){w[k], w[k], w[k], w[k]};
#else
    *repeated = __builtin_shufflevector(a, a, 0, 1, 2, 3, 4, 5, 6, 7);
    each[0] = __builtin_shufflevector(w, w, 0, 0, 0, 0, 1, 1, 1, 1);
    each[1] = __builtin_shufflevector(w, w, 2, 2, 2, 2, 3, 3, 3, 3);
#endif
}

/* Loads VERSION_ROWS rows of a layer. */
static inline __attribute__((always_inline)) void VERSION(load_part)(const float *at, size_t row,
                                                                     VERSION(rows) * out)
{
    narrow r[VERSION_ROWS];
    for (size_t k = 0; k < VERSION_ROWS; k++) memcpy(&r[k], at + k * row, sizeof r[k]);
#if VERSION_ROWS == 1
    *out = r[0];
#else
    *out = __builtin_shufflevector(r[0], r[1], 0, 1, 2, 3, 4, 5, 6, 7);
#endif
}

/* The sum over the four rows in `part`; rows 0 and 2, and rows 1 and 3, are added first. */
static inline __attribute__((always_inline)) void VERSION(fold)(const VERSION(rows) * part, narrow *out)
{
#if VERSION_ROWS == 1
    *out = (part[0] + part[2]) + (part[1] + part[3]);
#else
    VERSION(rows) sum = part[0] + part[1];
    *out = __builtin_shufflevector(sum, sum, 0, 1, 2, 3) + __builtin_shufflevector(sum, sum, 4, 5, 6, 7);
#endif
}

/* The sums over the entries of four vectors; pairs are added first. */
static inline __attribute__((always_inline)) void VERSION(sum_each)(const narrow v[4], narrow *out)
{
    narrow low =
        __builtin_shufflevector(v[0], v[1], 0, 2, 4, 6) + __builtin_shufflevector(v[0], v[1], 1, 3, 5, 7);
    narrow high =
        __builtin_shufflevector(v[2], v[3], 0, 2, 4, 6) + __builtin_shufflevector(v[2], v[3], 1, 3, 5, 7);
    *out = __builtin_shufflevector(low, high, 0, 2, 4, 6) + __builtin_shufflevector(low, high, 1, 3, 5, 7);
}

/* The sums over the four layers along the first axis, of the values and of their derivatives. */
typedef struct VERSION(sums) {
    VERSION(rows) value[4 / VERSION_ROWS], along_x[4 / VERSION_ROWS];
} VERSION(sums);

static inline __attribute__((always_inline)) void
VERSION(sum_layers)(const float *corner, float t, size_t row, size_t slab, VERSION(sums) * out)
{
    narrow w, s;
    VERSION(weigh)(t, &w, &s);
#pragma GCC unroll 4
    for (size_t p = 0; p < 4 / VERSION_ROWS; p++) {
        VERSION(rows) value = {0}, along_x = {0};
#pragma GCC unroll 4
        for (size_t i = 0; i < 4; i++) {
            VERSION(rows) r;
            VERSION(load_part)(corner + i * slab + VERSION_ROWS * p * row, row, &r);
            value += r * w[i];
            along_x += r * s[i];
        }
        out->value[p] = value;
        out->along_x[p] = along_x;
    }
}

/* F and its derivatives in one lane. */
static inline __attribute__((always_inline)) void VERSION(lane)(const VERSION(sums) * along, float t1,
                                                                float t2, narrow *out)
{
    enum { PARTS = 4 / VERSION_ROWS };
    narrow w[2], s[2], sums[4];
    VERSION(rows) wz, sz, wy[PARTS], sy[PARTS], sum[4][PARTS];
    VERSION(weigh)(t1, &w[0], &s[0]);
    VERSION(weigh)(t2, &w[1], &s[1]);
    VERSION(spread)(&w[1], &w[0], &wz, wy);
    VERSION(spread)(&s[1], &s[0], &sz, sy);
#pragma GCC unroll 4
    for (size_t p = 0; p < PARTS; p++) {
        const VERSION(rows) yz = wy[p] * wz;
        sum[0][p] = along->value[p] * yz;
        sum[1][p] = along->along_x[p] * yz;
        sum[2][p] = along->value[p] * (sy[p] * wz);
        sum[3][p] = along->value[p] * (wy[p] * sz);
    }
#pragma GCC unroll 4
    for (int k = 0; k < 4; k++) VERSION(fold)(sum[k], &sums[k]);
    VERSION(sum_each)(sums, out);
}

/* Consecutive lanes with the same cell and first coordinate share the sums along the first axis. */
static void VERSION(gradient_lanes)(spline_lanes *places, size_t row, size_t slab)
{
    const float *corner = NULL;
    float t = 0;
    VERSION(sums) along = {.value = {{0}}};
    for (int l = 0; l < VEC3_LANES; l++) {
        narrow jet = {0};
        if (places->corner[l] && (places->corner[l] != corner || places->t[0][l] != t)) {
            corner = places->corner[l];
            t = places->t[0][l];
            VERSION(sum_layers)(corner, t, row, slab, &along);
        }
        if (places->corner[l]) VERSION(lane)(&along, places->t[1][l], places->t[2][l], &jet);
        places->f[l] = jet[0];
        for (int axis = 0; axis < 3; axis++) places->d[axis][l] = jet[axis + 1];
    }
}

static const spline VERSION(version) = {VERSION(gradient_single), VERSION(hessian_single),
                                        VERSION(gradient_lanes), VERSION(gradient_wide),
                                        VERSION(hessian_wide)};

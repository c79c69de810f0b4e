/* spline_cell: what spline.c compiles once for each instruction set, with VERSION(name) the name that it
 * has there and VERSION_WIDEN(n) that turns four floats into doubles. Not a header for others, and without
 * a guard: it is included again and again. A function that is inlined into one for a wider instruction set
 * would not do: its vectors have been cut into narrow ones by then. */

/* Vectors go by pointer: passed by value, they have one ABI with AVX and another without. */
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

static inline __attribute__((always_inline)) void VERSION(gradient)(const support *c, const double t[3],
                                                                    spline_jet *out)
{
    double vx[4], vy[4], sx[4], sy[4];
    lanes vz, sz, value = {0}, along_x = {0}, along_y = {0};
    VERSION(value_weights)(t[0], vx);
    VERSION(value_weights)(t[1], vy);
    VERSION(value_weights)(t[2], (double *)&vz);
    VERSION(slope_weights)(t[0], sx);
    VERSION(slope_weights)(t[1], sy);
    VERSION(slope_weights)(t[2], (double *)&sz);
#pragma GCC unroll 4
    for (int i = 0; i < 4; i++) {
        lanes r[4];
        VERSION(load_rows)(c, i, r);
        lanes v = r[0] * vy[0] + r[1] * vy[1] + r[2] * vy[2] + r[3] * vy[3];
        lanes s = r[0] * sy[0] + r[1] * sy[1] + r[2] * sy[2] + r[3] * sy[3];
        value += v * vx[i];
        along_x += v * sx[i];
        along_y += s * vx[i];
    }
    out->f = VERSION(dot)(&value, &vz);
    out->d[0] = VERSION(dot)(&along_x, &vz);
    out->d[1] = VERSION(dot)(&along_y, &vz);
    out->d[2] = VERSION(dot)(&value, &sz);
}

static inline __attribute__((always_inline)) void VERSION(hessian)(const support *c, const double t[3],
                                                                   spline_jet *out)
{
    double vx[4], vy[4], sx[4], sy[4], bx[4], by[4];
    lanes vz, sz, bz, vv = {0}, sv = {0}, vs = {0}, ss = {0}, bv = {0}, vb = {0};
    VERSION(value_weights)(t[0], vx);
    VERSION(value_weights)(t[1], vy);
    VERSION(value_weights)(t[2], (double *)&vz);
    VERSION(slope_weights)(t[0], sx);
    VERSION(slope_weights)(t[1], sy);
    VERSION(slope_weights)(t[2], (double *)&sz);
    VERSION(bend_weights)(t[0], bx);
    VERSION(bend_weights)(t[1], by);
    VERSION(bend_weights)(t[2], (double *)&bz);
#pragma GCC unroll 4
    for (int i = 0; i < 4; i++) {
        lanes r[4];
        VERSION(load_rows)(c, i, r);
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
    out->f = VERSION(dot)(&vv, &vz);
    out->d[0] = VERSION(dot)(&sv, &vz);
    out->d[1] = VERSION(dot)(&vs, &vz);
    out->d[2] = VERSION(dot)(&vv, &sz);
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
    VERSION(gradient)(&(support){corner, NULL, row, slab}, t, out);
}

static void VERSION(hessian_single)(const float *corner, size_t row, size_t slab, const double t[3],
                                    spline_jet *out)
{
    VERSION(hessian)(&(support){corner, NULL, row, slab}, t, out);
}

static void VERSION(gradient_wide)(const double *corner, size_t row, size_t slab, const double t[3],
                                   spline_jet *out)
{
    VERSION(gradient)(&(support){NULL, corner, row, slab}, t, out);
}

static void VERSION(hessian_wide)(const double *corner, size_t row, size_t slab, const double t[3],
                                  spline_jet *out)
{
    VERSION(hessian)(&(support){NULL, corner, row, slab}, t, out);
}

static const spline VERSION(version) = {VERSION(gradient_single), VERSION(hessian_single),
                                        VERSION(gradient_wide), VERSION(hessian_wide)};

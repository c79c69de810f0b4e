// SPDX-License-Identifier: Apache-2.0
#include "surface/triangles/jet.h"

#include <math.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/isa.h"

/* The number of columns of degree 2 and less: 1, u, v, u^2, u v, v^2. */
enum { UU = 3, UV, VV, SQUARES };
/* Maximum square of the distance of a column, of norm 1, from the span of those before it that counts as 0: the
 * rounding error of the normal equations. */
static const double DEPENDENT = 1e-10;

/* Sums over the rows: moment[a][b] of weight^2 u^a v^b, and height[a][b] of weight w u^a v^b. The matrix of the normal
 * equations consists of these moments. */
typedef struct sums {
    jet_numbers moment[2 * JET_DEGREE + 1][2 * JET_DEGREE + 1], height[JET_DEGREE + 1][JET_DEGREE + 1];
} sums;

/* Adds up `first` times v^b for the powers of u up to `most`, a constant, and multiplies `first` by v. */
ISA_INLINE void add_up(jet_numbers *first, const jet_lanes *j, int rows, int most, jet_numbers *sum,
                       int stride)
{
    jet_numbers all[2 * JET_DEGREE + 1] = {{0}};
    for (int r = 0; r < rows; r++) {
        jet_numbers power = first[r];
        for (int a = 0; a <= most; a++) {
            all[a] += power;
            power *= j->u[r];
        }
        first[r] *= j->v[r];
    }
    for (int a = 0; a <= most; a++) sum[a * stride] = all[a];
}

ISA_INLINE void sum_rows(const jet_lanes *j, int rows, sums *out)
{
    jet_numbers first[JET_ROWS];
    for (int r = 0; r < rows; r++) first[r] = j->weight[r] * j->weight[r];
#pragma GCC unroll 9
    for (int b = 0; b <= 2 * JET_DEGREE; b++)
        add_up(first, j, rows, 2 * JET_DEGREE - b, &out->moment[0][b], 2 * JET_DEGREE + 1);
    for (int r = 0; r < rows; r++) first[r] = j->weight[r] * j->w[r];
#pragma GCC unroll 5
    for (int b = 0; b <= JET_DEGREE; b++)
        add_up(first, j, rows, JET_DEGREE - b, &out->height[0][b], JET_DEGREE + 1);
}

/* Fills in the upper triangle of the normal equations, whose columns have the norm 1. A column of zeros stays. */
ISA_INLINE void fill_equations(jet_lanes *j, const sums *s)
{
    jet_numbers over[JET_COLUMNS];
    for (int k = 0, m = 0; m <= JET_DEGREE; m++)
        for (int b = 0; b <= m; b++, k++) {
            const jet_numbers square = s->moment[2 * (m - b)][2 * b];
            for (int l = 0; l < JET_LANES; l++) {
                j->norm[k][l] = sqrt(square[l]);
                over[k][l] = square[l] > 0 ? 1 / j->norm[k][l] : 0;
            }
        }
    for (int k = 0, m = 0; m <= JET_DEGREE; m++)
        for (int b = 0; b <= m; b++, k++) {
            for (int c = 0, n = 0; n <= JET_DEGREE; n++)
                for (int d = 0; d <= n; d++, c++)
                    if (c >= k) j->factor[k][c] = s->moment[m - b + n - d][b + d] * over[k] * over[c];
            j->height[k] = s->height[m - b][b] * over[k];
        }
}

/* Eliminates row k from those below it: a step of Cholesky's factorisation. The row of a column that depends on the
 * columns before it becomes 0. */
ISA_INLINE void eliminate(jet_lanes *j, int k)
{
    for (int l = 0; l < JET_LANES; l++) {
        const double pivot = j->factor[k][k][l];
        const bool is_dependent = !(pivot > DEPENDENT);
        j->diagonal[k][l] = is_dependent ? 0 : sqrt(pivot);
        j->inverse[k][l] = is_dependent ? 0 : 1 / j->diagonal[k][l];
    }
    for (int c = k; c < JET_COLUMNS; c++) j->factor[k][c] *= j->inverse[k];
    j->height[k] *= j->inverse[k];
    for (int r = k + 1; r < JET_COLUMNS; r++) {
        const jet_numbers by = j->factor[k][r];
        for (int c = r; c < JET_COLUMNS; c++) j->factor[r][c] -= by * j->factor[k][c];
        j->height[r] -= by * j->height[k];
    }
}

ISA_CLONES void jet_factor(jet_lanes *j)
{
    sums s;
    sum_rows(j, j->rows, &s);
    fill_equations(j, &s);
    for (int k = 0; k < JET_COLUMNS; k++) eliminate(j, k);
}

double jet_condition(const jet_lanes *j, int lane, int degree)
{
    double least = INFINITY;
    for (int k = 0; k < jet_coefficients(degree); k++) least = fmin(least, j->diagonal[k][lane]);
    return least;
}

static jet jet_of(const double a[SQUARES])
{
    return (jet){a[0], a[1], a[2], 2 * a[UU], a[UV], 2 * a[VV]};
}

ISA_CLONES void jet_solve(const jet_lanes *j, int degree, jet out[JET_LANES])
{
    const int columns = jet_coefficients(degree);
    jet_numbers a[JET_COLUMNS];
    for (int k = columns - 1; k >= 0; k--) {
        a[k] = j->height[k];
        for (int c = k + 1; c < columns; c++) a[k] -= j->factor[k][c] * a[c];
        a[k] *= j->inverse[k];
    }
    for (int l = 0; l < JET_LANES; l++) {
        double own[SQUARES];
        for (int k = 0; k < SQUARES; k++) own[k] = a[k][l] / j->norm[k][l];
        out[l] = jet_of(own);
    }
}

/* ---- strips */

/* The direction, as cosine and sine, in which the second derivative is known least: that of the polynomial of
 * degree 2 which is smallest at the places, by inverse iteration with the factor R. */
static void least_known(const jet_lanes *j, int lane, double direction[2])
{
    static const double tiny = 1e-12; /* instead of a diagonal element of 0 */
    enum { ITERATIONS = 8 };
    double x[SQUARES] = {1, 1, 1, 1, 1, 1}, pivot[SQUARES];
    for (int k = 0; k < SQUARES; k++) pivot[k] = fmax(j->diagonal[k][lane], tiny);
    for (int step = 0; step < ITERATIONS; step++) {
        double size = 0;
        for (int k = 0; k < SQUARES; k++) {
            for (int i = 0; i < k; i++) x[k] -= j->factor[i][k][lane] * x[i];
            x[k] /= pivot[k];
        }
        for (int k = SQUARES - 1; k >= 0; k--) {
            for (int c = k + 1; c < SQUARES; c++) x[k] -= j->factor[k][c][lane] * x[c];
            x[k] /= pivot[k];
            size = fmax(size, fabs(x[k]));
        }
        for (int k = 0; k < SQUARES; k++) x[k] /= size;
    }
    const double uu = x[UU] / j->norm[UU][lane], uv = x[UV] / j->norm[UV][lane],
                 vv = x[VV] / j->norm[VV][lane];
    const elementary_sines turn =
        elementary_sincos(0.5 * (elementary_atan2(uv, uu - vv) + (uu + vv < 0 ? M_PI : 0)));
    direction[0] = turn.cos;
    direction[1] = turn.sin;
}

/* One system, whose dependent columns are left out. */
typedef struct strip {
    double column[JET_COLUMNS + 1][JET_ROWS], norm[JET_COLUMNS];
    int row[JET_COLUMNS]; /* of its diagonal element in R; -1: the column is left out */
    int taken;            /* columns */
} strip;

static double dot_from(const double *a, const double *b, int first, int rows)
{
    double sum = 0;
    for (int r = first; r < rows; r++) sum += a[r] * b[r];
    return sum;
}

/* Fills in the columns, with u along the direction. */
static void fill_strip(const jet_lanes *j, int lane, int columns, const double direction[2], strip *s)
{
    for (int r = 0; r < j->rows; r++) {
        const double u = direction[0] * j->u[r][lane] + direction[1] * j->v[r][lane],
                     v = direction[0] * j->v[r][lane] - direction[1] * j->u[r][lane];
        s->column[0][r] = j->weight[r][lane];
        s->column[JET_COLUMNS][r] = j->w[r][lane];
        for (int degree = 1, c = 1; c < columns; degree++, c++) {
            for (int k = 0; k < degree; k++, c++) s->column[c][r] = s->column[c - degree][r] * u;
            s->column[c][r] = s->column[c - degree - 1][r] * v;
        }
    }
    for (int c = 0; c < columns; c++) {
        s->norm[c] = sqrt(dot_from(s->column[c], s->column[c], 0, j->rows));
        for (int r = 0; r < j->rows && s->norm[c] > 0; r++) s->column[c][r] /= s->norm[c];
    }
}

/* Eliminates column c below row s->taken, unless it depends on the columns before it. */
static void take_column(strip *s, int c, int columns, int rows, double least)
{
    double *v = s->column[c], reflector[JET_ROWS];
    const int k = s->taken;
    const double sum = dot_from(v, v, k, rows);
    s->row[c] = -1;
    if (k == rows || !(sum > least * least)) return;
    const double pivot = v[k] > 0 ? -sqrt(sum) : sqrt(sum), scale = 1 / (sum - v[k] * pivot);
    memcpy(reflector, v, sizeof reflector);
    reflector[k] -= pivot;
    for (int other = c + 1; other <= columns; other++) {
        double *x = s->column[other < columns ? other : JET_COLUMNS];
        const double by = scale * dot_from(reflector, x, k, rows);
        for (int r = k; r < rows; r++) x[r] -= by * reflector[r];
    }
    v[k] = pivot;
    s->row[c] = s->taken++;
}

/* The coefficients; those of columns that are left out are 0. */
static void solve_strip(const strip *s, int columns, double a[JET_COLUMNS])
{
    for (int c = columns - 1; c >= 0; c--) {
        a[c] = 0;
        if (s->row[c] < 0) continue;
        double rest = s->column[JET_COLUMNS][s->row[c]];
        for (int k = c + 1; k < columns; k++) rest -= s->column[k][s->row[c]] * a[k];
        a[c] = rest / s->column[c][s->row[c]];
    }
    for (int c = 0; c < SQUARES; c++) a[c] = s->row[c] < 0 ? 0 : a[c] / s->norm[c];
}

/* The derivatives in the directions u and v of a graph whose u is along the direction. */
static jet turn_back(const jet *j, const double direction[2])
{
    const double c = direction[0], s = direction[1];
    return (jet){j->w,
                 c * j->wu - s * j->wv,
                 s * j->wu + c * j->wv,
                 c * c * j->wuu - 2 * c * s * j->wuv + s * s * j->wvv,
                 c * s * (j->wuu - j->wvv) + (c * c - s * s) * j->wuv,
                 s * s * j->wuu + 2 * c * s * j->wuv + c * c * j->wvv};
}

bool jet_solve_strip(const jet_lanes *j, int lane, int degree, double least, jet *out)
{
    const int columns = jet_coefficients(degree);
    double direction[2], a[JET_COLUMNS];
    strip s = {.taken = 0};
    least_known(j, lane, direction);
    fill_strip(j, lane, columns, direction, &s);
    for (int c = 0; c < columns; c++) take_column(&s, c, columns, j->rows, least);
    bool is_strip = s.row[UU] < 0;
    for (int c = 0; c < SQUARES; c++) is_strip &= c == UU || s.row[c] >= 0;
    if (!is_strip) return false;
    solve_strip(&s, columns, a);
    const jet turned = jet_of(a);
    *out = turn_back(&turned, direction);
    return true;
}

// SPDX-License-Identifier: Apache-2.0
#include "surface/triangles/jet.h"

#include <math.h>
#include <string.h>

#include "base/core/isa.h"

/* The number of columns of degree 2 and less: 1, u, v, u^2, u v, v^2. */
enum { UU = 3, UV, VV, SQUARES };

/* Fills in the columns: those of a degree are those of the degree before times u, and the last one times v. */
ISA_INLINE void fill_columns(jet_lanes *j, int rows)
{
    for (int r = 0; r < rows; r++) {
        j->column[0][r] = j->weight[r];
        j->column[JET_COLUMNS][r] = j->w[r];
        for (int degree = 1, c = 1; degree <= JET_DEGREE; degree++) {
            for (int k = 0; k < degree; k++, c++) j->column[c][r] = j->column[c - degree][r] * j->u[r];
            j->column[c][r] = j->column[c - degree - 1][r] * j->v[r];
            c++;
        }
    }
}

/* Scales column c to the norm 1; a column of zeros stays. */
ISA_INLINE void normalise(jet_lanes *j, int c, int rows)
{
    jet_numbers sum = {0}, over;
    for (int r = 0; r < rows; r++) sum += j->column[c][r] * j->column[c][r];
    for (int l = 0; l < JET_LANES; l++) {
        j->norm[c][l] = sqrt(sum[l]);
        over[l] = sum[l] > 0 ? 1 / j->norm[c][l] : 0;
    }
    for (int r = 0; r < rows; r++) j->column[c][r] *= over;
}

/* Columns that are reflected together: their sums are independent, which hides the latency of additions. */
enum { TOGETHER = 5 };

/* Reflects columns c .. c + count - 1 by the vector that column k contains from row k. `count` is a constant. */
ISA_INLINE void reflect(jet_lanes *j, int k, int c, int count, int rows, const jet_numbers *scale)
{
    jet_numbers dot[TOGETHER] = {{0}};
    for (int r = k; r < rows; r++)
        for (int i = 0; i < count; i++) dot[i] += j->column[k][r] * j->column[c + i][r];
    for (int i = 0; i < count; i++) dot[i] *= *scale;
    for (int r = k; r < rows; r++)
        for (int i = 0; i < count; i++) j->column[c + i][r] -= dot[i] * j->column[k][r];
}

ISA_INLINE void eliminate(jet_lanes *j, int k, int rows)
{
    jet_numbers sum = {0}, scale;
    for (int r = k; r < rows; r++) sum += j->column[k][r] * j->column[k][r];
    for (int l = 0; l < JET_LANES; l++) {
        const double first = j->column[k][k][l], length = sqrt(sum[l]), pivot = first > 0 ? -length : length;
        j->diagonal[k][l] = pivot;
        j->column[k][k][l] = first - pivot;
        scale[l] = sum[l] > 0 ? 1 / (sum[l] - first * pivot) : 0;
    }
    int c = k + 1;
    for (; c + TOGETHER <= JET_COLUMNS + 1; c += TOGETHER) reflect(j, k, c, TOGETHER, rows, &scale);
    for (; c <= JET_COLUMNS; c++) reflect(j, k, c, 1, rows, &scale);
}

ISA_CLONES void jet_factor(jet_lanes *j)
{
    const int rows = j->rows < JET_COLUMNS ? JET_COLUMNS : j->rows;
    fill_columns(j, rows);
    for (int c = 0; c < JET_COLUMNS; c++) normalise(j, c, rows);
    for (int k = 0; k < JET_COLUMNS; k++) eliminate(j, k, rows);
}

double jet_condition(const jet_lanes *j, int lane, int degree)
{
    double least = INFINITY;
    for (int k = 0; k < jet_coefficients(degree); k++) least = fmin(least, fabs(j->diagonal[k][lane]));
    return least;
}

static jet jet_of(const double a[SQUARES])
{
    return (jet){a[0], a[1], a[2], 2 * a[UU], a[UV], 2 * a[VV]};
}

jet jet_solve(const jet_lanes *j, int lane, int degree)
{
    double a[JET_COLUMNS];
    for (int k = jet_coefficients(degree) - 1; k >= 0; k--) {
        double rest = j->column[JET_COLUMNS][k][lane];
        for (int c = k + 1; c < jet_coefficients(degree); c++) rest -= j->column[c][k][lane] * a[c];
        a[k] = rest / j->diagonal[k][lane];
    }
    for (int k = 0; k < SQUARES; k++) a[k] /= j->norm[k][lane];
    return jet_of(a);
}

/* ---- strips */

/* The direction, as cosine and sine, in which the second derivative is known least: that of the polynomial of
 * degree 2 which is smallest at the places, by inverse iteration with the factor R. */
static void least_known(const jet_lanes *j, int lane, double direction[2])
{
    static const double tiny = 1e-12; /* instead of a diagonal element of 0 */
    enum { ITERATIONS = 8 };
    double x[SQUARES] = {1, 1, 1, 1, 1, 1}, pivot[SQUARES];
    for (int k = 0; k < SQUARES; k++)
        pivot[k] = copysign(fmax(fabs(j->diagonal[k][lane]), tiny), j->diagonal[k][lane]);
    for (int step = 0; step < ITERATIONS; step++) {
        double size = 0;
        for (int k = 0; k < SQUARES; k++) {
            for (int i = 0; i < k; i++) x[k] -= j->column[k][i][lane] * x[i];
            x[k] /= pivot[k];
        }
        for (int k = SQUARES - 1; k >= 0; k--) {
            for (int c = k + 1; c < SQUARES; c++) x[k] -= j->column[c][k][lane] * x[c];
            x[k] /= pivot[k];
            size = fmax(size, fabs(x[k]));
        }
        for (int k = 0; k < SQUARES; k++) x[k] /= size;
    }
    const double uu = x[UU] / j->norm[UU][lane], uv = x[UV] / j->norm[UV][lane],
                 vv = x[VV] / j->norm[VV][lane];
    const double turn = 0.5 * (atan2(uv, uu - vv) + (uu + vv < 0 ? M_PI : 0));
    direction[0] = cos(turn);
    direction[1] = sin(turn);
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

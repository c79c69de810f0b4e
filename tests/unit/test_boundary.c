// SPDX-License-Identifier: Apache-2.0
/* Boundaries of open surfaces: particles lie along every curve in which a face cuts the surface, with no
 * particle outside and no gap. The curves are traced here from F on the face only.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "base/core/memory.h"
#include "close.h"
#include "surface/field/region.h"
#include "sampling/solver/solver.h"
#include "shapes.h"
#include "sampling/solver/curves/boundary.h"

/* A particle closer to a face than ON_FACE h is on it. A particle farther from a curve than ON_CURVE h
 * belongs to another curve. */
static const double ON_FACE = 1e-3, ON_CURVE = 0.25;
/* Squares of a face per h, and maximum number along a side. */
enum { SQUARES_PER_SPACING = 6, SQUARES_MOST = 1500 };

/* ---- the curves of a face: the contour F = 0, square by square */

typedef struct face {
    const field *field;
    int axis, u, v; /* of the normal, and of the two directions in the face */
    double plane;
    int nu, nv;    /* squares */
    double *value; /* (nu + 1) (nv + 1); NaN where F is not defined */
    int64_t *next; /* two for each edge of a square: the next edges of the curve, or -1 */
    bool *seen;    /* of each edge */
} face;

static vec3 node(const face *f, double i, double j)
{
    vec3 x = {0, 0, 0};
    const bbox *d = &f->field->domain;
    vec3_set(&x, f->axis, f->plane);
    vec3_set(&x, f->u, vec3_get(d->min, f->u) + vec3_get(bbox_size(*d), f->u) * i / f->nu);
    vec3_set(&x, f->v, vec3_get(d->min, f->v) + vec3_get(bbox_size(*d), f->v) * j / f->nv);
    return x;
}

static double value_at(const face *f, int64_t i, int64_t j)
{
    return f->value[j * (f->nu + 1) + i];
}

/* Edges by number: 2 n from node n along u, 2 n + 1 along v. */
static int64_t edge_number(const face *f, int64_t i, int64_t j, int along_v)
{
    return 2 * (j * (f->nu + 1) + i) + along_v;
}

static vec3 edge_point(const face *f, int64_t edge)
{
    int64_t n = edge / 2, i = n % (f->nu + 1), j = n / (f->nu + 1), along_v = edge & 1;
    double a = value_at(f, i, j), b = value_at(f, i + !along_v, j + along_v), t = a / (a - b);
    return node(f, (double)i + (along_v ? 0 : t), (double)j + (along_v ? t : 0));
}

static void join(face *f, int64_t a, int64_t b)
{
    f->next[2 * a + (f->next[2 * a] >= 0)] = b;
    f->next[2 * b + (f->next[2 * b] >= 0)] = a;
}

static void look_at_square(face *f, int64_t i, int64_t j)
{
    /* around the square: its corners, and the edge from each corner to the next */
    const double c[4] = {value_at(f, i, j), value_at(f, i + 1, j), value_at(f, i + 1, j + 1),
                         value_at(f, i, j + 1)};
    const int64_t edge[4] = {edge_number(f, i, j, 0), edge_number(f, i + 1, j, 1),
                             edge_number(f, i, j + 1, 0), edge_number(f, i, j, 1)};
    int64_t crossed[4];
    int count = 0, first = 0;
    for (int k = 0; k < 4; k++) {
        if (isnan(c[k])) return;
        if ((c[k] < 0) == (c[(k + 1) % 4] < 0)) continue;
        if (count == 0) first = k;
        crossed[count++] = edge[k];
    }
    if (count == 2) join(f, crossed[0], crossed[1]);
    if (count < 4) return;
    /* a saddle: the sign at the centre decides which corners are connected; edge `first` follows corner
     * `first` */
    bool middle = c[0] + c[1] + c[2] + c[3] < 0, apart = middle != (c[(first + 1) % 4] < 0);
    join(f, crossed[0], crossed[apart ? 1 : 3]);
    join(f, crossed[2], crossed[apart ? 3 : 1]);
}

/* Samples the nodes around a cell if the face intersects it. F far from the cells is not used. */
static void sample_cell(face *f, size_t number)
{
    field_cell cell;
    bbox box = bbox_empty(), d = f->field->domain;
    vec3 size = bbox_size(d);
    f->field->ops->cell(f->field, number, &cell);
    for (int c = 0; c < 8; c++) box = bbox_include(box, cell.corner[c]);
    if (vec3_get(box.min, f->axis) > f->plane || vec3_get(box.max, f->axis) < f->plane) return;
    double du = vec3_get(size, f->u) / f->nu, dv = vec3_get(size, f->v) / f->nv;
    double u0 = vec3_get(box.min, f->u) - vec3_get(d.min, f->u),
           u1 = vec3_get(box.max, f->u) - vec3_get(d.min, f->u);
    double v0 = vec3_get(box.min, f->v) - vec3_get(d.min, f->v),
           v1 = vec3_get(box.max, f->v) - vec3_get(d.min, f->v);
    for (int j = (int)fmax(v0 / dv - 1, 0); j <= fmin(v1 / dv + 2, f->nv); j++)
        for (int i = (int)fmax(u0 / du - 1, 0); i <= fmin(u1 / du + 2, f->nu); i++) {
            field_sample s;
            double *value = &f->value[j * (f->nu + 1) + i];
            if (isnan(*value) && field_sample_at(f->field, node(f, i, j), FIELD_GRADIENT, &s))
                *value = s.value;
        }
}

static void trace_face(face *f, const field *whole, int number, double h)
{
    *f = (face){
        .field = whole, .axis = number >> 1, .u = ((number >> 1) + 1) % 3, .v = ((number >> 1) + 2) % 3};
    f->plane = vec3_get(number & 1 ? whole->boundary_box.max : whole->boundary_box.min, f->axis);
    vec3 size = bbox_size(whole->domain);
    f->nu = (int)fmin(ceil(vec3_get(size, f->u) / h * SQUARES_PER_SPACING), SQUARES_MOST);
    f->nv = (int)fmin(ceil(vec3_get(size, f->v) / h * SQUARES_PER_SPACING), SQUARES_MOST);
    size_t nodes = (size_t)(f->nu + 1) * (size_t)(f->nv + 1);
    f->value = mem_alloc(nodes * sizeof *f->value);
    f->next = mem_alloc(4 * nodes * sizeof *f->next);
    f->seen = mem_alloc(2 * nodes * sizeof *f->seen);
    for (size_t k = 0; k < 4 * nodes; k++) f->next[k] = -1;
    for (size_t k = 0; k < nodes; k++) f->value[k] = NAN;
    for (size_t k = 0; k < whole->ops->cell_count(whole); k++) sample_cell(f, k);
    for (int j = 0; j < f->nv; j++)
        for (int i = 0; i < f->nu; i++) look_at_square(f, i, j);
}

static void release_face(face *f)
{
    free(f->value);
    free(f->next);
    free(f->seen);
}

/* ---- a curve, and the particles along it */

typedef struct curve {
    vec3 *point;
    double *at; /* length before each */
    size_t count;
    bool closed;
} curve;

static int64_t go_on(const face *f, int64_t edge)
{
    for (int k = 0; k < 2; k++)
        if (f->next[2 * edge + k] >= 0 && !f->seen[f->next[2 * edge + k]]) return f->next[2 * edge + k];
    return -1;
}

/* The curve through an edge. If it has ends, it begins at one of them. */
static curve walk(face *f, int64_t start, size_t capacity)
{
    curve c = {mem_alloc(capacity * sizeof *c.point), mem_alloc(capacity * sizeof *c.at), 0, true};
    int64_t edge = start;
    for (int64_t before = -1, k = 0; k < (int64_t)capacity; k++) { /* back to an end, or once around */
        int64_t a = f->next[2 * edge], b = f->next[2 * edge + 1], on = a == before ? b : a;
        if (on < 0) {
            c.closed = false;
            break;
        }
        if (on == start) break;
        before = edge;
        edge = on;
    }
    for (; edge >= 0; edge = go_on(f, edge)) {
        f->seen[edge] = true;
        c.point[c.count] = edge_point(f, edge);
        c.at[c.count] =
            c.count ? c.at[c.count - 1] + vec3_norm(vec3_sub(c.point[c.count], c.point[c.count - 1])) : 0;
        c.count++;
    }
    if (c.closed) {
        c.point[c.count] = c.point[0];
        c.at[c.count] = c.at[c.count - 1] + vec3_norm(vec3_sub(c.point[0], c.point[c.count - 1]));
        c.count++;
    }
    return c;
}

/* The position along the curve that is nearest to x, and its distance. */
static double place_on(const curve *c, vec3 x, double *off)
{
    double best = INFINITY, where = 0;
    for (size_t k = 0; k + 1 < c->count; k++) {
        vec3 side = vec3_sub(c->point[k + 1], c->point[k]);
        double length2 = vec3_norm2(side);
        double t = length2 > 0 ? vec3_dot(vec3_sub(x, c->point[k]), side) / length2 : 0;
        t = fmin(fmax(t, 0), 1);
        double distance2 = vec3_norm2(vec3_sub(x, vec3_axpy(t, side, c->point[k])));
        if (distance2 >= best) continue;
        best = distance2;
        where = c->at[k] + t * (c->at[k + 1] - c->at[k]);
    }
    *off = sqrt(best);
    return where;
}

typedef struct rim_rows {
    size_t curves, particles;
    double length; /* of all curves, over h */
    /* longest distances, in h, between neighbours along a curve, and before or after an end */
    double gap, end;
} rim_rows;

static int compare_double(const void *a, const void *b)
{
    return (*(const double *)a > *(const double *)b) - (*(const double *)a < *(const double *)b);
}

static void measure_curve(const curve *c, const solver_points *p, const face *f, double h, rim_rows *out)
{
    double *where = mem_alloc((p->count + 1) * sizeof *where), length = c->at[c->count - 1];
    size_t n = 0;
    for (size_t i = 0; i < p->count; i++) {
        double off;
        if (fabs(vec3_get(p->position[i], f->axis) - f->plane) > ON_FACE * h) continue;
        double at = place_on(c, p->position[i], &off);
        if (off <= ON_CURVE * h) where[n++] = at;
    }
    qsort(where, n, sizeof *where, compare_double);
    out->curves++;
    out->particles += n;
    out->length += length / h;
    for (size_t k = 0; k + 1 < n; k++) out->gap = fmax(out->gap, (where[k + 1] - where[k]) / h);
    if (c->closed)
        out->gap = fmax(out->gap, (n ? where[0] + length - where[n - 1] : length) / h);
    else
        out->end = fmax(out->end, (n ? fmax(where[0], length - where[n - 1]) : length) / h);
    free(where);
}

static rim_rows measure_rims(const field *whole, const solver_points *p, double h)
{
    rim_rows out = {0};
    for (int number = 0; number < 6; number++) {
        face f;
        if (isinf(vec3_get(number & 1 ? whole->boundary_box.max : whole->boundary_box.min, number >> 1)))
            continue;
        trace_face(&f, whole, number, h);
        size_t edges = 2 * (size_t)(f.nu + 1) * (size_t)(f.nv + 1);
        for (size_t edge = 0; edge < edges; edge++) {
            if (f.seen[edge] || f.next[2 * edge] < 0) continue;
            curve c = walk(&f, (int64_t)edge, edges + 1);
            measure_curve(&c, p, &f, h, &out);
            free(c.point);
            free(c.at);
        }
        release_face(&f);
    }
    return out;
}

/* ---- solving */

static rim_rows solve(const field *f, size_t count, bool coarse_to_fine, uint64_t seed)
{
    error e = {0};
    threads *pool = threads_new(2, NULL, &e);
    surface *scan = surface_scan(f, pool, &e);
    if (!scan) fail_msg("%s", e.message);
    const solver_params params = {.count = count,
                                  .seed = seed,
                                  .coarse_to_fine = coarse_to_fine,
                                  .max_sweeps = 5000,
                                  .list_limit = SIZE_MAX,
                                  .step_tolerance = 1e-3,
                                  .energy_tolerance = 0.05};
    solver *s = solver_new(f, scan, &params, pool, &e);
    if (!s) fail_msg("%s", e.message);
    while (!solver_ended(s)) assert_true(solver_step(s, &e));
    assert_true(solver_finalize(s, &e));
    const solver_points *p = solver_result_points(s);
    assert_int_equal(p->count, count);
    assert_int_equal(p->lost, 0);
    for (size_t i = 0; i < p->count; i++) assert_true(bbox_contains(f->domain, p->position[i]));
    rim_rows r = measure_rims(f, p, solver_spacing(s));
    solver_free(s);
    surface_free(scan);
    threads_free(pool);
    return r;
}

static const analytic_params ball = {.shape = ANALYTIC_SPHERE, .radius = 1};

static region *zone(const analytic *whole, double low, double high)
{
    error e = {0};
    region *r = region_new(&whole->base, (bbox){{-2, -2, low}, {2, 2, high}}, &e);
    if (!r) fail_msg("%s", e.message);
    return r;
}

/* Initial particles lie on the circles, evenly spaced and exactly in the face. */
static void initial_points_lie_evenly_on_the_boundary(void **state)
{
    (void)state;
    error e = {0};
    analytic *whole = analytic_new(&ball, NULL, &e);
    threads *pool = threads_new(1, NULL, &e);
    region *part = zone(whole, -0.3, 0.6);
    surface *scan = surface_scan(region_field(part), pool, &e);
    const double length = 2 * M_PI * (sqrt(1 - 0.3 * 0.3) + 0.8);
    for (double h = 0.01; h < 0.2; h *= 3)
        for (int few = 0; few < 2; few++) {
            boundary r;
            size_t most = few ? 30 : SIZE_MAX;
            assert_true(boundary_find(scan, &(boundary_request){.spacing = h, .most = most}, &r, &e));
            double spacing = few ? fmax(1.04 * h, length / 30) : 1.04 * h;
            assert_true(r.count <= most);
            assert_close((double)r.count, length / spacing, 1.01);
            for (size_t i = 0; i < r.count; i++) {
                assert_true(r.position[i].z == -0.3 || r.position[i].z == 0.6);
                assert_close(vec3_norm(r.position[i]), 1, 1e-6);
                assert_close(vec3_dot(r.normal[i], r.position[i]), 1, 1e-6);
                double nearest = INFINITY;
                for (size_t j = 0; j < r.count; j++)
                    if (j != i) nearest = fmin(nearest, vec3_norm(vec3_sub(r.position[i], r.position[j])));
                assert_true(nearest > 0.9 * spacing && nearest < 1.1 * spacing);
            }
            boundary_free(&r);
        }
    surface_free(scan);
    region_free(part);
    /* a corner of three faces of the sphere: each of its three corners once */
    boundary r;
    part = region_new(&whole->base, (bbox){{0, 0, 0}, {2, 2, 2}}, &e);
    scan = surface_scan(region_field(part), pool, &e);
    assert_true(boundary_find(scan, &(boundary_request){.spacing = 0.1, .most = SIZE_MAX}, &r, &e));
    int corners = 0;
    for (size_t i = 0; i < r.count; i++)
        corners += (r.position[i].x == 0) + (r.position[i].y == 0) + (r.position[i].z == 0) == 2;
    assert_int_equal(corners, 3);
    assert_close((double)r.count, 3 * (M_PI / 2) / 0.104, 3);
    boundary_free(&r);
    surface_free(scan);
    region_free(part);
    /* a closed surface has none */
    scan = surface_scan(&whole->base, pool, &e);
    assert_true(boundary_find(scan, &(boundary_request){.spacing = 0.1, .most = SIZE_MAX}, &r, &e));
    assert_int_equal(r.count, 0);
    boundary_free(&r);
    surface_free(scan);
    threads_free(pool);
    analytic_free(whole);
}

/* The boundaries of a zone are circles of known length, so they also test the tracing. */
static void zones_of_a_sphere(void **state)
{
    (void)state;
    const struct {
        double low, high;
        size_t count;
        bool coarse_to_fine;
    } cases[] = {
        {0.5, 2, 400, false},  {0.5, 2, 4000, true},     {-2, 0.5, 200, false},  {-2, 0.5, 3000, true},
        {0.95, 2, 300, false}, {-0.3, 0.3, 1000, false}, {-0.1, 0.1, 400, true},
    };
    error e = {0};
    analytic *whole = analytic_new(&ball, NULL, &e);
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++)
        for (uint64_t seed = 1; seed <= (cases[k].count < 1000 ? 2 : 1); seed++) {
            region *part = zone(whole, cases[k].low, cases[k].high);
            const field *f = region_field(part);
            threads *pool = threads_new(1, NULL, &e);
            surface *scan = surface_scan(f, pool, &e);
            double h = sqrt(2 * scan->area / (sqrt(3) * (double)cases[k].count)), length = 0;
            if (cases[k].low > -1) length += 2 * M_PI * sqrt(1 - cases[k].low * cases[k].low);
            if (cases[k].high < 1) length += 2 * M_PI * sqrt(1 - cases[k].high * cases[k].high);
            rim_rows r = solve(f, cases[k].count, cases[k].coarse_to_fine, seed);
            print_message("# %g to %g, %zu: %zu on rims of %.1f h, gap %.3f\n", cases[k].low, cases[k].high,
                          cases[k].count, r.particles, r.length, r.gap);
            assert_int_equal(r.curves, (cases[k].low > -1) + (cases[k].high < 1));
            assert_close(r.length * h / length, 1, 2e-3);
            assert_true(r.gap <= 1.5);
            surface_free(scan);
            threads_free(pool);
            region_free(part);
        }
    analytic_free(whole);
}

/* Many curves, each between two edges of the box. */
static void the_gyroid_in_its_box(void **state)
{
    (void)state;
    const struct {
        double period;
        size_t count;
        bool coarse_to_fine;
    } cases[] = {{1, 1000, false}, {1, 4000, true}, {0.5, 2000, false}};
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        error e = {0};
        analytic_params params = {.shape = ANALYTIC_GYROID,
                                  .center = {0.5, 0.5, 0.5},
                                  .size = {1, 1, 1},
                                  .period = cases[k].period};
        analytic *a = analytic_new(&params, NULL, &e);
        rim_rows r = solve(&a->base, cases[k].count, cases[k].coarse_to_fine, 1);
        print_message("# period %g, %zu: %zu on %zu rims of %.1f h, gap %.3f, at an end %.3f\n",
                      params.period, cases[k].count, r.particles, r.curves, r.length, r.gap, r.end);
        assert_true(r.curves >= 18);
        assert_true(r.gap <= 1.5 && r.end <= 1.5);
        analytic_free(a);
    }
}

/* A region that cuts a gyroid obliquely to its cells. */
static void a_region_of_a_gyroid(void **state)
{
    (void)state;
    error e = {0};
    analytic_params params = {
        .shape = ANALYTIC_GYROID, .center = {0.5, 0.5, 0.5}, .size = {1, 1, 1}, .period = 0.6};
    analytic *a = analytic_new(&params, NULL, &e);
    region *part = region_new(&a->base, (bbox){{0.123, -1, 0.2}, {0.81, 0.777, 2}}, &e);
    rim_rows r = solve(region_field(part), 3000, true, 1);
    print_message("# %zu on %zu rims of %.1f h, gap %.3f, at an end %.3f\n", r.particles, r.curves, r.length,
                  r.gap, r.end);
    assert_true(r.gap <= 1.5 && r.end <= 1.5);
    region_free(part);
    analytic_free(a);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(initial_points_lie_evenly_on_the_boundary),
        cmocka_unit_test(zones_of_a_sphere),
        cmocka_unit_test(the_gyroid_in_its_box),
        cmocka_unit_test(a_region_of_a_gyroid),
    };
    return cmocka_run_group_tests_name("rims", tests, NULL, NULL);
}

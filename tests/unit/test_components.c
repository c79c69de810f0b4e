// SPDX-License-Identifier: Apache-2.0
/* Connected components of surfaces; a small component beside a large one gets its particles. */
#include <math.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "close.h"
#include "geometry/space/affine.h"
#include "sampling/solver/solver.h"
#include "surface/scan/components.h"

/* Two separate balls: F is the smaller of two distances, which is smooth near each ball. */
typedef struct balls {
    field base;
    vec3 center[2];
    double radius[2];
    double cell;
    int64_t side;
    size_t count;
    int64_t *crossing;
} balls;

static double distance(const balls *b, vec3 x, int *nearer)
{
    double d[2];
    for (int k = 0; k < 2; k++) d[k] = vec3_norm(vec3_sub(x, b->center[k])) - b->radius[k];
    *nearer = d[1] < d[0];
    return d[*nearer];
}

static bool sample(const field *f, vec3 x, field_order order, field_sample *out)
{
    const balls *b = (const balls *)f;
    int k;
    out->value = distance(b, x, &k);
    vec3 d = vec3_sub(x, b->center[k]), n = vec3_unit(d);
    double r = vec3_norm(d);
    if (!(r > 0)) return false;
    out->gradient = n;
    if (order == FIELD_HESSIAN)
        out->hessian = (sym3){(1 - n.x * n.x) / r, (1 - n.y * n.y) / r, (1 - n.z * n.z) / r,
                              -n.x * n.y / r,      -n.x * n.z / r,      -n.y * n.z / r};
    return true;
}

static size_t cell_count(const field *f)
{
    return ((const balls *)f)->count;
}

static void fill_cell(const balls *b, int64_t linear, field_cell *out)
{
    int64_t at[3] = {linear % b->side, linear / b->side % b->side, linear / b->side / b->side};
    for (int c = 0; c < 8; c++) {
        int ignored;
        out->corner[c] = vec3_make(b->base.domain.min.x + b->cell * (double)(at[0] + (c & 1)),
                                   b->base.domain.min.y + b->cell * (double)(at[1] + (c >> 1 & 1)),
                                   b->base.domain.min.z + b->cell * (double)(at[2] + (c >> 2)));
        out->value[c] = distance(b, out->corner[c], &ignored);
    }
    out->hidden_crossing = false;
    out->bend = FIELD_BENT;
}

static void cell(const field *f, size_t k, field_cell *out)
{
    const balls *b = (const balls *)f;
    fill_cell(b, b->crossing[k], out);
}

static const field_ops balls_ops = {.sample = sample, .cell_count = cell_count, .cell = cell};

/* Radii 1 and `small`, with cells of a tenth of the small radius, about `apart` from each other at 1.01. */
static balls make_balls(double small, double apart)
{
    balls b = {.base = {.ops = &balls_ops, .domain = {{-1.3, -1.3, -1.3}, {1.3 + 4 * small, 1.3, 1.3}}},
               .center = {{0.01, 0.02, 0.03}, {1.01 + apart + small, 0.01, 0.02}},
               .radius = {1, small},
               .cell = small / 5};
    b.base.extent = bbox_longest(b.base.domain);
    b.base.cell_size = b.cell;
    b.side = (int64_t)ceil(b.base.extent / b.cell);
    b.crossing = malloc((size_t)(b.side * b.side * b.side) * sizeof *b.crossing);
    for (int64_t k = 0; k < b.side * b.side * b.side; k++) {
        field_cell c;
        int inside = 0;
        fill_cell(&b, k, &c);
        for (int i = 0; i < 8; i++) inside += c.value[i] < 0;
        if (inside > 0 && inside < 8) b.crossing[b.count++] = k;
    }
    return b;
}

/* Also for balls in adjacent cells. */
static void shares_equal_those_of_the_areas(void **state)
{
    (void)state;
    error e = {0};
    threads *pool = threads_new(2, NULL, &e);
    for (int k = 0; k < 8; k++) {
        const double small = ldexp(0.1, k / 2), apart = k % 2 ? 1.15 * small / 5 : 0.19 + small;
        balls b = make_balls(small, apart);
        surface *scan = surface_scan(&b.base, pool, &e);
        double truth = small * small / (1 + small * small);
        assert_int_equal(scan->parts.count, 2);
        size_t second = scan->parts.begin[1];
        double share = 1 - scan->area_before[second] / scan->area;
        assert_close(fmin(share, 1 - share) / truth, 1, 0.01);
        for (size_t i = 0; i < scan->cells; i++) { /* every cell once, grouped by component */
            field_cell c;
            surface_cell(scan, i, &c);
            const double x = 0.5 * (c.corner[0].x + c.corner[7].x);
            assert_true((x > 1.01 + 0.5 * apart) == ((share < 0.5) == (i >= second)));
        }
        surface_free(scan);
        free(b.crossing);
    }
    threads_free(pool);
}

/* The stop must be reported, since cells that were not processed have no size. */
static void a_stop_is_reported(void **state)
{
    (void)state;
    static volatile sig_atomic_t stop = 1;
    error e = {0};
    components parts;
    threads *pool = threads_new(2, &stop, &e);
    balls b = make_balls(0.2, 0.4);
    for (int uneven = 0; uneven < 2; uneven++) {
        b.base.uneven = uneven;
        e = (error){0};
        assert_false(components_find(&b.base, pool, &parts, &e));
        assert_int_equal(e.code, ERROR_CANCELLED);
    }
    free(b.crossing);
    threads_free(pool);
}

/* In proportion to the area, to 5 % or one particle. The large component still starts coarse. */
static void a_small_part_gets_its_share(void **state)
{
    (void)state;
    error e = {0};
    threads *pool = threads_new(2, NULL, &e);
    for (double small = 0.05; small < 0.9; small *= 2.3) {
        balls b = make_balls(small, 0.19 + small);
        surface *scan = surface_scan(&b.base, pool, &e);
        const solver_params params = {.count = 6000,
                                      .seed = 1,
                                      .max_sweeps = 5000,
                                      .list_limit = SIZE_MAX,
                                      .step_tolerance = 3e-3,
                                      .energy_tolerance = 0.05,
                                      .coarse_to_fine = true};
        solver *s = solver_new(&b.base, scan, &params, pool, &e);
        assert_non_null(s);
        while (!solver_ended(s)) assert_true(solver_step(s, &e));
        assert_true(solver_finalize(s, &e));
        const solver_points *p = solver_result_points(s);
        double on_small = 0, wanted = 6000 * small * small / (1 + small * small);
        for (size_t i = 0; i < p->count; i++) on_small += p->position[i].x > 1.1;
        size_t rounds;
        print_message("# radius %.3f: %.0f of %.1f, from %zu\n", small, on_small, wanted,
                      solver_rounds(s, &rounds)[0].count);
        assert_true(solver_rounds(s, &rounds)[0].count < 6000 / 3);
        assert_int_equal(p->count, 6000);
        assert_close(on_small, wanted, fmax(0.05 * wanted, 1));
        solver_free(s);
        surface_free(scan);
        free(b.crossing);
    }
    threads_free(pool);
}

enum { FEW = 64 };

/* Cells of an oblique, inverted lattice far from its origin. */
typedef struct few {
    field base;
    double shift; /* an additional shift */
    size_t count;
    int at[FEW][3];
    unsigned inside[FEW]; /* signs at the corners, one bit each */
    bool hidden_crossing[FEW];
} few;

static size_t few_count(const field *f)
{
    return ((const few *)f)->count;
}

static void few_cell(const field *f, size_t k, field_cell *out)
{
    const few *p = (const few *)f;
    const double edges[3][4] = {{1.1, 0.3, 0, 700 + p->shift}, {0, -0.5, 0.1, -40}, {0.2, 0, 2, 9}};
    const int *at = p->at[k];
    for (int c = 0; c < 8; c++) {
        out->corner[c] = affine_apply(edges, at[0] + (c & 1), at[1] + (c >> 1 & 1), at[2] + (c >> 2));
        out->value[c] = p->inside[k] >> c & 1 ? -1 : 1;
    }
    out->hidden_crossing = p->hidden_crossing[k];
    out->bend = FIELD_BENT;
}

static const field_ops few_ops = {.cell_count = few_count, .cell = few_cell};

enum { LOW_Z = 0x0f, CORNER = 0x01 }; /* inside */

static few few_make(void)
{
    return (few){.base = {.ops = &few_ops, .cell_size = 2.01}};
}

static void few_add(few *p, int x, int y, int z, unsigned inside, bool hidden_crossing)
{
    p->at[p->count][0] = x;
    p->at[p->count][1] = y;
    p->at[p->count][2] = z;
    p->inside[p->count] = inside;
    p->hidden_crossing[p->count++] = hidden_crossing;
}

static size_t parts_of(const few *p)
{
    error e = {0};
    components parts;
    if (!components_find(&p->base, NULL, &parts, &e)) fail_msg("%s", e.message);
    const size_t count = parts.count;
    components_free(&parts);
    return count;
}

/* Cells are one component only if they share a face that, by one of the cells, the surface crosses. */
static void parts_are_joined_through_faces(void **state)
{
    (void)state;
    static const struct {
        int by[3];
        unsigned inside;
        bool hidden_crossing;
        size_t parts;
    } cases[] = {
        {{1, 0, 0}, LOW_Z, false, 1},  {{-1, 0, 0}, LOW_Z, false, 1}, {{0, 1, 0}, LOW_Z, false, 1},
        {{0, -1, 0}, LOW_Z, false, 1}, {{0, 0, 1}, LOW_Z, false, 2},  {{0, 0, -1}, LOW_Z, false, 2},
        {{0, 0, 1}, LOW_Z, true, 1},   {{0, 0, -1}, LOW_Z, true, 1},  {{2, 0, 0}, LOW_Z, true, 2},
        {{1, 1, 0}, LOW_Z, true, 2},   {{1, 0, 0}, CORNER, false, 1}, {{7, 0, 0}, LOW_Z, true, 2},
    };
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++)
        for (int first = -9; first < 9; first++) { /* across the boundaries of blocks */
            const int *by = cases[k].by;
            few p = few_make();
            few_add(&p, first, first + 1, first + 2, cases[k].inside, false);
            few_add(&p, first + by[0], first + 1 + by[1], first + 2 + by[2], cases[k].inside,
                    cases[k].hidden_crossing);
            if (parts_of(&p) != cases[k].parts) fail_msg("case %zu at %d: %zu parts", k, first, parts_of(&p));
        }
}

/* A row of cells, and after each cell two isolated ones, each in a new part of the map. */
static void scattered_parts_are_counted_separately(void **state)
{
    (void)state;
    few p = few_make();
    for (int k = 0; k < FEW / 3; k++) {
        few_add(&p, k, 0, 0, LOW_Z, false);
        few_add(&p, 100 * (k + 1), -200, 7, LOW_Z, false);
        few_add(&p, 5, 100 * (k + 1), -300, LOW_Z, false);
    }
    assert_int_equal(parts_of(&p), 1 + 2 * (FEW / 3));
}

/* If coordinates are so large that the centres of distant cells do not give the number of cells between them,
 * or if this number is large, components are still complete. */
static void parts_far_away_are_whole(void **state)
{
    (void)state;
    for (int k = 0; k < 1000; k++) {
        few p = few_make();
        const int away = k % 10 ? 78000 + k : (1 << 20) + k;
        p.shift = k % 10 ? 0x1p40 : 0;
        few_add(&p, -away, 0, 0, LOW_Z, false);
        for (int x = 0; x < 3; x++) few_add(&p, away + x, 0, 0, LOW_Z, false);
        if (parts_of(&p) != 2) fail_msg("%d cells away: %zu parts", away, parts_of(&p));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(parts_are_joined_through_faces),
        cmocka_unit_test(scattered_parts_are_counted_separately),
        cmocka_unit_test(parts_far_away_are_whole),
        cmocka_unit_test(shares_equal_those_of_the_areas),
        cmocka_unit_test(a_stop_is_reported),
        cmocka_unit_test(a_small_part_gets_its_share),
    };
    return cmocka_run_group_tests_name("components", tests, NULL, NULL);
}

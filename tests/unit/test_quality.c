/* Measures against packings that are known: a hexagonal lattice on a torus-like patch is not to be had
 * without rims, so a flat open sheet serves for the lattice and spheres for topology. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "packing/energy.h"
#include "packing/packing.h"
#include "voronoi/quality.h"
#include "shapes.h"

enum { SIDE = 40, LATTICE = SIDE * SIDE };

typedef struct sheet {
    vec3 position[LATTICE], normal[LATTICE];
    double spacing[LATTICE], local[LATTICE];
    double degree[LATTICE];
    quality_input in;
} sheet;

/* A hexagonal lattice with spacing 1, seen as a surface that is open at its outline. */
static sheet *make_sheet(void)
{
    sheet *s = calloc(1, sizeof *s);
    for (int j = 0; j < SIDE; j++)
        for (int i = 0; i < SIDE; i++) {
            int k = j * SIDE + i;
            s->position[k] = (vec3){i + 0.5 * (j & 1), j * sqrt(3) / 2, 0};
            s->normal[k] = (vec3){0, 0, 1};
            s->spacing[k] = 1;
        }
    s->in = (quality_input){.count = LATTICE,
                            .position = s->position,
                            .normal = s->normal,
                            .spacing = s->spacing,
                            .h = 1,
                            .open = true,
                            .domain = {{0, 0, -10}, {SIDE - 0.5, (SIDE - 1) * sqrt(3) / 2, 10}}};
    return s;
}

static void measure_with(sheet *s, int workers, quality *q)
{
    error e = {0};
    threads *pool = threads_new(workers, NULL, &e);
    if (!quality_measure(&s->in, pool, s->local, s->degree, q, &e)) fail_msg("%s", e.message);
    threads_free(pool);
}

static void measure(sheet *s, quality *q)
{
    measure_with(s, 2, q);
}

static void lattice_is_perfect(void **state)
{
    (void)state;
    sheet *s = make_sheet();
    quality q;
    measure(s, &q);
    assert_true(q.resolved.hex_fraction == 1);
    assert_close(q.resolved.edge_cv, 0, 1e-6); /* the root of rounding */
    assert_close(q.resolved.area_cv, 0, 1e-6);
    assert_close(q.energy_excess, 0, 1e-9);
    assert_close(q.min_spacing_ratio, 1, 1e-12);
    assert_close(q.grading_cv, 0, 1e-6);
    assert_close(q.grading_exponent, 1, 0);
    assert_in_range(q.rim_count, 4 * SIDE, 10 * SIDE);
    assert_close(s->local[LATTICE / 2 + SIDE / 2], 1, 1e-9);
    free(s);
}

/* Of all points one in seven is measured: its cell is what it is among all. */
static void a_part_speaks_for_all(void **state)
{
    (void)state;
    sheet *s = make_sheet();
    quality all, part;
    s->position[LATTICE / 2 + SIDE / 2].x += 0.2;
    measure(s, &all);
    s->in.every = 7;
    measure(s, &part);
    assert_in_range(part.resolved_count, all.resolved_count / 7 - SIDE, all.resolved_count / 7 + SIDE);
    assert_in_range(part.rim_count, all.rim_count / 7 - SIDE, all.rim_count / 7 + SIDE);
    assert_close(part.resolved_share, 1, 0);
    assert_close(part.resolved.hex_fraction, all.resolved.hex_fraction, 0.02);
    free(s);
}

/* One point moved by 0.1: its own and its neighbours' edges change, and nothing else. */
static void a_moved_point_shows(void **state)
{
    (void)state;
    sheet *s = make_sheet();
    quality q;
    s->position[LATTICE / 2 + SIDE / 2].x += 0.1;
    measure(s, &q);
    assert_close(q.min_spacing_ratio, 0.9, 1e-9);
    assert_true(q.resolved.edge_cv > 0.001 && q.resolved.edge_cv < 0.02);
    assert_true(q.energy_excess > 0);
    free(s);
}

/* A vacancy: the six around it have five other neighbours and close ranks across the hole. */
static void a_vacancy_makes_defects(void **state)
{
    (void)state;
    sheet *s = make_sheet();
    quality q;
    int hole = LATTICE / 2 + SIDE / 2;
    s->position[hole] = s->position[LATTICE - 1]; /* the last takes its place in the arrays */
    s->in.count = LATTICE - 1;
    measure(s, &q);
    assert_true(q.resolved.hex_fraction < 1 && q.resolved.hex_fraction > 0.99);
    assert_true(q.resolved.area_cv > 0.005);
    free(s);
}

/* Points on a coarse grid lie in one place, and on lines: the cells of some have no area that can be told. */
static void points_in_one_place_say_no_more_than_they_can(void **state)
{
    (void)state;
    sheet *s = make_sheet();
    rng r = rng_seed(test_seed(), 6);
    for (size_t i = 0; i < LATTICE; i++) {
        const vec3 at = random_between(&r, (vec3){0, 0, 0}, (vec3){SIDE, SIDE, 3});
        s->position[i] = (vec3){floor(at.x), floor(at.y), 0.5 * floor(at.z)};
    }
    quality q;
    measure(s, &q);
    for (size_t i = 0; i < LATTICE; i++)
        if (!(isfinite(s->local[i]) && s->local[i] > 0)) fail_msg("%zu: %g", i, s->local[i]);
    assert_true(isfinite(q.all.area_cv) && isfinite(q.all.edge_cv));
    free(s);
}

/* Points at random on a sphere: any triangulation of it has sum (6 - degree) = 12. */
static void euler_of_a_sphere_is_two(void **state)
{
    (void)state;
    enum { POINTS = 1500 };
    vec3 x[POINTS];
    double spacing[POINTS];
    error e = {0};
    rng r = rng_seed(test_seed(), 0);
    threads *pool = threads_new(1, NULL, &e);
    double h = sqrt(2 * 4 * M_PI / (sqrt(3) * POINTS));
    int exact = 0;
    for (int round = 0; round < 10; round++) {
        for (int k = 0; k < POINTS; k++) { /* Fibonacci's lattice, shaken */
            double z = 1 - (2 * k + 1.0) / POINTS, angle = k * M_PI * (3 - sqrt(5)), w = sqrt(1 - z * z);
            vec3 noise = random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1});
            x[k] = vec3_unit(vec3_axpy(0.2 * h, noise, (vec3){w * cos(angle), w * sin(angle), z}));
            spacing[k] = h;
        }
        quality_input in = {.count = POINTS, .position = x, .normal = x, .spacing = spacing, .h = h};
        quality q;
        assert_true(quality_measure(&in, pool, NULL, NULL, &q, &e));
        exact += fabs(q.euler - 2) < 1e-9;
        assert_close(q.euler, 2, 0.4);
        assert_int_equal(q.rim_count, 0);
    }
    assert_in_range(exact, 9, 10);
    threads_free(pool);
}

/* Spacing that grows along x, asked for and had: the exponent is 1 and the variation small; asked for
 * as even, the variation shows. */
static void grading_is_told_from_disorder(void **state)
{
    (void)state;
    sheet *s = make_sheet();
    quality graded, even;
    for (int k = 0; k < LATTICE; k++) { /* a conformal map of the lattice: exp(z / 40) */
        double x = s->position[k].x / 40, y = s->position[k].y / 40, scale = exp(x);
        s->position[k] = (vec3){40 * scale * cos(y), 40 * scale * sin(y), 0};
        s->spacing[k] = scale;
    }
    s->in.open = false; /* its outline is no box: measure all and read what rims do not spoil */
    measure(s, &graded);
    assert_close(graded.grading_exponent, 1, 0.1);
    assert_true(graded.resolved.hex_fraction > 0.85);
    for (int k = 0; k < LATTICE; k++) s->spacing[k] = 1.6;
    measure(s, &even);
    assert_true(even.grading_cv > graded.grading_cv + 0.05);
    free(s);
}

/* A growing packing in perfect order, one too dense all over, and the first one shaken. */
static void disorder_is_told_from_what_is_asked(void **state)
{
    (void)state;
    const double turn = 1.0 / 6;
    rng r = rng_seed(test_seed(), 3);
    sheet *s = make_sheet();
    uint8_t flags[LATTICE];
    quality q;
    for (int k = 0; k < LATTICE; k++) s->spacing[k] = 1.02;
    s->in.h = 1.02;
    measure(s, &q);
    assert_true(q.energy_excess > 0.09);
    assert_close(q.disorder, 0, 0.003);
    for (int k = 0; k < LATTICE; k++) { /* exp(turn z) / turn */
        const double x = turn * s->position[k].x, y = turn * s->position[k].y, scale = exp(x);
        const int column = k % SIDE, row = k / SIDE;
        s->position[k] = (vec3){scale * cos(y) / turn, scale * sin(y) / turn, 0};
        s->spacing[k] = scale;
        flags[k] = column % (SIDE - 1) == 0 || row % (SIDE - 1) == 0 ? PACKING_FIXED : 0;
    }
    s->in.open = false;
    s->in.sized = true;
    s->in.flags = flags;
    measure(s, &q);
    assert_true(q.resolved.hex_fraction == 1);
    assert_close(q.energy_excess, 0.67 * turn * turn, 5e-4);
    assert_close(q.disorder, 0, 1e-3);
    for (int k = 0; k < LATTICE; k++) {
        const double most = flags[k] ? 0 : 0.15 * s->spacing[k];
        s->position[k] =
            vec3_add(s->position[k], random_between(&r, (vec3){-most, -most, 0}, (vec3){most, most, 0}));
    }
    measure(s, &q);
    assert_true(q.disorder > 0.05 && q.disorder > 0.8 * q.energy_excess);
    free(s);
}

/* The corners of an icosahedron have five neighbours each, in perfect order: their cells are those of five triangles. */
static void defects_that_curvature_demands_are_no_disorder(void **state)
{
    (void)state;
    enum { CORNERS = 12 };
    const double golden = (1 + sqrt(5)) / 2;
    vec3 x[CORNERS];
    double spacing[CORNERS];
    for (int k = 0; k < CORNERS; k++) {
        const double a = k & 1 ? 1 : -1, b = k & 2 ? golden : -golden;
        const vec3 corner[3] = {{0, a, b}, {a, b, 0}, {b, 0, a}};
        x[k] = vec3_unit(corner[k / 4]);
        spacing[k] = packing_spacing(4 * M_PI, CORNERS);
    }
    error e = {0};
    threads *pool = threads_new(1, NULL, &e);
    const quality_input in = {
        .count = CORNERS, .position = x, .normal = x, .spacing = spacing, .h = spacing[0]};
    quality q;
    assert_true(quality_measure(&in, pool, NULL, NULL, &q, &e));
    assert_true(q.resolved_count == CORNERS && q.resolved.hex_fraction == 0);
    assert_close(q.disorder, 0, 0.01);
    threads_free(pool);
}

/* Any number of threads gives the same bits, of a sheet that is shaken, sized and of uneven alpha. */
static void threads_do_not_matter(void **state)
{
    (void)state;
    const int workers[] = {2, 3, 8};
    rng r = rng_seed(test_seed(), 1);
    sheet *s = make_sheet(), *other = make_sheet();
    for (int k = 0; k < LATTICE; k++) {
        vec3 noise = random_between(&r, (vec3){-0.2, -0.2, -0.1}, (vec3){0.2, 0.2, 0.1});
        s->position[k] = vec3_add(s->position[k], noise);
        s->spacing[k] = 1 + 0.1 * rng_uniform(&r);
    }
    s->in.sized = true;
    quality one, q;
    measure_with(s, 1, &one);
    for (int k = 0; k < 3; k++) {
        other->in = s->in;
        measure_with(other, workers[k], &q);
        assert_memory_equal(&q, &one, sizeof q);
        assert_memory_equal(other->local, s->local, sizeof s->local);
        assert_memory_equal(other->degree, s->degree, sizeof s->degree);
    }
    free(s);
    free(other);
}

/* The energies, from the potential itself and all pairs. */
static void energies_are_those_of_all_pairs(void **state)
{
    (void)state;
    enum { POINTS = 400 };
    vec3 x[POINTS];
    double spacing[POINTS], h = sqrt(8 * M_PI / (sqrt(3) * POINTS));
    error e = {0};
    rng r = rng_seed(test_seed(), 2);
    threads *pool = threads_new(1, NULL, &e);
    for (int sized = 0; sized < 2; sized++) {
        double energy = 0, nearest = INFINITY;
        for (int k = 0; k < POINTS; k++) {
            double z = 1 - (2 * k + 1.0) / POINTS, angle = k * M_PI * (3 - sqrt(5)), w = sqrt(1 - z * z);
            vec3 noise = random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1});
            x[k] = vec3_unit(vec3_axpy(0.1 * h, noise, (vec3){w * cos(angle), w * sin(angle), z}));
            spacing[k] = h * (sized ? 1 + 0.1 * rng_uniform(&r) : 0.6 + 0.8 * rng_uniform(&r));
        }
        for (int i = 0; i < POINTS; i++) {
            for (int j = 0; j < POINTS; j++) {
                double distance = vec3_norm(vec3_sub(x[i], x[j])), mean = 0.5 * (spacing[i] + spacing[j]);
                double size = sized ? mean / spacing[i] : 1, support = sqrt(3) * (sized ? mean : h);
                if (i == j) continue;
                nearest = fmin(nearest, distance / mean);
                energy += size * size * energy_cotangent.value(distance / support);
            }
        }
        quality q;
        quality_input in = {
            .count = POINTS, .position = x, .normal = x, .spacing = spacing, .h = h, .sized = sized};
        assert_true(quality_measure(&in, pool, NULL, NULL, &q, &e));
        assert_close(q.energy_excess, energy / POINTS / energy_cotangent.ideal - 1, 1e-11);
        assert_close(q.min_spacing_ratio, nearest, 1e-12);
    }
    threads_free(pool);
}

/* The points from begin to end, alone. */
static quality_input part_of(const quality_input *all, size_t begin, size_t end)
{
    quality_input part = *all;
    part.count = end - begin;
    part.position += begin;
    part.normal += begin;
    part.spacing += begin;
    return part;
}

/* A set so large that it is measured in partitions, each point as if the others far from it were not there. */
static void partitions_do_not_show(void **state)
{
    (void)state;
    enum { LONG = 1300, WIDE = 200, ALL = LONG * WIDE, PIECE = 235, MARGIN = 10 };
    rng r = rng_seed(test_seed(), 3);
    error e = {0};
    vec3 *position = calloc(ALL, sizeof *position), *normal = calloc(ALL, sizeof *normal);
    double *spacing = calloc(ALL, sizeof *spacing), *local = calloc(2 * ALL, sizeof *local);
    double *degree = calloc(2 * ALL, sizeof *degree);
    threads *pool = threads_new(2, NULL, &e);
    for (int k = 0; k < ALL; k++) { /* column after column along y */
        int i = k / WIDE, j = k % WIDE;
        vec3 noise = random_between(&r, (vec3){-0.3, -0.3, 0}, (vec3){0.3, 0.3, 0});
        position[k] = vec3_add((vec3){j + 0.5 * (i & 1), i * sqrt(3) / 2, 0}, noise);
        normal[k] = (vec3){0, 0, 1};
        spacing[k] = 1;
    }
    quality_input in = {.count = ALL, .position = position, .normal = normal, .spacing = spacing, .h = 1};
    quality q;
    assert_true(quality_measure(&in, pool, local, degree, &q, &e));
    for (size_t first = 0; first + PIECE <= LONG; first += PIECE - 2 * MARGIN) {
        quality_input piece = part_of(&in, first * WIDE, (first + PIECE) * WIDE);
        assert_true(quality_measure(&piece, pool, local + ALL, degree + ALL, &q, &e));
        for (int k = MARGIN * WIDE; k < (PIECE - MARGIN) * WIDE; k++) {
            assert_int_equal(degree[first * WIDE + (size_t)k], degree[ALL + k]);
            assert_close(local[first * WIDE + (size_t)k], local[ALL + k], 1e-9);
        }
    }
    threads_free(pool);
    free(position);
    free(normal);
    free(spacing);
    free(local);
    free(degree);
}

/* A sphere of several partitions, whose triangulation closes. */
static void partitions_fit_together(void **state)
{
    (void)state;
    enum { POINTS = 250000 };
    rng r = rng_seed(test_seed(), 4);
    error e = {0};
    vec3 *x = calloc(POINTS, sizeof *x);
    double *spacing = calloc(POINTS, sizeof *spacing), h = sqrt(8 * M_PI / (sqrt(3) * POINTS));
    threads *pool = threads_new(2, NULL, &e);
    for (int k = 0; k < POINTS; k++) {
        double z = 1 - (2 * k + 1.0) / POINTS, angle = k * M_PI * (3 - sqrt(5)), w = sqrt(1 - z * z);
        vec3 noise = random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1});
        x[k] = vec3_unit(vec3_axpy(0.1 * h, noise, (vec3){w * cos(angle), w * sin(angle), z}));
        spacing[k] = h;
    }
    quality_input in = {.count = POINTS, .position = x, .normal = x, .spacing = spacing, .h = h};
    quality q;
    assert_true(quality_measure(&in, pool, NULL, NULL, &q, &e));
    assert_close(q.euler, 2, 1e-9);
    threads_free(pool);
    free(x);
    free(spacing);
}

/* The lattice, below it the first `rows` rows of another that faces down, and far above both `alone` points of a hexagon
 * and its centre. */
static size_t measure_plate(double gap, int rows, int alone, quality *q)
{
    enum { ALL = 2 * LATTICE + 7 };
    sheet *s = make_sheet();
    vec3 *x = calloc(ALL, sizeof *x), *normal = calloc(ALL, sizeof *normal);
    double *spacing = calloc(ALL, sizeof *spacing);
    size_t count = LATTICE + (size_t)(rows * SIDE);
    for (size_t k = 0; k < ALL; k++) {
        double side = k < LATTICE ? 1 : -1;
        x[k] = s->position[k % LATTICE];
        normal[k] = (vec3){0, 0, side};
        spacing[k] = 1;
        if (side < 0) x[k] = vec3_add(x[k], (vec3){0.5, 0.3, -gap});
    }
    for (int k = 0; k < alone; k++) {
        double angle = k * M_PI / 3, radius = k < 6;
        x[count + (size_t)k] = (vec3){SIDE / 2 + radius * cos(angle), SIDE / 2 + radius * sin(angle), 6};
        normal[count + (size_t)k] = (vec3){0, 0, 1};
    }
    count += (size_t)alone;
    s->in.count = count;
    s->in.position = x;
    s->in.normal = normal;
    s->in.spacing = spacing;
    error e = {0};
    threads *pool = threads_new(2, NULL, &e);
    assert_true(quality_measure(&s->in, pool, NULL, NULL, q, &e));
    threads_free(pool);
    free(x);
    free(normal);
    free(spacing);
    free(s);
    return count;
}

/* Two sheets are told apart from a gap of 1.2 on; nearer, no point has a cell, but all have energies. */
static void sheets_that_are_too_close_are_left_out(void **state)
{
    (void)state;
    quality near, far;
    size_t count = measure_plate(1.19, SIDE, 0, &near);
    assert_int_equal(near.unresolved_count + near.rim_count, count);
    assert_true(isnan(near.resolved.hex_fraction) && isnan(near.resolved.edge_cv) &&
                isnan(near.resolved.area_cv));
    assert_true(isnan(near.grading_cv) && isnan(near.grading_exponent));
    assert_close(near.energy_excess, 0, 1e-9);
    assert_close(near.min_spacing_ratio, 1, 1e-12);
    measure_plate(1.21, SIDE, 0, &far);
    assert_int_equal(far.unresolved_count, 0);
    assert_true(far.resolved.hex_fraction == 1);
    assert_close(far.resolved.area_cv, 0, 1e-6);
}

/* What few points say is not said of the many that are not measured. */
static void a_handful_of_points_says_nothing(void **state)
{
    (void)state;
    quality q;
    size_t count = measure_plate(1, SIDE, 7, &q);
    assert_int_equal(q.resolved_count, 7);
    assert_close(q.resolved_share, 7.0 / (double)(count - q.rim_count), 1e-12);
    assert_true(isnan(q.resolved.hex_fraction) && isnan(q.resolved.edge_cv) && isnan(q.resolved.area_cv));
    assert_true(isnan(q.grading_cv) && isnan(q.grading_exponent));
}

/* One far from all others is no neighbour's, and has no cell: it says nothing of how even the others' are. */
static void a_point_on_its_own_has_no_cell(void **state)
{
    (void)state;
    quality q;
    measure_plate(1, 0, 1, &q);
    assert_int_equal(q.unresolved_count, 1);
    assert_close(q.grading_cv, 0, 1e-6);
    assert_close(q.resolved.area_cv, 0, 1e-6);
}

/* The measures over all points see what those over resolved points leave out. */
static void all_points_are_measured_too(void **state)
{
    (void)state;
    quality q;
    measure_plate(1, SIDE, 0, &q);
    assert_true(q.resolved_share == 0 && q.all.hex_fraction > 0.99);
    assert_close(q.all.edge_cv, 0, 1e-6);
    assert_close(q.all.area_cv, 0, 1e-6);
    sheet *s = make_sheet();
    rng r = rng_seed(test_seed(), 5);
    for (int k = 0; k < LATTICE;
         k++) /* facing at random: no point is resolved, nor has cells like its neighbours' */
        s->normal[k].z = rng_uniform(&r) < 0.5 ? -1 : 1;
    measure(s, &q);
    assert_int_equal(q.resolved_count, 0);
    assert_true(q.all.hex_fraction < 0.5 && q.all.area_cv > 0.1);
    for (int k = 0; k < LATTICE; k++)
        assert_true(s->local[k] > 0); /* one without a cell has the requested spacing */
    free(s);
}

/* Half of the lattice has another sheet below it: left out is what faces that, and one row more. */
static void neighbours_of_the_unresolved_are_left_out(void **state)
{
    (void)state;
    enum { ROWS = 20 }; /* the last at 19 sqrt(3) / 2 + 0.3, which sees 1.7^2 - 1 beyond: 1 or 2 rows */
    quality q, whole;
    measure_plate(10, ROWS, 0, &whole);
    measure_plate(1, ROWS, 0, &q);
    assert_int_equal(whole.unresolved_count, 0);
    size_t kept = 2 * LATTICE - (size_t)((SIDE - ROWS) * SIDE) - q.rim_count - q.unresolved_count;
    assert_in_range(kept, (SIDE - ROWS - 6) * (SIDE - 6), (SIDE - ROWS - 3) * (SIDE - 2));
    assert_true(q.resolved.hex_fraction == 1);
    assert_close(q.resolved.area_cv, 0, 1e-6);
    assert_close(q.resolved.edge_cv, 0, 1e-6);
}

/* Two faces that meet at right angles stay in the measures, on either side of the edge. */
static void creases_are_resolved(void **state)
{
    (void)state;
    for (int side = -1; side <= 1; side += 2) {
        sheet *s = make_sheet();
        quality q;
        for (int k = 0; k < LATTICE; k++) {
            double beyond = s->position[k].x - SIDE / 2;
            if (beyond > 0) {
                s->position[k] = (vec3){SIDE / 2, s->position[k].y, -side * beyond};
                s->normal[k] = (vec3){side, 0, 0};
            } else if (beyond == 0)
                s->normal[k] = vec3_unit((vec3){side, 0, 1});
        }
        s->in.domain.min.z = -SIDE;
        s->in.domain.max.z = SIDE;
        measure(s, &q);
        assert_int_equal(q.unresolved_count, 0);
        free(s);
    }
}

/* The report's share is above 2 % by a rounding there. */
static void two_of_a_hundred_are_two_percent(void **state)
{
    (void)state;
    for (size_t k = 1; k <= 1000; k++) {
        quality q = {.unresolved_count = k, .resolved_count = 49 * k};
        assert_true(quality_unresolved_share(&q) <= 0.02);
        q.unresolved_count++;
        assert_true(quality_unresolved_share(&q) > 0.02);
    }
    assert_true(isnan(quality_unresolved_share(&(quality){0})));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lattice_is_perfect),
        cmocka_unit_test(a_part_speaks_for_all),
        cmocka_unit_test(a_moved_point_shows),
        cmocka_unit_test(a_vacancy_makes_defects),
        cmocka_unit_test(points_in_one_place_say_no_more_than_they_can),
        cmocka_unit_test(euler_of_a_sphere_is_two),
        cmocka_unit_test(grading_is_told_from_disorder),
        cmocka_unit_test(disorder_is_told_from_what_is_asked),
        cmocka_unit_test(defects_that_curvature_demands_are_no_disorder),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(energies_are_those_of_all_pairs),
        cmocka_unit_test(partitions_do_not_show),
        cmocka_unit_test(partitions_fit_together),
        cmocka_unit_test(a_point_on_its_own_has_no_cell),
        cmocka_unit_test(sheets_that_are_too_close_are_left_out),
        cmocka_unit_test(a_handful_of_points_says_nothing),
        cmocka_unit_test(all_points_are_measured_too),
        cmocka_unit_test(neighbours_of_the_unresolved_are_left_out),
        cmocka_unit_test(creases_are_resolved),
        cmocka_unit_test(two_of_a_hundred_are_two_percent),
    };
    return cmocka_run_group_tests_name("quality", tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
/* Which cells of a flat lattice are certain: those without a border, a point of another kind or an opposite wall near. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "close.h"
#include "geometry/space/packing.h"
#include "sampling/measures/planar_cells.h"
#include "sampling/packing/point_flags.h"
#include "sampling/voronoi/voronoi.h"

enum { ROWS = 15, MIDDLE = ROWS / 2 * ROWS + ROWS / 2, MOST = 2 * ROWS * ROWS };

/* A lattice of spacing 1 in the plane z = 0, and other points. */
typedef struct sheet {
    size_t count;
    vec3 position[MOST], normal[MOST];
    double spacing[MOST];
    uint8_t flags[MOST];
    uint32_t piece[MOST];
} sheet;

static void add(sheet *s, vec3 x, double up)
{
    s->position[s->count] = x;
    s->normal[s->count] = (vec3){0, 0, up};
    s->spacing[s->count++] = 1;
}

static void add_rows(sheet *s, double z, double up)
{
    for (int row = 0; row < ROWS; row++)
        for (int k = 0; k < ROWS; k++) add(s, (vec3){k + 0.5 * (row % 2), row * sqrt(0.75), z}, up);
}

static sheet *lattice(void)
{
    sheet *s = calloc(1, sizeof *s);
    assert_non_null(s);
    add_rows(s, 0, 1);
    return s;
}

/* The cell of the middle point; frees the sheet. */
static planar_cell middle_cell(sheet *s, double *area)
{
    error e = {0};
    threads *pool = threads_new(1, NULL, &e);
    const partitions_input in = {s->count, s->position, s->normal, s->spacing, NULL, s->flags, VORONOI_REACH};
    partitions all = {0};
    partition part = {0};
    planar_cell cell;
    assert_true(pool && partitions_cut(&in, pool, &all, &e) && partition_fill(&in, &all, 0, pool, &part, &e));
    const uint32_t middle = MIDDLE;
    planar_pairs pairs;
    planar_cells_at(&(planar_points){&part, s->piece, packing_support(1), false}, &middle, 1, &cell, area,
                    &pairs);
    partition_free(&part);
    partitions_free(&all);
    threads_free(pool);
    free(s);
    return cell;
}

static void a_cell_inside_a_lattice_is_certain(void **state)
{
    (void)state;
    double area;
    const planar_cell cell = middle_cell(lattice(), &area);
    assert_true(cell.certain);
    assert_int_equal(cell.degree, 6);
    assert_close(area, sqrt(0.75), 1e-6);
    assert_close(cell.farthest, 1 / sqrt(3), 1e-6);
}

static void a_near_opposite_wall_makes_cells_uncertain(void **state)
{
    (void)state;
    for (double distance = 0.3; distance < 1.1; distance += 0.25) {
        double area;
        sheet *s = lattice();
        add_rows(s, -distance, -1);
        assert_false(middle_cell(s, &area).certain);
    }
}

static void a_far_opposite_wall_leaves_cells_certain(void **state)
{
    (void)state;
    double area;
    sheet *s = lattice();
    add_rows(s, -1.3, -1);
    assert_true(middle_cell(s, &area).certain);
    assert_close(area, sqrt(0.75), 1e-6);
}

static void points_on_curves_and_of_other_pieces_make_cells_uncertain(void **state)
{
    (void)state;
    for (int kind = 0; kind < 3; kind++) {
        double area;
        sheet *s = lattice();
        if (kind == 0) s->flags[MIDDLE + 1] = PACKING_FIXED;
        if (kind == 1) s->piece[MIDDLE + 1] = 1;
        if (kind == 2) s->flags[MIDDLE] = PACKING_FIXED;
        assert_false(middle_cell(s, &area).certain);
    }
}

static void a_vacancy_makes_cells_uncertain(void **state)
{
    (void)state;
    double area;
    sheet *s = lattice();
    s->position[MIDDLE + 1].z = 5;
    assert_false(middle_cell(s, &area).certain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_cell_inside_a_lattice_is_certain),
        cmocka_unit_test(a_near_opposite_wall_makes_cells_uncertain),
        cmocka_unit_test(a_far_opposite_wall_leaves_cells_certain),
        cmocka_unit_test(points_on_curves_and_of_other_pieces_make_cells_uncertain),
        cmocka_unit_test(a_vacancy_makes_cells_uncertain)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
/* Areas of flat cells: of planes in oblique cells against the exact intersection, and of a ball in small
 * cells. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "close.h"
#include "surface/field/flat_cell.h"

/* A cell with these edges from a corner, with the distances from a plane. */
static field_cell cell_of(vec3 from, const vec3 edge[3], vec3 normal, double at)
{
    field_cell c = {.bend = FIELD_FLAT};
    for (int k = 0; k < 8; k++) {
        c.corner[k] = from;
        for (int axis = 0; axis < 3; axis++)
            if (k >> axis & 1) c.corner[k] = vec3_add(c.corner[k], edge[axis]);
        c.value[k] = vec3_dot(normal, c.corner[k]) - at;
    }
    return c;
}

/* The area of a cell among other cells. */
static double area_of(const field_cell *c)
{
    enum { CELLS = 11 };
    field_cell cells[CELLS];
    double area[CELLS];
    for (int k = 0; k < CELLS; k++) {
        cells[k] = *c;
        for (int i = 0; k % 3 > 0 && i < 8; i++) cells[k].value[i] = k % 3 - 1.5;
    }
    flat_cell_areas(cells, CELLS - 1, area);
    for (int k = 0; k < CELLS - 1; k++) assert_true(area[k] == (k % 3 == 0 ? area[0] : 0));
    return area[0];
}

/* The integral of the area of a moving plane is the volume of the cell. */
static void planes_sweep_the_volume(void **state)
{
    enum { STEPS = 2000, CELLS = 3 };
    static const vec3 edges[CELLS][3] = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
                                         {{0.7, 0.1, -0.2}, {0.3, 1.1, 0}, {-0.4, 0.2, 0.5}},
                                         {{-1, 0.2, 0.1}, {0, 0, 2}, {0.1, 3, 0}}},
                      normals[CELLS] = {{0.6, 0, 0.8}, {0.36, 0.48, 0.8}, {-0.8, 0.36, 0.48}};
    (void)state;
    for (int k = 0; k < CELLS; k++) {
        const vec3 *edge = edges[k];
        const field_cell whole = cell_of((vec3){0, 0, 0}, edge, normals[k], 0);
        double low = INFINITY, high = -INFINITY, sum = 0;
        for (int c = 0; c < 8; c++) {
            low = fmin(low, whole.value[c]);
            high = fmax(high, whole.value[c]);
        }
        for (int i = 0; i < STEPS; i++) {
            bbox box = bbox_empty();
            const double at = low + (i + 0.5) / STEPS * (high - low);
            const field_cell c = cell_of((vec3){0, 0, 0}, edge, normals[k], at);
            sum += area_of(&c) * (high - low) / STEPS;
            flat_cell_widen(&c, &box);
            assert_true(box.min.x <= box.max.x);
        }
        const double volume = fabs(vec3_dot(edge[0], vec3_cross(edge[1], edge[2])));
        assert_close(sum, volume, 1e-4 * volume);
    }
}

static void the_box_encloses_the_edges(void **state)
{
    const vec3 edge[3] = {{2, 0, 0}, {0, 2, 0}, {0, 0, 2}};
    const field_cell c = cell_of((vec3){1, 1, 1}, edge, (vec3){0, 0, 1}, 1.5);
    bbox box = bbox_empty();
    (void)state;
    assert_close(area_of(&c), 4, 1e-12);
    flat_cell_widen(&c, &box);
    assert_true(box.min.x == 1 && box.max.y == 3);
    assert_close(box.min.z, 1.5, 1e-12);
    assert_close(box.max.z, 1.5, 1e-12);
}

/* Sums over the cells of a ball centred between their corners. */
typedef struct ball_sums {
    double area, corrected;
} ball_sums;

/* F is the distance or, cubed, a function whose slope differs and varies, in cells of these edges. */
static ball_sums add_up_ball(double radius, const vec3 edge[3], bool is_cubed)
{
    static const vec3 shift = {0.2137, 0.3633, 0.0641};
    const int most = (int)(2.5 * radius);
    ball_sums sums = {0, 0};
    for (int x = -most; x <= most; x++)
        for (int y = -most; y <= most; y++)
            for (int z = -most; z <= most; z++) {
                const vec3 from = vec3_axpy(x, edge[0], vec3_axpy(y, edge[1], vec3_axpy(z, edge[2], shift)));
                if (fabs(vec3_norm(from) - radius) > 4) continue;
                field_cell c = cell_of(from, edge, (vec3){0, 0, 0}, 0);
                for (int k = 0; k < 8; k++) {
                    const double r = vec3_norm(c.corner[k]) / radius;
                    c.value[k] = is_cubed ? r * r * r - 1 : r - 1;
                }
                const double area = area_of(&c);
                if (!(area > 0)) continue;
                const vec3 p = vec3_scale(vec3_add(c.corner[0], c.corner[7]), 0.5);
                const double r = vec3_norm(p), power = is_cubed ? 3 : 1,
                             slope = power * pow(r / radius, power - 1) / radius, across = slope / r,
                             more = (power - 1) * slope / r - across; /* along p beside across it */
                const vec3 n = vec3_scale(p, 1 / r);
                const field_sample middle = {.gradient = vec3_scale(n, slope),
                                             .hessian = {across + more * n.x * n.x, across + more * n.y * n.y,
                                                         across + more * n.z * n.z, more * n.x * n.y,
                                                         more * n.x * n.z, more * n.y * n.z}};
                sums.area += area;
                sums.corrected += area * (1 + flat_cell_shortage(&c, &middle));
            }
    return sums;
}

static const vec3 cube[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};

static double ball_area(double radius)
{
    return 4 * 3.14159265358979323846 * radius * radius;
}

/* A ball of 100 cells, at the limit of FIELD_FLAT_MOST. */
static void a_ball_of_flat_cells_has_its_area(void **state)
{
    const double radius = 1 / FIELD_FLAT_MOST, exact = ball_area(radius);
    (void)state;
    assert_close(add_up_ball(radius, cube, false).area, exact, 3e-5 * exact);
}

/* At the limit of FIELD_GENTLE_MOST, and at twice the limit; by distances, by another function, in oblique
 * cells. */
static void the_area_missing_from_gentle_cells_is_estimated(void **state)
{
    static const vec3 oblique[3] = {{0.9, 0.1, -0.2}, {0.3, 0.8, 0}, {-0.2, 0.2, 0.7}};
    const double radius = 1 / FIELD_GENTLE_MOST;
    (void)state;
    for (int size = 1; size <= 2; size++) {
        const double exact = ball_area(size * radius), off = 1e-5 / size;
        assert_true(add_up_ball(size * radius, cube, false).area < (1 - 1e-3 / size) * exact);
        assert_close(add_up_ball(size * radius, cube, false).corrected, exact, off * exact);
        assert_close(add_up_ball(size * radius, cube, true).corrected, exact, 5 * off * exact);
        assert_close(add_up_ball(size * radius, oblique, false).corrected, exact, 5 * off * exact);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(planes_sweep_the_volume),
                                       cmocka_unit_test(the_box_encloses_the_edges),
                                       cmocka_unit_test(a_ball_of_flat_cells_has_its_area),
                                       cmocka_unit_test(the_area_missing_from_gentle_cells_is_estimated)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

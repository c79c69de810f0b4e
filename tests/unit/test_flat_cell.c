/* Areas of flat cells: of planes in oblique cells against what is cut from them, and of a ball in small ones. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "close.h"
#include "field/flat_cell.h"

/* A cell of these edges from a corner on, with the distances from a plane. */
static field_cell cell_of(vec3 from, const vec3 edge[3], vec3 normal, double at)
{
    field_cell c = {.flat = true};
    for (int k = 0; k < 8; k++) {
        c.corner[k] = from;
        for (int axis = 0; axis < 3; axis++)
            if (k >> axis & 1) c.corner[k] = vec3_add(c.corner[k], edge[axis]);
        c.value[k] = vec3_dot(normal, c.corner[k]) - at;
    }
    return c;
}

/* Of a plane that is moved the areas sum up to the cell's volume. */
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
            sum += flat_cell_area(&c, &box) * (high - low) / STEPS;
            assert_true(box.min.x <= box.max.x);
        }
        const double volume = fabs(vec3_dot(edge[0], vec3_cross(edge[1], edge[2])));
        assert_close(sum, volume, 1e-4 * volume);
    }
}

static void the_box_is_that_of_the_edges(void **state)
{
    const vec3 edge[3] = {{2, 0, 0}, {0, 2, 0}, {0, 0, 2}};
    const field_cell c = cell_of((vec3){1, 1, 1}, edge, (vec3){0, 0, 1}, 1.5);
    bbox box = bbox_empty();
    (void)state;
    assert_close(flat_cell_area(&c, &box), 4, 1e-12);
    assert_true(box.min.x == 1 && box.max.y == 3);
    assert_close(box.min.z, 1.5, 1e-12);
    assert_close(box.max.z, 1.5, 1e-12);
}

/* A ball of 100 cells, as far as FIELD_FLAT goes. */
static void a_ball_of_flat_cells_has_its_area(void **state)
{
    enum { RADIUS = 100 };
    const vec3 edge[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    double area = 0;
    (void)state;
    for (int x = -RADIUS - 1; x <= RADIUS; x++)
        for (int y = -RADIUS - 1; y <= RADIUS; y++) {
            const double rest = (double)RADIUS * RADIUS - x * x - y * y;
            for (int z = -RADIUS - 1; z <= RADIUS; z++) {
                if (fabs(z * (double)z - rest) > 8.0 * RADIUS) continue; /* not near the ball */
                field_cell c = cell_of((vec3){x, y, z}, edge, (vec3){0, 0, 0}, 0);
                bbox box = bbox_empty();
                for (int k = 0; k < 8; k++) c.value[k] = vec3_norm(c.corner[k]) - RADIUS;
                area += flat_cell_area(&c, &box);
            }
        }
    const double exact = 4 * 3.14159265358979323846 * RADIUS * RADIUS;
    assert_close(area, exact, 3e-5 * exact);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(planes_sweep_the_volume),
                                       cmocka_unit_test(the_box_is_that_of_the_edges),
                                       cmocka_unit_test(a_ball_of_flat_cells_has_its_area)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

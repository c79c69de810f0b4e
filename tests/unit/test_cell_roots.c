// SPDX-License-Identifier: Apache-2.0
/* Roots on the edges of cells: each lies on the surface and is found once, with equal results one at a time
 * and in lanes.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "close.h"
#include "shapes.h"
#include "surface/scan/cell_roots.h"

enum { CELLS = ROOT_GROUP_CELLS };

static void roots_of_a_group_are_those_of_its_cells(void **state)
{
    (void)state;
    root_group *g = root_group_new();
    for (int shape = 0; shape < SHAPE_COUNT; shape++) {
        error e = {0};
        analytic *a = analytic_new(&shapes[shape], NULL, &e);
        const field *f = &a->base;
        const size_t all = f->ops->cell_count(f);
        assert_true(all >= CELLS);
        for (size_t first = 0; first + CELLS <= all; first += all / 5) {
            crossed_edge edge[CELLS][CELL_EDGES];
            const corner *root[CELLS][CELL_EDGES];
            field_cell cell[CELLS];
            int count[CELLS];
            root_group_clear(g);
            for (int k = 0; k < CELLS; k++) {
                f->ops->cell(f, first + (size_t)k, &cell[k]);
                count[k] = cell_crossed_edges(&cell[k], edge[k]);
                for (int i = 0; i < count[k]; i++) root[k][i] = root_group_add(g, &cell[k], edge[k][i]);
                for (int i = 0; i < count[k]; i++) /* a repeated edge */
                    assert_ptr_equal(root_group_add(g, &cell[k], edge[k][i]), root[k][i]);
            }
            root_group_find(g, f);
            for (int k = 0; k < CELLS; k++)
                for (int i = 0; i < count[k]; i++) {
                    corner alone;
                    field_sample s;
                    cell_find_root(f, &cell[k], edge[k][i].inside, edge[k][i].outside, false, &alone);
                    assert_int_equal(root[k][i]->smooth, alone.smooth);
                    if (!alone.smooth) continue;
                    const double off = vec3_norm(vec3_sub(root[k][i]->position, alone.position));
                    assert_true(off < 1e-4 * f->cell_size);
                    assert_true(vec3_dot(root[k][i]->normal, alone.normal) > 0.999);
                    assert_true(field_sample_at(f, root[k][i]->position, FIELD_GRADIENT, &s));
                    assert_close(s.value, 0, 1e-4 * f->cell_size * vec3_norm(s.gradient));
                }
        }
        analytic_free(a);
    }
    root_group_free(g);
}

static bool nowhere(const field *f, vec3 x, field_order order, field_sample *out)
{
    (void)f;
    (void)x;
    (void)order;
    (void)out;
    return false;
}

/* A group is reused. A root without a normal must not get the normal of an earlier edge, which would depend
 * on the thread. */
static void a_root_without_a_normal_does_not_reuse_an_earlier_normal(void **state)
{
    (void)state;
    static const field_ops undefined = {.sample = nowhere};
    const field without = {.ops = &undefined, .cell_size = 1};
    root_group *g = root_group_new();
    error e = {0};
    analytic *a = analytic_new(&shapes[0], NULL, &e);
    field_cell cell;
    crossed_edge edge[CELL_EDGES];
    a->base.ops->cell(&a->base, 0, &cell);
    const int count = cell_crossed_edges(&cell, edge);
    assert_true(count > 0);
    for (int round = 0; round < 2; round++) {
        root_group_clear(g);
        const corner *root = root_group_add(g, &cell, edge[0]);
        root_group_find(g, round == 0 ? &a->base : &without);
        assert_int_equal(root->smooth, round == 0);
        assert_true(vec3_norm(root->normal) == 0 || round == 0);
    }
    analytic_free(a);
    root_group_free(g);
}

/* Kuhn's tetrahedra have 19 edges. A plane through the centre of a cell crosses only the edges between its
 * sides. */
static void a_plane_crosses_the_edges_between_its_sides(void **state)
{
    (void)state;
    for (int axis = 0; axis < 3; axis++) {
        field_cell cell = {.bend = FIELD_FLAT};
        crossed_edge edge[CELL_EDGES];
        for (int k = 0; k < 8; k++) cell.value[k] = k >> axis & 1 ? 1 : -1;
        /* 4 along the axis, 4 diagonals of the adjacent faces, and the diagonal of the cell; edges within a
         * side are not crossed */
        assert_int_equal(cell_crossed_edges(&cell, edge), 9);
        for (int i = 0; i < 9; i++)
            assert_true(cell.value[edge[i].inside] < 0 && cell.value[edge[i].outside] > 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(roots_of_a_group_are_those_of_its_cells),
        cmocka_unit_test(a_root_without_a_normal_does_not_reuse_an_earlier_normal),
        cmocka_unit_test(a_plane_crosses_the_edges_between_its_sides),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

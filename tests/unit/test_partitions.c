// SPDX-License-Identifier: Apache-2.0
/* Partitions: every point belongs to one of them, whose lists are those of the whole set. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "base/core/memory.h"
#include "sampling/voronoi/partitions.h"
#include "shapes.h"

enum { COUNT = 260000 };
static const double SPACING = 0.002, CUTOFF = 1.7;

typedef struct fixture {
    vec3 *position, *normal;
    double *spacing;
    threads *pool;
    partitions_input in;
} fixture;

static int set_up(void **state)
{
    fixture *f = mem_alloc(sizeof *f);
    error e = {0};
    rng r = rng_seed(test_seed(), 1);
    f->position = mem_alloc(COUNT * sizeof *f->position);
    f->normal = mem_alloc(COUNT * sizeof *f->normal);
    f->spacing = mem_alloc(COUNT * sizeof *f->spacing);
    for (size_t i = 0; i < COUNT; i++) { /* a surface that is longest along y */
        f->position[i] = random_between(&r, (vec3){0, 0, 0}, (vec3){1, 3, 0.01});
        f->normal[i] = (vec3){0, 0, 1};
        f->spacing[i] = SPACING * (1 + f->position[i].y);
    }
    f->pool = threads_new(2, NULL, &e);
    f->in = (partitions_input){.count = COUNT,
                               .position = f->position,
                               .normal = f->normal,
                               .spacing = f->spacing,
                               .cutoff = CUTOFF};
    *state = f;
    return 0;
}

static int tear_down(void **state)
{
    fixture *f = *state;
    threads_free(f->pool);
    free(f->position);
    free(f->normal);
    free(f->spacing);
    free(f);
    return 0;
}

/* Number of neighbours of point i, except those whose distance equals the cutoff to rounding. */
static size_t count_near(const neighbours *near, size_t i, const vec3 *position, const double *spacing)
{
    size_t count = 0;
    for (uint32_t k = 0; k < near->list_count[i]; k++) {
        uint32_t j = neighbours_list(near, i)[k];
        double reach = (1 - 1e-5) * CUTOFF * 0.5 * (spacing[i] + spacing[j]);
        count += vec3_norm(vec3_sub(position[i], position[j])) < reach;
    }
    return count;
}

static void test_each_point_has_one_owner_with_all_its_neighbours(void **state)
{
    fixture *f = *state;
    error e = {0};
    partitions all;
    assert_true(partitions_cut(&f->in, f->pool, &all, &e));
    assert_int_equal(all.axis, 1);
    assert_true(all.count > 1);
    neighbours *whole = neighbours_new(COUNT, SIZE_MAX, &e);
    assert_true(whole && neighbours_build(whole, COUNT, f->position, f->spacing, CUTOFF, f->pool, &e));
    uint8_t *owners = mem_alloc(COUNT);
    partition part = {0};
    for (size_t k = 0; k < all.count; k++) {
        assert_true(partition_fill(&f->in, &all, k, f->pool, &part, &e));
        for (size_t i = 0; i < part.count; i++) {
            if (i > 0) assert_true(part.index[i - 1] < part.index[i]); /* in the order of the set */
            if (!partition_owns(&part, i)) continue;
            owners[part.index[i]]++;
            assert_int_equal(count_near(part.near, i, part.position, part.spacing),
                             count_near(whole, part.index[i], f->position, f->spacing));
        }
    }
    partition_free(&part);
    for (size_t i = 0; i < COUNT; i++) assert_int_equal(owners[i], 1);
    free(owners);
    neighbours_free(whole);
    partitions_free(&all);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_each_point_has_one_owner_with_all_its_neighbours, set_up,
                                        tear_down),
    };
    return cmocka_run_group_tests_name("partitions", tests, NULL, NULL);
}

/* A tree of boxes finds what looking at each box does, whatever their sizes. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <cmocka.h>

#include "geometry/box_tree.h"
#include "shapes.h"

enum { COUNT = 4000, LOOKS = 2000 };

static double between(double a, double b)
{
    return a + (b - a) * rand() / RAND_MAX;
}

/* Sizes over four powers of ten. */
static vec3 some_size(void)
{
    const double size = pow(10, between(-4, 0));
    return (vec3){size * between(0, 1), size * between(0, 1), size * between(0, 1)};
}

static vec3 some_place(void)
{
    return (vec3){between(-3, 3), between(-2, 2), between(0, 1)};
}

static void check(box_tree *t, const bbox *box, size_t boxes)
{
    for (int k = 0; k < LOOKS; k++) {
        const vec3 x = some_place();
        const double reach = pow(10, between(-4, 0));
        size_t count, seen = 0;
        const uint32_t *found = box_tree_find(t, x, reach, &count);
        for (uint32_t i = 0; i < boxes; i++) {
            if (!bbox_contains(bbox_grow(box[i], reach), x)) continue;
            assert_true(seen < count);
            assert_int_equal(found[seen++], i);
        }
        assert_int_equal(seen, count);
    }
}

static void boxes_of_any_size_are_found(void **state)
{
    (void)state;
    static bbox box[COUNT];
    static const size_t counts[] = {0, 1, 2, 3, 1024, COUNT};
    const unsigned seed = 20050;
    error e = {0};
    printf("seed %u\n", seed);
    srand(seed);
    for (size_t n = 0; n < sizeof counts / sizeof *counts; n++) {
        for (size_t k = 0; k < counts[n]; k++) {
            box[k].min = some_place();
            box[k].max = vec3_add(box[k].min, some_size());
        }
        box_tree *t = box_tree_new(box, counts[n], &e);
        assert_non_null(t);
        check(t, box, counts[n]);
        for (uint32_t k = 0; k < counts[n]; k += 7) { /* some far, some where they are */
            const vec3 x = k % 2 ? some_place() : box[k].max;
            box_tree_extend(t, k, x);
            box[k] = bbox_include(box[k], x);
        }
        check(t, box, counts[n]);
        box_tree_free(t);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(boxes_of_any_size_are_found),
    };
    return cmocka_run_group_tests_name("box_tree", tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
/* Orientations: unit quaternions that rotate +z to the normal, against explicit rotation matrices. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "base/core/rng.h"
#include "close.h"
#include "io/points/quaternion.h"
#include "shapes.h"

static const double EXACT = 1e-14;

/* The columns of the rotation matrix of a unit quaternion, from its textbook form. */
static vec3 column(const double q[4], int k)
{
    const double x = q[0], y = q[1], z = q[2], w = q[3];
    const double m[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)},
                            {2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)},
                            {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)}};
    return vec3_make(m[0][k], m[1][k], m[2][k]);
}

static void check(vec3 normal, double twist)
{
    double q[4], untwisted[4];
    quaternion_of_normal(normal, twist, q);
    quaternion_of_normal(normal, 0, untwisted);
    assert_close(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3], 1, EXACT);
    assert_true(q[3] >= 0);
    assert_close(vec3_norm(vec3_sub(column(q, 2), normal)), 0, EXACT);
    assert_close(untwisted[2], 0, 0); /* the shortest rotation has no component about z */
    assert_close(untwisted[3], sqrt(fmax(1 + normal.z, 0) / 2), 1e-8);
    /* the twist rotates +x in the plane perpendicular to the normal */
    const vec3 x = column(untwisted, 0), y = column(untwisted, 1);
    assert_close(vec3_norm(vec3_sub(column(q, 0), vec3_axpy(sin(twist), y, vec3_scale(x, cos(twist))))), 0,
                 1e-13);
    for (int k = 0; k < 3; k++) {
        const vec3 axis = vec3_make(k == 0, k == 1, k == 2);
        assert_close(vec3_norm(vec3_sub(quaternion_rotate(q, axis), column(q, k))), 0, EXACT);
    }
}

static void any_normal_is_that_of_plus_z(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    for (int k = 0; k < 2000; k++) check(random_direction(&r), 20 * rng_uniform(&r) - 10);
}

static void normals_along_and_against_z_have_a_shortest_way(void **state)
{
    (void)state;
    for (int s = -1; s <= 1; s += 2)
        for (double side = 0; side<1e-3; side = side> 0 ? 10 * side : 1e-300)
            check(vec3_unit(vec3_make(side, -side, s)), 0.7);
    double q[4];
    quaternion_of_normal(vec3_make(0, 0, 1), 0, q);
    assert_true(q[0] == 0 && q[1] == 0 && q[2] == 0 && q[3] == 1);
    quaternion_of_normal(vec3_make(0, 0, -1), 0, q);
    assert_close(q[0], 1, EXACT);
}

static void a_vector_is_where_plus_x_turns(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    for (int k = 0; k < 500; k++) {
        const vec3 n = random_direction(&r), v = vec3_scale(random_direction(&r), 3);
        const vec3 tangent = vec3_unit(vec3_axpy(-vec3_dot(v, n), n, v));
        double q[4];
        quaternion_of_normal(n, quaternion_twist_along(n, v), q);
        assert_close(vec3_norm(vec3_sub(column(q, 0), tangent)), 0, 1e-9);
    }
    assert_close(quaternion_twist_along(vec3_make(0, 0, 1), vec3_make(0, 0, 5)), 0, 0);
    assert_close(quaternion_twist_along(vec3_make(0, 0, 1), vec3_make(0, 0, 0)), 0, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(any_normal_is_that_of_plus_z),
        cmocka_unit_test(normals_along_and_against_z_have_a_shortest_way),
        cmocka_unit_test(a_vector_is_where_plus_x_turns),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

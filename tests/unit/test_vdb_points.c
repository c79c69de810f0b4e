// SPDX-License-Identifier: Apache-2.0
/* vdb: points grids are written and read back; equal points give equal bytes. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "point_set.h"
#include "io/vdb/vdb.h"
#include "vdb_points_reader.h"

enum { MOST_BYTES = 1 << 22 };

static vdb_points points_of(const point_set *s, double voxel_size)
{
    return (vdb_points){.count = s->points.count,
                        .position = &s->position[0].x,
                        .normal = &s->normal[0].x,
                        .spacing = s->points.spacing_local,
                        .voxel_size = voxel_size};
}

static int write_points(const vdb_points *grid)
{
    error e = {0};
    char path[] = "test_vdb_points_XXXXXX";
    int fd = mkstemp(path);
    assert_true(fd >= 0);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    unlink(path);
    if (!vdb_write_points(file, grid, &e)) fail_msg("%s", e.message);
    fclose(file);
    return fd;
}

/* Near the origin and far from it, in one voxel and in many. */
static void points_are_read_back(void **state)
{
    (void)state;
    static const vec3 centers[] = {{0, 0, 0}, {1e6, -3e5, 7}};
    static const double voxels[] = {10, 0.3, 0.01};
    for (int c = 0; c < 2; c++)
        for (int v = 0; v < 3; v++) {
            error e = {0};
            point_set s = point_set_sphere(1000, centers[c], 1);
            const vdb_points grid = points_of(&s, voxels[v]);
            int fd = write_points(&grid);
            if (!vdb_points_compare(fd, &grid, &e)) fail_msg("%s", e.message);
            close(fd);
            point_set_free(&s);
        }
}

static void a_million_points_are_read_back(void **state)
{
    (void)state;
    error e = {0};
    point_set s = point_set_sphere(1000000, vec3_make(3, -2, 1), 1);
    const vdb_points grid = points_of(&s, 0.01);
    int fd = write_points(&grid);
    if (!vdb_points_compare(fd, &grid, &e)) fail_msg("%s", e.message);
    s.position[999999].z += 1e-3;
    assert_false(vdb_points_compare(fd, &grid, &e));
    assert_non_null(strstr(e.message, "position of point 999999"));
    close(fd);
    point_set_free(&s);
}

static void orientations_are_read_back(void **state)
{
    (void)state;
    point_set s = point_set_sphere(200, vec3_make(0, 0, 0), 1);
    double orient[200][4];
    for (int i = 0; i < 200; i++)
        for (int k = 0; k < 4; k++) orient[i][k] = i == 7 ? (k == 3) : 0.25 * k - 0.001 * i;
    vdb_points grid = points_of(&s, 0.3);
    grid.orient = orient[0];
    error e = {0};
    int fd = write_points(&grid);
    if (!vdb_points_compare(fd, &grid, &e)) fail_msg("%s", e.message);
    orient[7][3] = 0.5;
    assert_false(vdb_points_compare(fd, &grid, &e));
    assert_non_null(strstr(e.message, "orient of point 7"));
    close(fd);
    point_set_free(&s);
}

static void what_differs_is_told(void **state)
{
    (void)state;
    point_set s = point_set_sphere(100, vec3_make(0, 0, 0), 1);
    vdb_points grid = points_of(&s, 0.3);
    int fd = write_points(&grid);
    error e = {0};
    s.position[7].y += 1e-4;
    assert_false(vdb_points_compare(fd, &grid, &e));
    assert_non_null(strstr(e.message, "position of point 7"));
    s.position[7].y -= 1e-4;
    s.normal[8].x += 1e-3;
    assert_false(vdb_points_compare(fd, &grid, &e));
    assert_non_null(strstr(e.message, "normal of point 8"));
    s.normal[8].x -= 1e-3;
    s.scalar[6][9] *= 1.001;
    assert_false(vdb_points_compare(fd, &grid, &e));
    assert_non_null(strstr(e.message, "pscale of point 9"));
    s.scalar[6][9] /= 1.001;
    grid.count = 99;
    assert_false(vdb_points_compare(fd, &grid, &e));
    grid.count = 100;
    for (off_t end = lseek(fd, 0, SEEK_END) - 1; end > 0; end -= 97) {
        assert_int_equal(ftruncate(fd, end), 0);
        if (vdb_points_compare(fd, &grid, NULL)) fail_msg("accepted its first %ld bytes", (long)end);
    }
    close(fd);
    point_set_free(&s);
}

static void ids_and_velocities_are_read_back(void **state)
{
    (void)state;
    static uint32_t id[500];
    static vec3 velocity[500];
    point_set s = point_set_sphere(500, vec3_make(1, 2, 3), 1);
    vdb_points grid = points_of(&s, 0.1);
    for (uint32_t i = 0; i < 500; i++) {
        id[i] = 4000000000u - 7 * i;
        velocity[i] = vec3_make(i, -0.5, 1e-3 * i);
    }
    grid.id = id;
    grid.velocity = &velocity[0].x;
    int fd = write_points(&grid);
    error e = {0};
    if (!vdb_points_compare(fd, &grid, &e)) fail_msg("%s", e.message);
    velocity[3].y = 1;
    assert_false(vdb_points_compare(fd, &grid, &e));
    assert_non_null(strstr(e.message, "velocity of point 3"));
    velocity[3].y = -0.5;
    id[4]++;
    assert_false(vdb_points_compare(fd, &grid, &e));
    assert_non_null(strstr(e.message, "an id"));
    close(fd);
    point_set_free(&s);
}

static void other_values_are_read_back(void **state)
{
    (void)state;
    static double heat[300], wind[900], label[300], uv[600], weight[900];
    const vdb_point_values values[] = {{"heat", 1, false, false, heat},
                                       {"v", 3, false, false, wind},
                                       {"label", 1, true, false, label},
                                       {"uv", 2, false, false, uv},
                                       {"weight", 3, false, true, weight}};
    point_set s = point_set_sphere(300, vec3_make(1, 2, 3), 1);
    vdb_points grid = points_of(&s, 0.1);
    for (int i = 0; i < 300; i++) {
        heat[i] = 0.25 * i;
        label[i] = 4000000000.0 - i;
        for (int k = 0; k < 3; k++) wind[3 * i + k] = k - 0.5 * i;
        for (int k = 0; k < 3; k++) weight[3 * i + k] = 1.0 / (3 * i + k + 1);
        for (int k = 0; k < 2; k++) uv[2 * i + k] = 1.0 / (i + k + 1);
    }
    grid.value_count = 5;
    grid.values = values;
    int fd = write_points(&grid);
    error e = {0};
    if (!vdb_points_compare(fd, &grid, &e)) fail_msg("%s", e.message);
    double *const changed[] = {&heat[7], &wind[22], &label[7], &uv[15], &weight[23]};
    for (int k = 0; k < 5; k++) {
        double kept = *changed[k];
        char words[40];
        snprintf(words, sizeof words, "%s of point 7", values[k].name);
        *changed[k] += values[k].is_double ? 1e-12 : 1;
        assert_false(vdb_points_compare(fd, &grid, &e));
        assert_non_null(strstr(e.message, words));
        *changed[k] = kept;
    }
    close(fd);
    point_set_free(&s);
}

static void the_same_points_give_the_same_bytes(void **state)
{
    (void)state;
    static char bytes[3][MOST_BYTES];
    ssize_t length[3];
    point_set s = point_set_sphere(2000, vec3_make(1, 2, 3), 1);
    for (int k = 0; k < 3; k++) {
        if (k == 2) s.scalar[6][0] *= 2;
        const vdb_points grid = points_of(&s, 0.1);
        int fd = write_points(&grid);
        length[k] = pread(fd, bytes[k], MOST_BYTES, 0);
        assert_in_range(length[k], 1000, MOST_BYTES - 1);
        close(fd);
    }
    assert_int_equal(length[0], length[1]);
    assert_memory_equal(bytes[0], bytes[1], (size_t)length[0]);
    assert_memory_not_equal(bytes[0] + 21, bytes[2] + 21, 36); /* the identifier depends on the contents */
    point_set_free(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_are_read_back),
        cmocka_unit_test(orientations_are_read_back),
        cmocka_unit_test(what_differs_is_told),
        cmocka_unit_test(ids_and_velocities_are_read_back),
        cmocka_unit_test(other_values_are_read_back),
        cmocka_unit_test(the_same_points_give_the_same_bytes),
        cmocka_unit_test(a_million_points_are_read_back),
    };
    return cmocka_run_group_tests_name("vdb_points", tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
/* Attributes from grids of every readable type, which Debian's pyopenvdb cannot write: values at samples and
 * between them. tests/service/test_attributes.py compares the interpolation with scipy.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cmocka.h>

#include "job/attributes/attribute.h"
#include "io/vdb/vdb.h"

enum { SIDE = 4, VOXELS = SIDE * SIDE * SIDE, PLACES = 27 };

static const double to_world[16] = {0.5, 0, 0, 1, 0, 0.25, 0, 2, 0, 0, 2, 3, 0, 0, 0, 1};

/* A whole number, which every type represents. */
static float value_at(int x, int y, int z)
{
    return (float)((7 * x + 11 * y + 13 * z + x * y * z) % 17 - 5);
}

static int open_grid(const char *type)
{
    static int32_t voxel[VOXELS][3];
    static float value[VOXELS];
    error e = {0};
    for (int k = 0; k < VOXELS; k++) {
        const int at[3] = {k % SIDE, k / SIDE % SIDE, k / SIDE / SIDE};
        for (int a = 0; a < 3; a++) voxel[k][a] = at[a];
        value[k] = strcmp(type, "bool") == 0 ? (float)(value_at(at[0], at[1], at[2]) > 0)
                                             : value_at(at[0], at[1], at[2]);
    }
    const vdb_draft draft = {.name = "grid",
                             .type = type,
                             .index_to_world = to_world,
                             .voxel_count = VOXELS,
                             .voxels = (const int32_t(*)[3])voxel,
                             .values = value};
    int fd = memfd_create("grid", MFD_CLOEXEC);
    assert_true(fd >= 0);
    if (!vdb_write_grids(fd, &draft, 1, VDB_SEEKABLE, true, &e)) fail_msg("%s: %s", type, e.message);
    return fd;
}

/* Trilinear interpolation between the eight surrounding samples. */
static double linear(double x, double y, double z)
{
    int i = (int)x, j = (int)y, k = (int)z;
    double sum = 0;
    for (int c = 0; c < 8; c++) {
        int a = c & 1, b = c >> 1 & 1, d = c >> 2;
        double weight = (a ? x - i : 1 - x + i) * (b ? y - j : 1 - y + j) * (d ? z - k : 1 - z + k);
        sum += weight * (double)value_at(i + a, j + b, k + d);
    }
    return sum;
}

static void check_type(const char *type, point_attribute_kind kind, int components)
{
    error e = {0};
    point_attribute_kind found;
    int count;
    vec3 place[PLACES];
    double value[3 * PLACES];
    attribute_counts counts = {0};
    const attribute_request request = {.fd = open_grid(type),
                                       .path = "a.vdb",
                                       .name = "grid",
                                       .stencil = STENCIL_LINEAR,
                                       .from_file = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}},
                                       .memory_limit = (size_t)64 << 20};
    for (int n = 0; n < PLACES; n++) /* from samples to between them */
        place[n] = vec3_make(1 + 0.5 * (0.4 + n % 3), 2 + 0.25 * (0.7 + n / 3 % 3), 3 + 2 * (0.2 + n / 9));
    if (!attribute_find(&request, &found, &count, &e)) fail_msg("%s: %s", type, e.message);
    assert_int_equal(found, kind);
    assert_int_equal(count, components);
    assert_true(attribute_read(&request, PLACES, place, value, &counts, &e));
    for (int n = 0; n < PLACES; n++) {
        double x = (place[n].x - 1) / 0.5, y = (place[n].y - 2) / 0.25, z = (place[n].z - 3) / 2;
        double nearest = (double)value_at((int)(x + 0.5), (int)(y + 0.5), (int)(z + 0.5));
        bool whole = kind == POINT_ATTRIBUTE_INT || strcmp(type, "vec3i") == 0;
        double meant = strcmp(type, "bool") == 0 ? nearest > 0 : whole ? nearest : linear(x, y, z);
        for (int c = 0; c < components; c++)
            if (fabs(value[components * n + c] - meant) > 1e-12)
                fail_msg("%s: %g where %g is meant, place %d", type, value[components * n + c], meant, n);
    }
    assert_int_equal(counts.outside, 0);
    assert_int_equal(counts.not_finite, 0);
    close(request.fd);
}

static void test_grids_of_every_type(void **state)
{
    (void)state;
    check_type("float", POINT_ATTRIBUTE_FLOAT, 1);
    check_type("double", POINT_ATTRIBUTE_FLOAT, 1);
    check_type("int32", POINT_ATTRIBUTE_INT, 1);
    check_type("int64", POINT_ATTRIBUTE_INT, 1);
    check_type("bool", POINT_ATTRIBUTE_INT, 1);
    check_type("vec3s", POINT_ATTRIBUTE_VECTOR, 3);
    check_type("vec3d", POINT_ATTRIBUTE_VECTOR, 3);
    check_type("vec3i", POINT_ATTRIBUTE_VECTOR, 3);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_grids_of_every_type)};
    return cmocka_run_group_tests_name("attribute", tests, NULL, NULL);
}

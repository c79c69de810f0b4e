// SPDX-License-Identifier: Apache-2.0
/* Segmentations in OpenVDB files, which Debian's pyopenvdb cannot write: the choice of the grid, its
 * transform, its background, volumes under the majority filter, and thin parts. tests/service/test_labels.py
 * tests other labels.
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

#include "base/core/memory.h"
#include "surface/field/patches.h"
#include "surface/labels/label_majority.h"
#include "surface/labels/label_thinness.h"
#include "job/source/label_source.h"
#include "io/vdb/vdb.h"

enum { SIDE = 8, VOXELS = SIDE * SIDE * SIDE };

static const double to_world[16] = {0.5, 0, 0, 1, 0, 0.25, 0, 2, 0, 0, 2, 3, 0, 0, 0, 1};

/* A cube of two labels, one half each. */
static int write_halves(const char *const *types, size_t count, float one, float other)
{
    static int32_t voxel[VOXELS][3];
    static float value[VOXELS];
    vdb_draft draft[2];
    error e = {0};
    for (int k = 0; k < VOXELS; k++) {
        const int at[3] = {k % SIDE, k / SIDE % SIDE, k / SIDE / SIDE};
        for (int a = 0; a < 3; a++) voxel[k][a] = at[a] - 3;
        value[k] = at[0] < SIDE / 2 ? one : other;
    }
    for (size_t k = 0; k < count; k++)
        draft[k] = (vdb_draft){.name = k == 0 ? "parts" : "others",
                               .type = types[k],
                               .index_to_world = to_world,
                               .voxel_count = VOXELS,
                               .voxels = (const int32_t(*)[3])voxel,
                               .values = value};
    int fd = memfd_create("grids", MFD_CLOEXEC);
    assert_true(fd >= 0);
    if (!vdb_write_grids(fd, draft, count, VDB_SEEKABLE, true, &e)) fail_msg("%s", e.message);
    return fd;
}

static int write_grids(const char *const *types, size_t count)
{
    return write_halves(types, count, 3, -7);
}

static label_surface *open_grids(int fd, char *grid, error *e)
{
    char path[] = "labels.vdb";
    const spec_labels labels = {.path = path, .grid = grid};
    const label_source_request request = {.fd = fd, .how = {.spec = &labels, .memory_limit = 64 << 20}};
    label_surface *s = label_source_open(&request, e);
    close(fd);
    return s;
}

static void assert_two_halves(const label_surface *s)
{
    const double sides[3][2] = {{-7, 0}, {-7, 3}, {0, 3}};
    const field *f = label_surface_field(s);
    bool seen[3] = {false};
    assert_int_equal(f->patches->count, 3);
    for (uint32_t p = 0; p < 3; p++) {
        int64_t found[2];
        label_surface_sides(s, p, found);
        for (int k = 0; k < 3; k++)
            if ((double)found[0] == sides[k][0] && (double)found[1] == sides[k][1]) {
                assert_false(seen[k]);
                seen[k] = true;
                /* between the halves: sides of 8 voxels of 0.25 and 2, ends halfway to the background */
                if (k == 1) assert_true(fabs(f->patches->patch[p].area - 32) < 3);
            }
    }
    assert_true(seen[0] && seen[1] && seen[2]);
    /* no interface ends at the boundary of the active voxels */
    for (size_t c = 0; c < f->patches->curve_count; c++)
        assert_int_equal(f->patches->curve[c].patch_count, 3);
    const bbox box = f->domain;
    assert_true(box.min.x < 1 - 1.5 && box.max.x > 1 + 2 && box.min.z < 3 - 6 && box.max.z > 3 + 8);
}

static void test_grids_of_whole_numbers(void **state)
{
    (void)state;
    const char *const types[] = {"int32", "int64"};
    for (size_t k = 0; k < 2; k++) {
        error e = {0};
        label_surface *s = open_grids(write_grids(&types[k], 1), NULL, &e);
        if (!s) fail_msg("%s: %s", types[k], e.message);
        assert_two_halves(s);
        label_surface_close(s);
    }
}

/* Powers of two, which the floats of a draft hold. */
static void test_large_numbers_of_a_grid(void **state)
{
    (void)state;
    const char *const types[] = {"int64"};
    error e = {0};
    int64_t labels[2];
    label_surface *s = open_grids(write_halves(types, 1, 0x1p52F, -0x1p40F), NULL, &e);
    if (!s) fail_msg("%s", e.message);
    assert_int_equal(label_surface_labels(s, 2, labels), 3); /* the background is 0 */
    assert_true(labels[0] == -((int64_t)1 << 40) && labels[1] == 0);
    label_surface_close(s);
    assert_null(open_grids(write_halves(types, 1, 3, -0x1p60F), NULL, &e));
    assert_int_equal(e.code, ERROR_INPUT_UNSUPPORTED);
    assert_non_null(strstr(e.message, "the value -1152921504606846976 is not a label"));
}

/* The work memory of a thread is larger than these voxels. */
static void test_the_memory_of_a_majority(void **state)
{
    (void)state;
    char path[] = "labels.vdb";
    const char *const types[] = {"int32"};
    const spec_labels labels = {.path = path, .majority = 8};
    const int fd = write_grids(types, 1);
    const label_source_request request = {.fd = fd, .how = {.spec = &labels, .memory_limit = 2 << 20}};
    error e = {0};
    assert_null(label_source_open(&request, &e));
    close(fd);
    assert_int_equal(e.code, ERROR_LIMIT_MEMORY);
    assert_non_null(
        strstr(e.message, "/surface/labels/majority requires 3 MiB, and 2 MiB of the limit are left"));
}

/* ---- the majority */

enum { WIDE = 70, DEEP = 40, MANY = WIDE * DEEP * DEEP, MATERIALS = 4 };

/* Two balls, and a slab of three voxels, in a background. */
static uint16_t shape_at(int x, int y, int z)
{
    const int one = (x - 14) * (x - 14) + (y - 15) * (y - 15) + (z - 20) * (z - 20),
              two = (x - 38) * (x - 38) + (y - 22) * (y - 22) + (z - 19) * (z - 19);
    return x >= 60 && x < 63 ? 3 : two < 100 ? 2 : one < 49 ? 1 : 0;
}

static label_volume make_shapes(void)
{
    error e = {0};
    label_volume v = {.size = {WIDE, DEEP, DEEP},
                      .index_to_world = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1.5, 0}},
                      .count = MATERIALS};
    v.at = mem_array(MANY, sizeof *v.at, "voxels", &e);
    v.material = mem_array(MATERIALS, sizeof *v.material, "materials", &e);
    assert_true(v.at && v.material);
    for (int k = 0; k < MANY; k++) {
        const int at[3] = {k % WIDE, k / WIDE % DEEP, k / WIDE / DEEP};
        v.at[k] = shape_at(at[0], at[1], at[2]);
        label_material_note(&v.material[v.at[k]], (const int64_t[3]){at[0], at[1], at[2]});
    }
    return v;
}

/* The filter alone would remove half of the small ball and all of the slab. */
static void test_a_majority_keeps_volumes_with_any_number_of_threads(void **state)
{
    uint16_t first[MANY];
    (void)state;
    for (int workers = 1; workers <= 3; workers++) {
        error e = {0};
        threads *pool = threads_new(workers, NULL, &e);
        label_volume v = make_shapes();
        if (!label_majority_apply(&v, 3, 64 << 20, pool, &e)) fail_msg("%s", e.message);
        for (int k = 0; k < MATERIALS; k++) {
            const double had = (double)v.material[k].before, has = (double)v.material[k].voxels;
            if (fabs(has - had) > fmax(1, 0.002 * had)) fail_msg("label %d: %g of %g voxels", k, has, had);
        }
        assert_true(v.changed > 0);
        if (workers == 1) memcpy(first, v.at, sizeof first);
        assert_memory_equal(v.at, first, sizeof first);
        label_volume_free(&v);
        threads_free(pool);
    }
}

/* The memory of kept voxels is counted during the filter. */
static void test_the_memory_of_voxels_kept_by_a_majority(void **state)
{
    (void)state;
    size_t needed = 0;
    for (size_t mb = 1; mb < 64 && needed == 0; mb++) {
        error e = {0};
        label_volume v = make_shapes();
        if (label_majority_apply(&v, 3, mb << 20, NULL, &e))
            needed = mb;
        else
            assert_int_equal(e.code, ERROR_LIMIT_MEMORY);
        for (int k = 0; needed == 0 && k < MANY; k++)
            assert_int_equal(v.at[k], shape_at(k % WIDE, k / WIDE % DEEP, k / WIDE / DEEP));
        label_volume_free(&v);
    }
    assert_in_range(needed, 3, 6);
}

/* ---- thin parts */

/* Rows of four voxels each with random labels. */
static uint16_t drawn_at(int x, int y, int z)
{
    const uint32_t once = (uint32_t)(x / 4 + 31 * y + 977 * z) * 2654435761U,
                   drawn = (once ^ once >> 15) * 2246822519U;
    return drawn >> 16 & 1;
}

enum { LONG = 31, HIGH = 14, FAR = 13 };

/* Whether one of the eight cubes of side 2 voxels that contain the voxel has its label only. */
static bool is_in_cube(int x, int y, int z)
{
    bool any = false;
    for (int corner = 0; corner < 8; corner++) {
        const int low[3] = {x - (corner & 1), y - (corner >> 1 & 1), z - (corner >> 2)};
        bool all = true;
        for (int k = 0; k < 8; k++) {
            const int at[3] = {low[0] + (k & 1), low[1] + (k >> 1 & 1), low[2] + (k >> 2)};
            all &= at[0] >= 0 && at[0] < LONG && at[1] >= 0 && at[1] < HIGH && at[2] >= 0 && at[2] < FAR &&
                   drawn_at(at[0], at[1], at[2]) == drawn_at(x, y, z);
        }
        any |= all;
    }
    return any;
}

static void test_voxels_in_no_cube_are_thin(void **state)
{
    (void)state;
    error e = {0};
    uint64_t thin[MATERIALS] = {0};
    label_volume v = {.size = {LONG, HIGH, FAR}, .count = MATERIALS};
    threads *pool = threads_new(1, NULL, &e);
    v.at = mem_array(LONG * HIGH * FAR, sizeof *v.at, "voxels", &e);
    v.material = mem_array(MATERIALS, sizeof *v.material, "materials", &e);
    assert_true(pool && v.at && v.material);
    for (int k = 0; k < LONG * HIGH * FAR; k++) {
        const int at[3] = {k % LONG, k / LONG % HIGH, k / LONG / HIGH};
        v.at[k] = drawn_at(at[0], at[1], at[2]);
        thin[v.at[k]] += !is_in_cube(at[0], at[1], at[2]);
    }
    label_thinness_find(&v, pool);
    for (int k = 0; k < MATERIALS; k++) assert_int_equal(v.material[k].thin, thin[k]);
    assert_in_range(thin[0] + thin[1], 1, LONG * HIGH * FAR - 1);
    label_volume_free(&v);
    threads_free(pool);
}

static void test_the_grid_is_chosen_by_name_and_type(void **state)
{
    (void)state;
    const char *const both[] = {"int32", "int64"}, *const one[] = {"float", "int32"},
                      *const none[] = {"float"};
    char others[] = "others", parts[] = "parts";
    error e = {0};
    assert_null(open_grids(write_grids(both, 2), NULL, &e));
    assert_int_equal(e.code, ERROR_GRID_AMBIGUOUS);
    assert_null(open_grids(write_grids(none, 1), NULL, &e));
    assert_int_equal(e.code, ERROR_GRID_MISSING);
    assert_null(open_grids(write_grids(one, 2), parts, &e));
    assert_int_equal(e.code, ERROR_INPUT_UNSUPPORTED);
    for (int named = 0; named < 2; named++) {
        label_surface *s = open_grids(write_grids(one, 2), named ? others : NULL, &e);
        assert_non_null(s);
        assert_two_halves(s);
        label_surface_close(s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_grids_of_whole_numbers),
        cmocka_unit_test(test_the_grid_is_chosen_by_name_and_type),
        cmocka_unit_test(test_large_numbers_of_a_grid),
        cmocka_unit_test(test_the_memory_of_a_majority),
        cmocka_unit_test(test_a_majority_keeps_volumes_with_any_number_of_threads),
        cmocka_unit_test(test_the_memory_of_voxels_kept_by_a_majority),
        cmocka_unit_test(test_voxels_in_no_cube_are_thin)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
/* Maps: values at voxels, between them and beyond them. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "close.h"
#include "surface/volume/map.h"
#include "volume_fixture.h"

static double slope(vec3 x)
{
    return 2 + 0.3 * x.x - 0.2 * x.y + 0.5 * x.z;
}

/* Opens the fixture as a map of this name. */
static map *open_map(const fixture *g, const char *name, double background, error *e)
{
    vdb_draft draft = fixture_draft(g);
    draft.background = background;
    draft.name = "size";
    int fd = fixture_write(&draft, 1, VDB_SEEKABLE, true);
    map *m = map_open(fd, "a.vdb", name, FIXTURE_MEMORY, e);
    close(fd);
    return m;
}

/* A linear function of space is reproduced exactly, under any transform. */
static void linear_functions_are_exact(void **state)
{
    (void)state;
    const double *const matrices[] = {fixture_uniform, fixture_nonuniform, fixture_rotated, fixture_mirrored};
    uint64_t seed = 7;
    for (size_t k = 0; k < 4; k++) {
        error e = {0};
        fixture g = fixture_make(matrices[k], 10, slope, 0);
        map *m = open_map(&g, "size", 0, &e);
        if (!m) fail_msg("%s", e.message);
        assert_true(map_memory(m) > 0);
        for (int n = 0; n < 200; n++) {
            const double *t = matrices[k];
            double i = 18 * fixture_random(&seed) - 9, j = 18 * fixture_random(&seed) - 9,
                   l = 18 * fixture_random(&seed) - 9;
            vec3 x = {t[0] * i + t[1] * j + t[2] * l + t[3], t[4] * i + t[5] * j + t[6] * l + t[7],
                      t[8] * i + t[9] * j + t[10] * l + t[11]};
            assert_close(map_value(m, x), slope(x), 1e-5);
        }
        map_close(m);
        fixture_free(&g);
    }
}

static void undefined_regions_have_the_background_value(void **state)
{
    (void)state;
    error e = {0};
    fixture g = fixture_make(fixture_uniform, 5, slope, 0);
    map *silent = open_map(&g, "size", 0, &e), *spoken = open_map(&g, "size", 0.7, &e);
    vec3 outside = {0.9, 0, 0}, rim = {0.52, 0, 0}, nowhere = {1e300, 0, 0};
    assert_true(isnan(map_value(silent, outside)) && isnan(map_value(silent, nowhere)));
    assert_close(map_value(spoken, outside), 0.7, 1e-6);
    assert_close(map_value(spoken, nowhere), 0.7, 1e-6);
    double last = slope((vec3){0.5, 0, 0});
    assert_close(map_value(silent, rim), last, 1e-5); /* from the active voxels only */
    assert_close(map_value(spoken, rim), 0.8 * last + 0.2 * 0.7, 1e-5);
    map_close(silent);
    map_close(spoken);
    fixture_free(&g);
}

static void faults_name_the_grid(void **state)
{
    (void)state;
    error e = {0};
    fixture g = fixture_make(fixture_uniform, 4, slope, 0);
    fixture_set(&g, 1, 2, -3, INFINITY, true);
    assert_null(open_map(&g, "size", 0, &e));
    assert_int_equal(e.code, ERROR_INPUT_DAMAGED);
    assert_non_null(strstr(e.message, "a.vdb: grid \"size\": the voxel (1, 2, -3) is not finite"));
    assert_null(open_map(&g, "sizes", 0, &e));
    assert_int_equal(e.code, ERROR_GRID_MISSING);
    fixture_free(&g);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(linear_functions_are_exact),
        cmocka_unit_test(undefined_regions_have_the_background_value),
        cmocka_unit_test(faults_name_the_grid),
    };
    return cmocka_run_group_tests_name("map", tests, NULL, NULL);
}

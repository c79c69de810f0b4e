// SPDX-License-Identifier: Apache-2.0
/* Real files: every volume of the shared data, and every hostile one, gives its points or its error. If the
 * data are missing, the tests are skipped with a message.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <dirent.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "volume_fixture.h"

#define SEED 4711u
#define POINTS 4000

typedef struct expectation {
    const char *file, *grid;
    double isovalue;        /* NAN: none is given */
    error_code code;        /* ERROR_NONE: it opens */
    const char *word;       /* in the error's message */
    double least_projected; /* fraction of the cells from which Newton's method reaches the surface */
} expectation;

static const expectation vdb_files[] = {
    {"bifrost_torus01.vdb", NULL, 50, ERROR_NONE, NULL, 1},
    {"bifrost_torus01.vdb", NULL, NAN, ERROR_ISOVALUE_REQUIRED, "voxel_fog_density", 0},
    {"blender_smoke_000001.vdb", NULL, 0.3, ERROR_GRID_AMBIGUOUS, "shadow", 0},
    {"blender_smoke_000001.vdb", "density", 0.3, ERROR_NO_SURFACE, "no active voxel", 0},
    {"blender_smoke_000001.vdb", "obstacles", 0.3, ERROR_INPUT_UNSUPPORTED, "int32", 0},
    {"blender_smoke_000002.vdb", "density", 0.3, ERROR_NONE, NULL, 0.95},
    {"blender_smoke_000003.vdb", "density", 0.3, ERROR_NONE, NULL, 0.95},
    {"densityAndHeat.vdb", "density", 0.3, ERROR_NONE, NULL, 0.95},
    {"densityAndHeat.vdb", "heat", 0.3, ERROR_NONE, NULL, 0.95},
    {"densityAndHeat.vdb", NULL, 0.3, ERROR_GRID_AMBIGUOUS, "heat", 0},
    {"gaffer_sphere.vdb", NULL, 0.5, ERROR_NONE, NULL, 1},
    {"houdini_three_density.vdb", "density", 5, ERROR_GRID_AMBIGUOUS, "density[2]", 0},
    {"houdini_three_density.vdb", "density[0]", 5, ERROR_NONE, NULL, 0.95},
    {"houdini_three_density.vdb", "density[1]", 5, ERROR_NONE, NULL, 0.95},
    {"houdini_three_density.vdb", "density[2]", 5, ERROR_NONE, NULL, 0.95},
    {"houdini_three_density.vdb", "density[3]", 5, ERROR_GRID_MISSING, "density[2]", 0},
    {"houdini_vel_vec3.vdb", "vel", 0.3, ERROR_INPUT_UNSUPPORTED, "vec3s", 0},
    {"houdini_vel_vec3.vdb", NULL, 0.3, ERROR_INPUT_UNSUPPORTED, "no scalar grid", 0},
    {"hsim_empty_density.vdb", NULL, 0.3, ERROR_NO_SURFACE, "no active voxel", 0},
    {"ls_cube_half.vdb", NULL, NAN, ERROR_NONE, NULL, 1},
    {"ls_sphere_half.vdb", "ls_sphere", NAN, ERROR_NONE, NULL, 1},
    {"ls_sphere_half.vdb", NULL, 0.14, ERROR_INPUT_UNSUPPORTED, "narrow band", 0},
    {"ls_sphere_half.vdb", NULL, 1, ERROR_NO_SURFACE, "isovalue 1", 0},
    {"monkey_mantaflow.vdb", "density", 0.3, ERROR_NONE, NULL, 0.95},
    {"monkey_mantaflow.vdb", "flame", 0.3, ERROR_NO_SURFACE, "no active voxel", 0},
    {"monkey_mantaflow.vdb", "shadow", 0.3, ERROR_NO_SURFACE, "lowest value, -1, and below its highest, 0",
     0},
    {"monkey_mantaflow.vdb", "velocity", 0.3, ERROR_INPUT_UNSUPPORTED, "vec3s", 0},
    {"nebula_5grids.vdb", "distance", NAN, ERROR_NONE, NULL, 1},
    {"nebula_5grids.vdb", "density", 0.3, ERROR_NONE, NULL, 0.95},
    {"nebula_5grids.vdb", "color.x", 0.1, ERROR_NONE, NULL, 0.95},
    {"oiio_sphere.vdb", NULL, 0.5, ERROR_NONE, NULL, 1},
    {"oiio_sphereCd.vdb", NULL, 0.5, ERROR_INPUT_UNSUPPORTED, "vec3s", 0},
    {"pointgrid.vdb", NULL, 0.5, ERROR_INPUT_UNSUPPORTED, "ptdataidx32", 0},
    {"smoke1_half.vdb", NULL, 0.3, ERROR_NONE, NULL, 0.95},
    {"vpt_box_bg1.vdb", NULL, 0.5, ERROR_NO_SURFACE, "are 1", 0},
    {"vpt_dragon_fog.vdb", NULL, 0.3, ERROR_NONE, NULL, 0.95},
    {"vpt_dragon_rotated_xform.vdb", NULL, 0.3, ERROR_NONE, NULL, 0.95},
    {"wdas_cloud_sixteenth.vdb", NULL, 0.2, ERROR_NONE, NULL, 0.95},
    {"zeno_ls_sphere_unnamed.vdb", "", NAN, ERROR_NONE, NULL, 1},
    {"zeno_ls_sphere_unnamed.vdb", "ls", NAN, ERROR_GRID_MISSING, "\"\"", 0},
};

static void check(const char *folder, const expectation *x)
{
    char path[5000];
    error e = {0};
    snprintf(path, sizeof path, "%s/%s/%s", fixture_shared(), folder, x->file);
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0) fail_msg("%s cannot be opened", path);
    volume *v = fixture_open(fd, x->grid, x->isovalue, VOLUME_INTERPOLATING, &e);
    close(fd);
    if (x->code != ERROR_NONE) {
        assert_null(v);
        if (e.code != x->code || !strstr(e.message, x->word))
            fail_msg("%s: %s instead of %s with '%s': %s", x->file, error_code_name(e.code),
                     error_code_name(x->code), x->word, e.message);
        return;
    }
    if (!v) fail_msg("%s: %s", x->file, e.message);
    const field *f = volume_field(v);
    uint64_t seed = SEED;
    double cells = (double)f->ops->cell_count(f);
    int projected = 0;
    vec3 p;
    for (int i = 0; i < POINTS; i++) {
        vec3 start = fixture_cell_center(f, (size_t)(fixture_random(&seed) * cells));
        projected += fixture_project(f, start, &p);
    }
    print_message("# %s %s: %.0f cells, %.4f of the starts reach the surface\n", x->file,
                  volume_describe(v)->grid, cells, (double)projected / POINTS);
    assert_true(projected >= x->least_projected * POINTS);
    volume_close(v);
}

static void every_volume(void **state)
{
    (void)state;
    print_message("# seed %u\n", SEED);
    for (size_t i = 0; i < sizeof vdb_files / sizeof *vdb_files; i++) check("vdb", &vdb_files[i]);
}

static void every_volume_of_the_data_is_tested(void **state)
{
    (void)state;
    char path[5000];
    snprintf(path, sizeof path, "%s/vdb", fixture_shared());
    DIR *listing = opendir(path);
    assert_non_null(listing);
    for (struct dirent *entry = readdir(listing); entry; entry = readdir(listing)) {
        if (!strstr(entry->d_name, ".vdb")) continue;
        size_t i = 0, count = sizeof vdb_files / sizeof *vdb_files;
        while (i < count && strcmp(vdb_files[i].file, entry->d_name) != 0) i++;
        if (i == count) fail_msg("nothing is expected of %s", entry->d_name);
    }
    closedir(listing);
}

static void hostile_volumes(void **state)
{
    (void)state;
    static const expectation lfs = {"git_lfs_pointer.vdb", NULL, NAN, ERROR_INPUT_DAMAGED, "git lfs pull", 0};
    static const expectation cut = {"truncated.vdb", NULL, 0.5, ERROR_INPUT_DAMAGED, "truncated", 0};
    /* Their bounding boxes are metadata, which are ignored; none of the files has a voxel. */
    static const char *const boxes[] = {"bad-bbox-bomb.vdb",     "bad-bbox-huge.vdb",
                                        "bad-bbox-inverted.vdb", "bad-bbox-overflow.vdb",
                                        "bad-bbox-roundup.vdb",  "bad-bbox-empty.vdb"};
    check("malformed", &lfs);
    check("malformed/openvdb_damaged", &cut);
    for (size_t i = 0; i < sizeof boxes / sizeof *boxes; i++) {
        const expectation empty = {boxes[i], NULL, 0.5, ERROR_NO_SURFACE, "no active voxel", 0};
        check("malformed/openvdb_damaged", &empty);
    }
}

static int by_size(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void the_sphere_is_a_sphere(void **state)
{
    (void)state;
    /* Radius 3, voxel 0.05, stored as half floats. */
    char path[5000];
    error e = {0};
    snprintf(path, sizeof path, "%s/vdb/ls_sphere_half.vdb", fixture_shared());
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    volume *v = fixture_open(fd, NULL, NAN, VOLUME_INTERPOLATING, &e);
    close(fd);
    if (!v) fail_msg("%s", e.message);
    const field *f = volume_field(v);
    static double miss[POINTS], k1[POINTS], k2[POINTS];
    uint64_t seed = SEED;
    double mean = 0;
    for (int i = 0; i < POINTS; i++) {
        double u = 2 * fixture_random(&seed) - 1, angle = 2 * M_PI * fixture_random(&seed),
               r = sqrt(1 - u * u);
        vec3 p;
        field_sample s;
        assert_true(fixture_project(f, (vec3){2.98 * r * cos(angle), 2.98 * r * sin(angle), 2.98 * u}, &p));
        assert_true(field_sample_at(f, p, FIELD_HESSIAN, &s));
        field_curvature(&s, &k1[i], &k2[i]);
        miss[i] = (vec3_norm(p) - 3) / 0.05;
        mean += miss[i] / POINTS;
        miss[i] = fabs(miss[i]);
    }
    qsort(miss, POINTS, sizeof *miss, by_size);
    qsort(k1, POINTS, sizeof *k1, by_size);
    qsort(k2, POINTS, sizeof *k2, by_size);
    print_message("# sphere: median %.6f, largest %.6f, mean %.6f voxel; curvatures %.5f %.5f of 1/3\n",
                  miss[POINTS / 2], miss[POINTS - 1], mean, 3 * k1[POINTS / 2], 3 * k2[POINTS / 2]);
    assert_true(miss[POINTS / 2] <= 0.0005 && miss[POINTS - 1] <= 0.01 && fabs(mean) <= 0.002);
    assert_true(fabs(3 * k1[POINTS / 2] - 1) < 0.02 && fabs(3 * k2[POINTS / 2] - 1) < 0.02);
    volume_close(v);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_volume),
        cmocka_unit_test(every_volume_of_the_data_is_tested),
        cmocka_unit_test(hostile_volumes),
        cmocka_unit_test(the_sphere_is_a_sphere),
    };
    if (!fixture_shared()) {
        printf(
            "1..0 # SKIP the shared data are not there (HEXAD_SHARED, or shared/data beside the source)\n");
        return 0;
    }
    return cmocka_run_group_tests_name("volume data", tests, NULL, NULL);
}

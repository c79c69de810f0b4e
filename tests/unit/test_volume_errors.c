// SPDX-License-Identifier: Apache-2.0
/* Messages about volumes that cannot be opened. No content of a file causes more than an error. */
#include <dirent.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "io/volumes/exr_stack.h"
#include "volume_fixture.h"

#define SEED 777u
#define FLIPS 24

static double ball(vec3 p)
{
    return vec3_norm(p) - 0.6;
}
static double fog_ball(vec3 p)
{
    return fmin(1, fmax(0, 0.5 - 3 * ball(p)));
}

/* Checks that opening fails with the code and a message with each of the words (NULL ends them). */
static void expect(int fd, const char *grid, double isovalue, error_code code, const char *const words[])
{
    error e = {0};
    volume *v = fixture_open(fd, grid, isovalue, VOLUME_INTERPOLATING, &e);
    assert_null(v);
    if (e.code != code)
        fail_msg("%s instead of %s: %s", error_code_name(e.code), error_code_name(code), e.message);
    if (!strstr(e.message, "test.vdb")) fail_msg("does not name the file: %s", e.message);
    for (; *words; words++)
        if (!strstr(e.message, *words)) fail_msg("does not say '%s': %s", *words, e.message);
}

#define WORDS(...) ((const char *const[]){__VA_ARGS__, NULL})

static void the_choice_of_the_grid(void **state)
{
    (void)state;
    fixture g = fixture_make(fixture_uniform, 11, ball, 0.3),
            fog = fixture_make(fixture_uniform, 11, fog_ball, 0);
    vdb_draft d[6];
    for (int i = 0; i < 6; i++) d[i] = fixture_draft(i < 4 ? &g : &fog);
    d[0].name = "velocity";
    d[0].type = "vec3s";
    d[1].name = "ids";
    d[1].type = "int32";
    d[2].name = d[4].name = "density";
    d[3].name = "";
    d[4].grid_class = VDB_UNKNOWN;
    d[5].name = "smoke";
    int fd = fixture_write(d, 6, VDB_SEEKABLE, true);
    expect(fd, NULL, NAN, ERROR_GRID_AMBIGUOUS,
           WORDS("\"density[0]\"", "\"density[1]\"", "\"\"", "smoke", "4 scalar"));
    expect(fd, "density", NAN, ERROR_GRID_AMBIGUOUS, WORDS("density[0]", "density[1]"));
    expect(fd, "density[2]", NAN, ERROR_GRID_MISSING, WORDS("density[2]", "velocity", "smoke"));
    expect(fd, "pressure", NAN, ERROR_GRID_MISSING, WORDS("pressure", "velocity", "vec3s"));
    expect(fd, "velocity", NAN, ERROR_INPUT_UNSUPPORTED, WORDS("velocity", "vec3s"));
    expect(fd, "ids", NAN, ERROR_INPUT_UNSUPPORTED, WORDS("ids", "int32"));
    expect(fd, "smoke", NAN, ERROR_ISOVALUE_REQUIRED, WORDS("smoke", "fog"));
    expect(fd, "density[1]", NAN, ERROR_ISOVALUE_REQUIRED, WORDS("density[1]", "level set"));
    const char *const good[] = {"", "density[0]", "density[1]", "smoke"};
    for (size_t i = 0; i < 4; i++) {
        error e = {0};
        volume *v = fixture_open(fd, good[i], i < 2 ? NAN : 0.5, VOLUME_INTERPOLATING, &e);
        if (!v) fail_msg("%s: %s", good[i], e.message);
        assert_string_equal(volume_describe(v)->grid, good[i]);
        assert_int_equal(volume_describe(v)->level_set, i < 2);
        assert_int_equal(volume_describe(v)->warning_count, i == 2);
        volume_close(v);
    }
    close(fd);
    fd = fixture_write(d, 2, VDB_SEEKABLE, true);
    expect(fd, NULL, NAN, ERROR_INPUT_UNSUPPORTED, WORDS("no scalar grid", "velocity", "ids"));
    close(fd);
    fd = fixture_write(d, 0, VDB_SEEKABLE, true);
    expect(fd, NULL, NAN, ERROR_GRID_MISSING, WORDS("no grid"));
    expect(fd, "x", NAN, ERROR_GRID_MISSING, WORDS("\"x\""));
    close(fd);
    fixture_free(&g);
    fixture_free(&fog);
}

static void what_is_not_a_volume(void **state)
{
    (void)state;
    static const char pointer[] = "version https://git-lfs.github.com/spec/v1\noid sha256:12ab\nsize 123\n";
    static const char text[] = "ply\nformat ascii 1.0\n";
    unsigned char future[64] = {0x20, 0x42, 0x44, 0x56, 0, 0, 0, 0, 0xE8, 3};
    const struct {
        const void *bytes;
        size_t count;
        error_code code;
        const char *word;
    } cases[] = {{pointer, sizeof pointer - 1, ERROR_INPUT_DAMAGED, "git lfs pull"},
                 {text, sizeof text - 1, ERROR_INPUT_DAMAGED, "not an OpenVDB file"},
                 {"", 0, ERROR_INPUT_DAMAGED, "empty"},
                 {"abc", 3, ERROR_INPUT_DAMAGED, "not an OpenVDB file"},
                 {future, 9, ERROR_INPUT_DAMAGED, "truncated"},
                 {future, sizeof future, ERROR_INPUT_UNSUPPORTED, "version 1000"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int fd = fixture_bytes(cases[i].bytes, cases[i].count);
        expect(fd, NULL, NAN, cases[i].code, WORDS(cases[i].word));
        close(fd);
    }
    int ends[2];
    assert_int_equal(pipe(ends), 0);
    expect(ends[0], NULL, NAN, ERROR_INPUT_DAMAGED, WORDS("regular file"));
    close(ends[0]);
    close(ends[1]);
}

static void volumes_without_a_surface(void **state)
{
    (void)state;
    vdb_draft empty = {.name = "nothing",
                       .type = "float",
                       .grid_class = VDB_LEVEL_SET,
                       .background = 0.3,
                       .index_to_world = fixture_uniform};
    int fd = fixture_write(&empty, 1, VDB_SEEKABLE, true);
    expect(fd, NULL, NAN, ERROR_NO_SURFACE, WORDS("nothing", "no active voxel"));
    close(fd);
    fixture fog = fixture_make(fixture_uniform, 11, fog_ball, 0);
    vdb_draft d = fixture_draft(&fog);
    fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
    expect(fd, NULL, 7.5, ERROR_NO_SURFACE,
           WORDS("surface", "7.5", "above its lowest value, 0, and below its highest, 1"));
    expect(fd, NULL, INFINITY, ERROR_SPEC_INVALID, WORDS("isovalue"));
    close(fd);
    fixture_free(&fog);
}

/* Fogs with a constant value around and inside, which is the isovalue: oscillations of the spline are no
 * surface. */
static void plateaus_are_no_surface(void **state)
{
    (void)state;
    for (int k = 0; k < 3; k++) {
        fixture fog = fixture_make(fixture_uniform, 11, fog_ball, 0);
        /* one voxel below the isovalue does not affect the others */
        if (k == 2) fixture_set(&fog, 11, 11, 11, -1, true);
        for (size_t n = 0; k == 1 && n < fog.draft.voxel_count; n++) fog.values[n] += 0.1f;
        if (k == 1) fog.draft.background += 0.1f;
        vdb_draft d = fixture_draft(&fog);
        int fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
        expect(fd, NULL, k == 1 ? 0.1 : 0, ERROR_NO_SURFACE,
               WORDS("as where the background has this value", k == 0   ? "in 100 %"
                                                               : k == 1 ? "above 0.1 and below 1.1"
                                                                        : "above 0 and below 1"));
        close(fd);
        fixture_free(&fog);
    }
}

/* Distances of a ball in voxels, some of them distorted, or clamped although the band continues. */
static double distances[2]; /* units in a world unit, and the clamp */
static double ball_in_units(vec3 p)
{
    return fmin(distances[1], fmax(-distances[1], distances[0] * ball(p)));
}

static double bent_ball(vec3 p)
{
    return ball(p) * (1.5 + p.x);
}

static void offsets_are_world_distances(void **state)
{
    (void)state;
    static const double units[] = {1, 10, 0.25};
    for (int k = 0; k < 3; k++) {
        error e = {0};
        distances[0] = units[k];
        distances[1] = 0.35 * units[k];
        fixture g = fixture_make(fixture_uniform, 14, ball_in_units, 0.5 * units[k]);
        vdb_draft d = fixture_draft(&g);
        int fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
        volume_request r = {
            .fd = fd, .path = "a.vdb", .offset = 0.1, .memory_limit = FIXTURE_MEMORY, .isa = isa_best()};
        volume *v = volume_open(&r, &e);
        if (!v) fail_msg("%s", e.message);
        vec3 at;
        assert_true(fixture_project(volume_field(v), (vec3){0.4, 0.3, 0.5}, &at));
        assert_true(fabs(ball(at) - 0.1) < 2e-3);
        assert_int_equal(volume_describe(v)->warning_count, units[k] != 1);
        volume_close(v);
        r.offset = 0.345;
        assert_null(volume_open(&r, &e)); /* at the clamp */
        if (!strstr(e.message, "an offset requires distances")) fail_msg("%s", e.message);
        close(fd);
        fixture_free(&g);
    }
    error e = {0};
    fixture g = fixture_make(fixture_uniform, 14, bent_ball, 0.5);
    vdb_draft d = fixture_draft(&g);
    int fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
    const volume_request r = {
        .fd = fd, .path = "a.vdb", .offset = 0.1, .memory_limit = FIXTURE_MEMORY, .isa = isa_best()};
    assert_null(volume_open(&r, &e));
    if (!strstr(e.message, "in one place of the surface and")) fail_msg("%s", e.message);
    close(fd);
    fixture_free(&g);
    g = fixture_make(fixture_uniform, 14, ball, 0.5);
    d = fixture_draft(&g);
    fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
    const volume_request gone = {
        .fd = fd, .path = "a.vdb", .offset = -7, .memory_limit = FIXTURE_MEMORY, .isa = isa_best()};
    assert_null(volume_open(&gone, &e));
    assert_int_equal(e.code, ERROR_NO_SURFACE);
    if (!strstr(e.message, "at an offset of -7 has no surface")) fail_msg("%s", e.message);
    close(fd);
    fixture_free(&g);
}

static double box_on_voxels(vec3 p)
{
    return fmax(fabs(p.x), fmax(fabs(p.y), fabs(p.z))) - 0.8;
}

/* A box whose faces lie on voxels, also on the faces of blocks: samples of 0 with other samples beyond
 * them. */
static void zeros_on_the_surface_are_no_plateau(void **state)
{
    (void)state;
    fixture g = fixture_make(fixture_uniform, 14, box_on_voxels, 0.4);
    volume *v = fixture_volume(&g, NAN, VOLUME_INTERPOLATING);
    assert_true(volume_describe(v)->crossing_cells >= 16 * 16 * 16 - 14 * 14 * 14);
    volume_close(v);
    fixture_free(&g);
}

static void bands_that_do_not_hold_the_surface(void **state)
{
    (void)state;
    fixture thin = fixture_make(fixture_uniform, 11, ball, 0.08),
            cut = fixture_make(fixture_uniform, 11, ball, 0.3);
    vdb_draft d = fixture_draft(&thin);
    int fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
    expect(fd, NULL, NAN, ERROR_INPUT_UNSUPPORTED,
           WORDS("clamped at 0.08 (0.8 voxels)", "half-width of at least 3 voxels"));
    close(fd);
    d = fixture_draft(&cut);
    fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
    expect(fd, NULL, 0.25, ERROR_INPUT_UNSUPPORTED,
           WORDS("narrow band", "0.25", "half-width of at least 6 voxels"));
    close(fd);
    /* A missing voxel beside the surface, inactive; and the same voxel active but clamped. */
    fixture_set(&cut, 6, 0, 0, 0.3f, false);
    fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
    expect(fd, NULL, NAN, ERROR_INPUT_UNSUPPORTED, WORDS("cut open"));
    close(fd);
    fixture_set(&cut, 6, 0, 0, 0.3f, true);
    fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
    expect(fd, NULL, NAN, ERROR_INPUT_UNSUPPORTED, WORDS("clamped"));
    close(fd);
    fixture_free(&thin);
    fixture_free(&cut);
}

static void values_that_are_not_finite(void **state)
{
    (void)state;
    error e = {0};
    fixture fog = fixture_make(fixture_uniform, 30, fog_ball, 0);
    vdb_draft d = fixture_draft(&fog);
    fixture_set(&fog, -30, -30, -30, NAN, true); /* 40 voxels from the surface, where it has no effect */
    int fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
    volume *v = fixture_open(fd, NULL, 0.5, VOLUME_INTERPOLATING, &e);
    if (!v) fail_msg("%s", e.message);
    volume_close(v);
    expect(fd, NULL, 3, ERROR_NO_SURFACE, WORDS("not finite"));
    close(fd);
    fixture_set(&fog, 8, 0, 0, INFINITY, true);
    fixture_set(&fog, 6, 2, 1, NAN, true);
    fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
    expect(fd, NULL, 0.5, ERROR_INPUT_DAMAGED, WORDS("2 voxels", "not finite", "surface"));
    close(fd);
    fixture_free(&fog);
}

/* No leaf of the grid has such a value. */
static void tiles_that_are_not_finite(void **state)
{
    (void)state;
    fixture fog = fixture_make(fixture_uniform, 12, fog_ball, 0);
    const vdb_tile tile = {{16, 0, 0}, 8, NAN, true};
    vdb_draft d = fixture_draft(&fog);
    d.tile_count = 1;
    d.tiles = &tile;
    int fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
    expect(fd, NULL, 0.5, ERROR_INPUT_DAMAGED, WORDS("512 voxels", "not finite", "(16, 0, 0)"));
    close(fd);
    d.tile_count = 0;
    d.background = NAN;
    fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
    expect(fd, NULL, 0.5, ERROR_INPUT_DAMAGED, WORDS("voxels", "not finite"));
    close(fd);
    fixture_free(&fog);
}

static void coordinates_at_the_limits_of_int32(void **state)
{
    (void)state;
    static const int32_t edges[][3] = {
        {INT32_MAX - 1, 0, 0}, {0, INT32_MIN + 1, 0}, {5, 5, INT32_MAX}, {INT32_MIN, INT32_MIN, INT32_MIN}};
    const float value = 1;
    for (size_t i = 0; i < sizeof edges / sizeof *edges; i++) {
        vdb_draft d = {.name = "edge",
                       .type = "float",
                       .grid_class = VDB_FOG,
                       .index_to_world = fixture_uniform,
                       .voxel_count = 1,
                       .voxels = &edges[i],
                       .values = &value};
        int fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
        expect(fd, NULL, 0.5, ERROR_INPUT_UNSUPPORTED, WORDS("limits of 32-bit index coordinates"));
        close(fd);
    }
    const vdb_tile tile = {{INT32_MAX - 4095, 0, 0}, 4096, 1, true};
    vdb_draft d = {.name = "edge",
                   .type = "float",
                   .grid_class = VDB_FOG,
                   .index_to_world = fixture_uniform,
                   .tile_count = 1,
                   .tiles = &tile};
    int fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
    expect(fd, NULL, 0.5, ERROR_INPUT_UNSUPPORTED, WORDS("limits of 32-bit index coordinates"));
    close(fd);
    /* Far away, but not at the limit: two voxels whose distance overflows int32. */
    const int32_t far[2][3] = {{2000000000, 0, 0}, {-2000000000, 7, 7}};
    const float values[2] = {1, 1};
    d.tile_count = 0;
    d.voxel_count = 2;
    d.voxels = far;
    d.values = values;
    fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
    error e = {0};
    volume *v = fixture_open(fd, NULL, 0.5, VOLUME_INTERPOLATING, &e);
    if (!v) fail_msg("%s", e.message);
    assert_int_equal(volume_describe(v)->crossing_cells, 16);
    assert_true(fabs(volume_field(v)->extent - 4e8) < 1);
    volume_close(v);
    close(fd);
}

static void the_limit_of_memory(void **state)
{
    (void)state;
    fixture g = fixture_make(fixture_uniform, 11, ball, 0.3);
    vdb_draft d = fixture_draft(&g);
    int fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
    const size_t limits[] = {1000, 100000, 200000};
    for (size_t i = 0; i < 3; i++) {
        error e = {0};
        volume_request r = {.fd = fd, .path = "test.vdb", .memory_limit = limits[i]};
        assert_null(volume_open(&r, &e));
        if (e.code != ERROR_LIMIT_MEMORY) fail_msg("%s: %s", error_code_name(e.code), e.message);
        assert_non_null(strstr(e.message, "limits.memory_mb"));
    }
    close(fd);
    /* A million blocks of surface from a file of a few hundred bytes. */
    const vdb_tile tile = {{0, 0, 0}, 4096, 1, true};
    vdb_draft bomb = {.name = "bomb",
                      .type = "float",
                      .grid_class = VDB_FOG,
                      .index_to_world = fixture_uniform,
                      .tile_count = 1,
                      .tiles = &tile};
    fd = fixture_write(&bomb, 1, VDB_SEEKABLE, true);
    error e = {0};
    volume_request r = {.fd = fd,
                        .path = "test.vdb",
                        .has_isovalue = true,
                        .isovalue = 0.5,
                        .memory_limit = (size_t)64 << 20};
    assert_null(volume_open(&r, &e));
    if (e.code != ERROR_LIMIT_MEMORY) fail_msg("%s: %s", error_code_name(e.code), e.message);
    close(fd);
    fixture_free(&g);
}

/* The memory of a volume is within the smallest limit with which it opens, also if a fifth of its leaves is
 * unused but kept. */
static void memory_use_is_within_the_limit(void **state)
{
    (void)state;
    enum { SIDE = 16, USED = SIDE * SIDE * SIDE, UNUSED = 1200 };
    int32_t(*voxels)[3] = mem_alloc((USED + UNUSED) * sizeof *voxels);
    float *values = mem_alloc((USED + UNUSED) * sizeof *values);
    bool *active = mem_alloc((USED + UNUSED) * sizeof *active);
    for (int k = 0; k < USED + UNUSED; k++) {
        const bool is_ball = k < USED;
        voxels[k][0] = is_ball ? 8 * (k % SIDE) + 4 : 8000 + 8 * k;
        voxels[k][1] = is_ball ? 8 * (k / SIDE % SIDE) + 4 : 0;
        voxels[k][2] = is_ball ? 8 * (k / SIDE / SIDE) + 4 : 0;
        values[k] = is_ball ? 1 : 0.1f;
        active[k] = true;
    }
    const vdb_draft d = {.name = "balls",
                         .type = "float",
                         .grid_class = VDB_FOG,
                         .index_to_world = fixture_uniform,
                         .voxel_count = USED + UNUSED,
                         .voxels = voxels,
                         .values = values,
                         .active = active};
    const int fd = fixture_write(&d, 1, VDB_SEEKABLE, true);
    size_t too_small = 0, enough = FIXTURE_MEMORY, held = 0;
    while (enough - too_small > (size_t)1 << 18) {
        const size_t limit = too_small + (enough - too_small) / 2;
        error e = {0};
        const volume_request r = {.fd = fd,
                                  .path = "test.vdb",
                                  .has_isovalue = true,
                                  .isovalue = 0.5,
                                  .points = 1,
                                  .memory_limit = limit,
                                  .isa = isa_best()};
        volume *v = volume_open(&r, &e);
        if (!v) assert_int_equal(e.code, ERROR_LIMIT_MEMORY);
        *(v ? &enough : &too_small) = limit;
        if (v) held = volume_describe(v)->memory_bytes;
        volume_close(v);
    }
    print_message("# %zu bytes are held, %zu are enough\n", held, enough);
    assert_in_range(held, 1, enough);
    close(fd);
    free(voxels);
    free(values);
    free(active);
}

static size_t slurp(int fd, unsigned char **bytes);

/* Replaces every occurrence of the doubles in the file by `to`. */
static void patch(unsigned char *bytes, size_t size, const double *from, size_t count, double to)
{
    for (size_t at = 0; at + sizeof to <= size; at++)
        for (size_t i = 0; i < count; i++)
            if (memcmp(bytes + at, &from[i], sizeof to) == 0) memcpy(bytes + at, &to, sizeof to);
}

static void transforms_that_cannot_be(void **state)
{
    (void)state;
    fixture g = fixture_make(fixture_rotated, 6, fog_ball, 0);
    vdb_draft d = fixture_draft(&g);
    d.index_to_world = NULL;
    int fd = fixture_write(&d, 1, VDB_SEEKABLE, false);
    expect(fd, NULL, 0.5, ERROR_INPUT_UNSUPPORTED, WORDS("surface", "frustum", "affine"));
    close(fd);
    /* Damaged matrices: the scales along the axes, and the first axis of the rotated one. */
    const double *const matrices[] = {fixture_uniform, fixture_nonuniform, fixture_rotated};
    const double values[] = {0, 1e-200, NAN, INFINITY};
    for (size_t m = 0; m < 3; m++)
        for (size_t i = 0; i < 4; i++) {
            unsigned char *bytes;
            const double column[3] = {matrices[m][0], matrices[m][4], matrices[m][8]};
            d.index_to_world = matrices[m];
            int whole = fixture_write(&d, 1, VDB_SEEKABLE, false);
            size_t size = slurp(whole, &bytes);
            patch(bytes, size, column, m == 2 ? 3 : 1, values[i]);
            fd = fixture_bytes(bytes, size);
            expect(fd, NULL, 0.5, ERROR_INPUT_UNSUPPORTED, WORDS("surface", "transform"));
            close(fd);
            close(whole);
            free(bytes);
        }
    fixture_free(&g);
}

static size_t slurp(int fd, unsigned char **bytes)
{
    size_t size = (size_t)lseek(fd, 0, SEEK_END);
    *bytes = mem_alloc(size);
    assert_int_equal(pread(fd, *bytes, size, 0), (ssize_t)size);
    return size;
}

/* The last position of these bytes. */
static unsigned char *find_bytes(unsigned char *bytes, size_t size, const void *wanted, size_t count)
{
    unsigned char *found = NULL, *at = bytes;
    while ((at = memmem(at, size - (size_t)(at - bytes), wanted, count))) found = at++;
    assert_non_null(found);
    return found;
}

/* Values by which the library would allocate memory or recurse: the type of a transform, and of a transform
 * within another. */
static void names_of_transforms(void **state)
{
    (void)state;
    static const uint32_t most = INT32_MAX;
    static const char *const kinds[] = {"UniformScaleMap",
                                        "AffineMap"}; /* of the fixture, and within its frustum */
    fixture g = fixture_make(fixture_uniform, 2, fog_ball, 0);
    vdb_draft d = fixture_draft(&g);
    for (int inner = 0; inner < 2; inner++) {
        unsigned char *bytes;
        if (inner) d.index_to_world = NULL;
        int whole = fixture_write(&d, 1, VDB_SEEKABLE, false);
        size_t size = slurp(whole, &bytes);
        memcpy(find_bytes(bytes, size, kinds[inner], strlen(kinds[inner])) - sizeof most, &most, sizeof most);
        int fd = fixture_bytes(bytes, size);
        expect(fd, NULL, 0.5, ERROR_INPUT_DAMAGED, WORDS("a name of 2147483647 bytes"));
        close(fd);
        close(whole);
        free(bytes);
    }
    fixture_free(&g);
}

/* The version follows the magic number. A file of the next version is read as the library reads it. */
static void versions_of_the_format(void **state)
{
    (void)state;
    fixture g = fixture_make(fixture_uniform, 6, fog_ball, 0);
    vdb_draft d = fixture_draft(&g);
    for (int k = 0; k < 3; k++) {
        unsigned char *bytes;
        uint32_t version;
        int whole = fixture_write(&d, 1, VDB_SEEKABLE, true);
        size_t size = slurp(whole, &bytes);
        memcpy(&version, bytes + 8, sizeof version);
        version = k == 0 ? version + 1 : k == 1 ? 10000 : 100;
        memcpy(bytes + 8, &version, sizeof version);
        int fd = fixture_bytes(bytes, size);
        if (k > 0) {
            expect(fd, NULL, 0.5, ERROR_INPUT_UNSUPPORTED,
                   k == 1 ? WORDS("10000", "far newer than") : WORDS("100", "current OpenVDB"));
        } else {
            error e = {0};
            volume *v = fixture_open(fd, NULL, 0.5, VOLUME_INTERPOLATING, &e);
            if (!v) fail_msg("%s", e.message);
            volume_close(v);
        }
        close(fd);
        close(whole);
        free(bytes);
    }
    fixture_free(&g);
}

/* A boolean of nine bytes: the library reads one byte, and would interpret the others as the length of a
 * name. */
static void lengths_of_metadata(void **state)
{
    (void)state;
    /* magic number, three versions, whether there are offsets, an identifier */
    static const size_t head = 57;
    static const char entry[] = "\1\0\0\0a\4\0\0\0bool\x9\0\0\0\1\xff\xff\xff\x7f\0\0\0";
    fixture g = fixture_make(fixture_uniform, 6, fog_ball, 0);
    vdb_draft d = fixture_draft(&g);
    unsigned char *bytes, *longer;
    error e = {0};
    int whole = fixture_write(&d, 1, VDB_STREAM, false);
    size_t size = slurp(whole, &bytes);
    longer = mem_alloc(size + sizeof entry);
    memcpy(longer, bytes, head + 4);
    longer[head]++;
    memcpy(longer + head + 4, entry, sizeof entry);
    memcpy(longer + head + 4 + sizeof entry, bytes + head + 4, size - head - 4);
    int fd = fixture_bytes(longer, size + sizeof entry);
    volume *v = fixture_open(fd, NULL, 0.5, VOLUME_INTERPOLATING, &e);
    if (!v) fail_msg("%s", e.message);
    volume_close(v);
    close(fd);
    close(whole);
    free(longer);
    free(bytes);
    fixture_free(&g);
}

static void parts_of_trees_lie_on_their_grid(void **state)
{
    (void)state;
    static const int32_t corner[3] = {12288, 4096, 8192};
    const vdb_tile tile = {{corner[0], corner[1], corner[2]}, 4096, 1, true};
    vdb_draft d = {.name = "tile",
                   .type = "float",
                   .grid_class = VDB_FOG,
                   .index_to_world = fixture_uniform,
                   .tile_count = 1,
                   .tiles = &tile};
    unsigned char *bytes;
    int whole = fixture_write(&d, 1, VDB_SEEKABLE, false);
    size_t size = slurp(whole, &bytes);
    find_bytes(bytes, size, corner, sizeof corner)[0] = 8;
    int fd = fixture_bytes(bytes, size);
    expect(fd, NULL, 0.5, ERROR_INPUT_DAMAGED, WORDS("impossible position"));
    close(fd);
    close(whole);
    free(bytes);
}

static void every_truncation_is_noticed(void **state)
{
    (void)state;
    /* All truncations in the head and at the end, some between, in each layout and compression. */
    fixture g = fixture_make(fixture_uniform, 9, ball, 0.3);
    vdb_draft d = fixture_draft(&g);
    for (int variant = 0; variant < 4; variant++) {
        unsigned char *bytes;
        int whole = fixture_write(&d, 1, variant & 1 ? VDB_STREAM : VDB_SEEKABLE, variant & 2);
        size_t size = slurp(whole, &bytes);
        close(whole);
        for (size_t cut = 0; cut < size; cut += size - cut <= 12 ? 1 : cut < 700 ? 61 : 2801) {
            error e = {0};
            int fd = fixture_bytes(bytes, cut);
            volume *v = fixture_open(fd, NULL, NAN, VOLUME_INTERPOLATING, &e);
            if (v || (e.code != ERROR_INPUT_DAMAGED && e.code != ERROR_LIMIT_MEMORY))
                fail_msg("variant %d cut to %zu of %zu bytes: %s", variant, cut, size,
                         v ? "opened" : e.message);
            close(fd);
        }
        free(bytes);
    }
    fixture_free(&g);
}

/* The library may crash with a damaged file, so it runs in a separate process, like the worker. */
static int open_elsewhere(const unsigned char *bytes, size_t size)
{
    int fd = fixture_bytes(bytes, size), status = 0;
    fflush(NULL);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
#ifndef __SANITIZE_ADDRESS__
        const struct rlimit space = {(rlim_t)4 << 30, (rlim_t)4 << 30};
        setrlimit(RLIMIT_AS, &space);
#endif
        const struct rlimit time = {20, 20};
        setrlimit(RLIMIT_CPU, &time);
        error e = {0};
        volume *v = fixture_open(fd, NULL, NAN, VOLUME_INTERPOLATING, &e);
        volume_close(v);
        _exit(v ? 0 : e.code == ERROR_NONE ? 99 : (int)e.code);
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    close(fd);
    return WIFSIGNALED(status) ? -WTERMSIG(status) : WEXITSTATUS(status);
}

static int threads_of_process(void)
{
    int count = 0;
    DIR *tasks = opendir("/proc/self/task");
    assert_non_null(tasks);
    while (readdir(tasks)) count++;
    closedir(tasks);
    return count;
}

/* A thread that a library leaves running may hold a lock when the process forks. */
static void reading_and_writing_leave_no_threads(void **state)
{
    (void)state;
    int before = threads_of_process();
    fixture g = fixture_make(fixture_uniform, 9, ball, 0.3);
    vdb_draft d = fixture_draft(&g);
    int fd = fixture_write(&d, 1, VDB_SEEKABLE, false);
    error e = {0};
    volume *v = fixture_open(fd, NULL, NAN, VOLUME_INTERPOLATING, &e);
    assert_non_null(v);
    volume_close(v);
    close(fd);
    fixture_free(&g);
    assert_int_equal(threads_of_process(), before);
}

static void flipped_bits_give_errors_or_volumes(void **state)
{
    (void)state;
    fixture g = fixture_make(fixture_uniform, 10, ball, 0.3);
    vdb_draft d = fixture_draft(&g);
    unsigned char *bytes;
    int whole = fixture_write(&d, 1, VDB_SEEKABLE, false), tally[ERROR_CODE_COUNT] = {0}, died = 0;
    size_t size = slurp(whole, &bytes);
    uint64_t seed = SEED;
    close(whole);
    print_message("# seed %u\n", SEED);
    for (int i = 0; i < FLIPS; i++) {
        /* half of them in the first 2000 bytes, which have the structure */
        size_t at = (size_t)(fixture_random(&seed) * (double)(i % 2 && size > 2000 ? 2000 : size));
        unsigned char old = bytes[at];
        bytes[at] ^= (unsigned char)(1u << (int)(fixture_random(&seed) * 8));
        int outcome = open_elsewhere(bytes, size);
        bytes[at] = old;
        if (outcome == 99) fail_msg("a byte flipped at %zu: refused without an error", at);
        if (outcome == -SIGXCPU || outcome == -SIGKILL) fail_msg("a byte flipped at %zu: ran for ever", at);
        if (outcome < 0)
            died++;
        else
            tally[outcome < ERROR_CODE_COUNT ? outcome : ERROR_INTERNAL]++;
    }
    print_message("# of %d flips: %d opened, %d damaged, %d unsupported, %d memory, %d no surface, %d died\n",
                  FLIPS, tally[ERROR_NONE], tally[ERROR_INPUT_DAMAGED], tally[ERROR_INPUT_UNSUPPORTED],
                  tally[ERROR_LIMIT_MEMORY], tally[ERROR_NO_SURFACE], died);
    free(bytes);
    fixture_free(&g);
}

/* Opens a slice after its reader has ended, so that the request has no receiver. */
static int open_when_the_reader_is_gone(void *context, const char *path, error *e)
{
    siginfo_t info;
    (void)context, (void)e;
    assert_int_equal(waitid(P_ALL, 0, &info, WEXITED | WNOWAIT), 0);
    return open(path, O_RDONLY | O_CLOEXEC);
}

static void ended_readers_are_errors(void **state)
{
    (void)state;
    const char *const paths[] = {"/proc/self/exe"};
    const int numbers[] = {1};
    const slices_files files = {open_when_the_reader_is_gone, NULL};
    const exr_stack_params params = {.count = 1,
                                     .paths = paths,
                                     .numbers = numbers,
                                     .program = "/bin/false",
                                     .memory_limit = 1 << 20,
                                     .files = &files};
    error e = {0};
    assert_null(exr_stack_open(&params, &e));
    assert_int_equal(e.code, ERROR_INPUT_DAMAGED);
    assert_non_null(strstr(e.message, "ended while it was read"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(reading_and_writing_leave_no_threads),
        cmocka_unit_test(the_choice_of_the_grid),
        cmocka_unit_test(what_is_not_a_volume),
        cmocka_unit_test(volumes_without_a_surface),
        cmocka_unit_test(plateaus_are_no_surface),
        cmocka_unit_test(versions_of_the_format),
        cmocka_unit_test(offsets_are_world_distances),
        cmocka_unit_test(zeros_on_the_surface_are_no_plateau),
        cmocka_unit_test(bands_that_do_not_hold_the_surface),
        cmocka_unit_test(values_that_are_not_finite),
        cmocka_unit_test(tiles_that_are_not_finite),
        cmocka_unit_test(coordinates_at_the_limits_of_int32),
        cmocka_unit_test(transforms_that_cannot_be),
        cmocka_unit_test(the_limit_of_memory),
        cmocka_unit_test(memory_use_is_within_the_limit),
        cmocka_unit_test(names_of_transforms),
        cmocka_unit_test(lengths_of_metadata),
        cmocka_unit_test(parts_of_trees_lie_on_their_grid),
        cmocka_unit_test(every_truncation_is_noticed),
        cmocka_unit_test(flipped_bits_give_errors_or_volumes),
        cmocka_unit_test(ended_readers_are_errors),
    };
    return cmocka_run_group_tests_name("volume errors", tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
/* Files that are read without OpenVDB give the same result as OpenVDB. All others are left to OpenVDB. */
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

#include "shapes.h"
#include "io/vdb/plain_vdb.h"
#include "volume_fixture.h"

static double ball(vec3 p)
{
    return vec3_norm(p) - 0.8;
}

static void hold_grids_equal(const vdb_grid *a, const vdb_grid *b)
{
    assert_int_equal(a->grid_class, b->grid_class);
    assert_int_equal(a->from_newer, b->from_newer);
    assert_memory_equal(&a->background, &b->background, sizeof a->background);
    for (int k = 0; k < 16; k++) assert_true(a->index_to_world[k] == b->index_to_world[k]);
    assert_int_equal(a->active_voxels, b->active_voxels);
    assert_int_equal(a->leaf_count, b->leaf_count);
    assert_int_equal(a->tile_count, b->tile_count);
    if (a->leaf_count) {
        assert_memory_equal(a->leaf_origin, b->leaf_origin, a->leaf_count * sizeof *a->leaf_origin);
        assert_memory_equal(a->leaf_active, b->leaf_active, a->leaf_count * 8 * sizeof *a->leaf_active);
        assert_memory_equal(a->leaf_values, b->leaf_values,
                            a->leaf_count * VDB_LEAF_VOXELS * sizeof *a->leaf_values);
    }
    for (size_t k = 0; k < a->tile_count; k++) { /* in any order */
        size_t other = 0;
        while (other < b->tile_count && (memcmp(a->tiles[k].origin, b->tiles[other].origin, 12) != 0 ||
                                         a->tiles[k].side != b->tiles[other].side ||
                                         memcmp(&a->tiles[k].value, &b->tiles[other].value, 4) != 0 ||
                                         a->tiles[k].active != b->tiles[other].active))
            other++;
        assert_true(other < b->tile_count);
    }
}

/* Returns the number of grids that were read without the library. */
static size_t hold_file_equal(int fd)
{
    vdb_listing plain, listed;
    error e = {0};
    size_t read = 0;
    if (!plain_vdb_list_grids(fd, &plain)) return 0;
    threads *pool = threads_new(3, NULL, &e);
    assert_non_null(pool);
    assert_true(vdb_list_grids(fd, &listed, &e));
    assert_int_equal(plain.count, listed.count);
    for (size_t k = 0; k < plain.count; k++) {
        assert_string_equal(plain.entries[k].name, listed.entries[k].name);
        assert_string_equal(plain.entries[k].type, listed.entries[k].type);
        assert_int_equal(plain.entries[k].scalar, listed.entries[k].scalar);
        assert_int_equal(plain.entries[k].numeric, listed.entries[k].numeric);
        assert_int_equal(plain.entries[k].grid_class, listed.entries[k].grid_class);
        vdb_grid *g = plain_vdb_load_grid(fd, k, FIXTURE_MEMORY, pool);
        if (!g) continue;
        vdb_grid *whole = vdb_load_grid(fd, k, (vdb_loading){0}, FIXTURE_MEMORY, &e);
        assert_non_null(whole);
        hold_grids_equal(g, whole);
        vdb_grid_free(whole);
        vdb_grid_free(g);
        read++;
    }
    threads_free(pool);
    vdb_listing_free(&plain);
    vdb_listing_free(&listed);
    return read;
}

static void written_files_are_read_back(void **state)
{
    (void)state;
    const double *const transforms[] = {fixture_uniform, fixture_nonuniform, fixture_rotated,
                                        fixture_mirrored};
    const vdb_tile tile = {{1024, -128, 0}, 128, -3.5f, true};
    for (int how = 0; how < 8; how++) {
        fixture g = fixture_make(transforms[how / 2], 12, ball, how & 1 ? 0.25 : 0);
        g.draft.half = how & 2;
        g.draft.tiles = &tile;
        g.draft.tile_count = 1;
        const vdb_draft drafts[2] = {fixture_draft(&g), fixture_draft(&g)};
        int fd = fixture_write(drafts, 2, VDB_SEEKABLE, how & 4);
        assert_int_equal(hold_file_equal(fd), 2);
        close(fd);
        fixture_free(&g);
    }
}

static void other_files_are_passed_to_the_library(void **state)
{
    (void)state;
    vdb_listing list;
    fixture g = fixture_make(fixture_uniform, 4, ball, 0);
    vdb_draft draft = fixture_draft(&g);
    int fd = fixture_write(&draft, 1, VDB_STREAM, false);
    assert_false(plain_vdb_list_grids(fd, &list));
    close(fd);
    draft.type = "double";
    fd = fixture_write(&draft, 1, VDB_SEEKABLE, false);
    assert_null(plain_vdb_load_grid(fd, 0, FIXTURE_MEMORY, NULL));
    close(fd);
    draft.type = "float";
    fd = fixture_write(&draft, 1, VDB_SEEKABLE, false);
    assert_null(plain_vdb_load_grid(fd, 1, FIXTURE_MEMORY, NULL));
    assert_null(plain_vdb_load_grid(fd, 0, 100, NULL));
    close(fd);
    fixture_free(&g);
}

/* No content of a file causes a failure. Unusual content is left to the library. */
static void damaged_files_do_no_harm(void **state)
{
    (void)state;
    fixture g = fixture_make(fixture_uniform, 6, ball, 0.25);
    const vdb_draft draft = fixture_draft(&g);
    int fd = fixture_write(&draft, 1, VDB_SEEKABLE, true);
    const size_t size = (size_t)lseek(fd, 0, SEEK_END);
    unsigned char *bytes = malloc(size);
    assert_int_equal(pread(fd, bytes, size, 0), size);
    close(fd);
    for (size_t length = 0; length < size; length += length < 1500 ? 13 : 1997) {
        fd = fixture_bytes(bytes, length);
        assert_null(plain_vdb_load_grid(fd, 0, FIXTURE_MEMORY, NULL));
        close(fd);
    }
    uint64_t seed = test_seed();
    for (int trial = 0; trial < 400; trial++) {
        const double where = fixture_random(&seed);
        const size_t at = (size_t)(where * (double)(trial % 2 ? size : 1200));
        unsigned char before[8], changed[8] = {[7] = 0x80}; /* of a length: the smallest number */
        const size_t many = trial % 4 == 3 && at + sizeof changed <= size ? sizeof changed : 1;
        if (many == 1) changed[0] = (unsigned char)(256 * fixture_random(&seed));
        memcpy(before, bytes + at, many);
        memcpy(bytes + at, changed, many);
        fd = fixture_bytes(bytes, size);
        vdb_grid_free(plain_vdb_load_grid(fd, 0, FIXTURE_MEMORY, NULL));
        vdb_listing list = {0};
        if (plain_vdb_list_grids(fd, &list)) vdb_listing_free(&list);
        close(fd);
        memcpy(bytes + at, before, many);
    }
    free(bytes);
    fixture_free(&g);
}

/* With every kind of compression. */
static void real_files_are_read_as_the_library_does(void **state)
{
    (void)state;
    char folder[5000], path[6000];
    if (!fixture_shared()) {
        print_message("# the shared data are not there (HEXAD_SHARED, or shared/data beside the source)\n");
        return;
    }
    snprintf(folder, sizeof folder, "%s/vdb", fixture_shared());
    DIR *dir = opendir(folder);
    size_t files = 0, read = 0;
    assert_non_null(dir);
    for (struct dirent *entry; (entry = readdir(dir));) {
        if (!strstr(entry->d_name, ".vdb")) continue;
        snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        int fd = open(path, O_RDONLY | O_CLOEXEC);
        const size_t grids = hold_file_equal(fd);
        close(fd);
        print_message("# %s: %zu\n", entry->d_name, grids);
        files += grids > 0;
        read += grids;
    }
    closedir(dir);
    print_message("# %zu grids of %zu files\n", read, files);
    assert_true(files >= 10);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(written_files_are_read_back),
        cmocka_unit_test(other_files_are_passed_to_the_library),
        cmocka_unit_test(damaged_files_do_no_harm),
        cmocka_unit_test(real_files_are_read_as_the_library_does),
    };
    return cmocka_run_group_tests_name("plain_vdb", tests, NULL, NULL);
}

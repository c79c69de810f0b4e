// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "files/path_map.h"

static void expect(const path_map *m, const char *path, const char *here)
{
    char *mapped = path_map_apply(m, path);
    if (!here && mapped) fail_msg("%s is mapped to %s", path, mapped);
    if (here && (!mapped || strcmp(mapped, here) != 0))
        fail_msg("%s is mapped to %s and not to %s", path, mapped ? mapped : "nothing", here);
    free(mapped);
}

static void test_whole_components_and_the_longest(void **state)
{
    (void)state;
    static const char *const table[] = {"/Volumes/show=/mnt/show", "/Volumes/show/fast//=/ssd/show/",
                                        "/mnt/old=/mnt/new", "/same=/same"};
    path_map *m = path_map_read(table, 4, NULL);
    assert_non_null(m);
    expect(m, "/Volumes/show/a.vdb", "/mnt/show/a.vdb");
    expect(m, "/Volumes/show", "/mnt/show");
    expect(m, "/Volumes//show/b/####.vdb", "/mnt/show/b/####.vdb");
    expect(m, "/Volumes/show/fast/c.vdb", "/ssd/show/c.vdb");
    expect(m, "/Volumes/show/faster/c.vdb", "/mnt/show/faster/c.vdb");
    expect(m, "/Volumes/show/../etc", "/mnt/show/../etc"); /* refused by the code that opens the path */
    expect(m, "/mnt/old/old/x", "/mnt/new/old/x");
    expect(m, "/Volumes/shows/a.vdb", NULL);
    expect(m, "/volumes/show/a.vdb", NULL);
    expect(m, "/Volumes/show\\a.vdb", NULL); /* an ordinary character in such a path */
    expect(m, "/x/Volumes/show/a.vdb", NULL);
    expect(m, "Volumes/show/a.vdb", NULL);
    expect(m, "sha256:00", NULL);
    expect(m, "/same/x", NULL);
    expect(m, "", NULL);
    expect(NULL, "/Volumes/show", NULL);
    path_map_free(m);
}

static void test_paths_of_windows(void **state)
{
    (void)state;
    static const char *const table[] = {"Z:\\Show=/mnt/show", "y:/=/mnt/y", "\\\\nas\\show=/nas/show",
                                        "s:=/mnt/s"};
    path_map *m = path_map_read(table, 4, NULL);
    assert_non_null(m);
    expect(m, "Z:\\Show\\a\\B.vdb", "/mnt/show/a/B.vdb");
    expect(m, "z:/show/a\\b.vdb", "/mnt/show/a/b.vdb");
    expect(m, "Z:\\Shows\\a", NULL);
    expect(m, "Y:\\x", "/mnt/y/x");
    expect(m, "Y:x", NULL); /* relative to the current directory of a drive */
    expect(m, "//NAS/show/x", "/nas/show/x");
    expect(m, "\\\\nas\\show\\\\x", "/nas/show/x");
    expect(m, "/nas/show/x", NULL);
    expect(m, "sha256:00", NULL); /* not the drive s */
    path_map_free(m);
}

static void test_bad_tables_say_what(void **state)
{
    (void)state;
    static const struct {
        const char *text, *words;
    } bad[] = {
        {"/a", "must be from=to"},       {"=/b", "the path before"},      {"/=/b", "the path before"},
        {"a/b=/c", "the path before"},   {"Z:x=/c", "the path before"},   {"//=/c", "the path before"},
        {"/a=b", "must be an absolute"}, {"/a=/", "must be an absolute"}, {"/a=Z:/b", "must be an absolute"},
        {"/a=", "must be an absolute"},  {"/b/=/x", "mapped twice"}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        error e = {0};
        const char *const table[] = {"/b=/c", bad[i].text};
        assert_null(path_map_read(table, 2, &e));
        assert_int_equal(e.code, ERROR_SPEC_INVALID);
        if (!strstr(e.message, bad[i].words)) fail_msg("%s: %s", bad[i].text, e.message);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_whole_components_and_the_longest),
        cmocka_unit_test(test_paths_of_windows),
        cmocka_unit_test(test_bad_tables_say_what),
    };
    return cmocka_run_group_tests_name("mapping", tests, NULL, NULL);
}

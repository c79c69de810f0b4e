// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "service/executor/host.h"
#include "files/file.h"

static void put_bound(const char *base, const char *group, const char *text)
{
    char *directory = mem_printf("%s%s", base, group), *path = mem_printf("%s/memory.max", directory);
    assert_true(store_directory_create(directory, NULL));
    assert_true(store_file_write(path, text, strlen(text), NULL));
    free(directory);
    free(path);
}

static void test_the_lowest_limit_of_the_parent_groups_counts(void **state)
{
    (void)state;
    char base[] = "/tmp/hexad-host-XXXXXX";
    assert_non_null(mkdtemp(base));
    assert_true(host_group_memory_mb(base, "/a/b") == INT64_MAX);
    put_bound(base, "/a/b", "max\n");
    assert_true(host_group_memory_mb(base, "/a/b") == INT64_MAX);
    put_bound(base, "/a", "1073741824\n");
    assert_int_equal(host_group_memory_mb(base, "/a/b"), 1024);
    put_bound(base, "/a/b", "536870912\n");
    assert_int_equal(host_group_memory_mb(base, "/a/b"), 512);
    assert_int_equal(host_group_memory_mb(base, "/a"), 1024);
    assert_true(host_group_memory_mb(base, "/") == INT64_MAX);
    assert_true(store_remove(base, NULL));
}

static void test_this_host(void **state)
{
    (void)state;
    char name[8];
    assert_true(host_memory_mb() > 0);
    host_name(name, sizeof name);
    assert_true(strlen(name) < sizeof name);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_the_lowest_limit_of_the_parent_groups_counts),
        cmocka_unit_test(test_this_host),
    };
    return cmocka_run_group_tests_name("host", tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
/* Cases in which control groups are not available. `make bootcheck` checks in a virtual machine that the
 * kernel enforces their limits.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/control_group.h"

typedef struct place {
    char base[64];
    char path[128];
} place;

static const char *path_of(place *p, const char *name)
{
    snprintf(p->path, sizeof p->path, "%s/%s", p->base, name);
    return p->path;
}

static void put(place *p, const char *name, const char *text)
{
    FILE *file = fopen(path_of(p, name), "w");
    assert_non_null(file);
    assert_int_equal(fputs(text, file) >= 0, true);
    assert_int_equal(fclose(file), 0);
}

static int set_up(void **state)
{
    place *p = calloc(1, sizeof *p);
    strcpy(p->base, "/tmp/hexad-groups-XXXXXX");
    assert_non_null(mkdtemp(p->base));
    *state = p;
    return 0;
}

static int tear_down(void **state)
{
    place *p = *state;
    static const char *const names[] = {"cgroup.controllers", "cgroup.subtree_control",
                                        "service/cgroup.procs", "service", "attempt.7"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) remove(path_of(p, names[i]));
    assert_int_equal(rmdir(p->base), 0);
    free(p);
    return 0;
}

static void test_without_a_controller_there_are_no_groups(void **state)
{
    place *p = *state;
    static const char *const lists[] = {NULL, "\n", "cpu pids\n", "cpu memory_of pids\n", "nomemory\n"};
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        control_groups *groups = (control_groups *)p;
        if (lists[i]) put(p, "cgroup.controllers", lists[i]);
        assert_true(control_groups_open_at(p->base, &groups, NULL));
        assert_null(groups);
        assert_int_equal(access(path_of(p, "service"), F_OK), -1);
    }
    control_groups *groups = (control_groups *)p;
    assert_true(control_groups_open_at("/no/such/group", &groups, NULL));
    assert_null(groups);
}

static void test_a_group_that_cannot_be_used_is_an_error(void **state)
{
    place *p = *state;
    error e = {0};
    control_groups *groups = NULL;
    put(p, "cgroup.controllers", "cpu memory\n"); /* in a file system without control groups */
    assert_false(control_groups_open_at(p->base, &groups, &e));
    assert_null(groups);
    assert_int_equal(e.code, ERROR_INTERNAL);
    assert_non_null(strstr(e.message, "cgroup.procs"));
}

static void test_groups_of_earlier_runs_are_removed(void **state)
{
    place *p = *state;
    error e = {0};
    control_groups *groups = NULL;
    put(p, "cgroup.controllers", "memory\n");
    put(p, "cgroup.subtree_control", "");
    assert_int_equal(mkdir(path_of(p, "attempt.7"), 0700), 0);
    assert_int_equal(mkdir(path_of(p, "service"), 0700), 0);
    put(p, "service/cgroup.procs", "");
    if (!control_groups_open_at(p->base, &groups, &e)) fail_msg("%s", e.message);
    assert_non_null(groups);
    assert_int_equal(access(path_of(p, "attempt.7"), F_OK), -1);
    assert_null(control_group_new(groups, 1 << 20, &e)); /* no file of limits exists */
    assert_non_null(strstr(e.message, "memory.max"));
    assert_int_equal(access(path_of(p, "attempt.0"), F_OK), -1);
    control_groups_close(groups);
}

static void test_usage_of_no_group_is_zero(void **state)
{
    (void)state;
    control_group_use use = control_group_end(NULL);
    assert_true(!use.exceeded && use.peak_bytes == 0);
    control_groups_close(NULL);
}

#define CASE(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        CASE(test_without_a_controller_there_are_no_groups),
        CASE(test_a_group_that_cannot_be_used_is_an_error),
        CASE(test_groups_of_earlier_runs_are_removed),
        CASE(test_usage_of_no_group_is_zero),
    };
    return cmocka_run_group_tests_name("control_group", tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
/* Unit tests of base/core/child_environment: which variables a started program gets. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/child_environment.h"

static const char *const passed[] = {"PATH=/bin",      "TMPDIR=/tmp",
                                     "TZ=UTC",         "MALLOC_ARENA_MAX=2",
                                     "ASAN_OPTIONS=a", "GLIBC_TUNABLES=glibc.malloc.check=0"};
static const char *const kept[] = {"HEXAD_TOKEN=secret",           "NOTIFY_SOCKET=/run/notify",
                                   "CREDENTIALS_DIRECTORY=/run/c", "LD_PRELOAD=/a.so",
                                   "PATH_OF_ANOTHER=secret",       "TRACEPARENT=of-the-parent"};
static const char *const of_slurm[] = {"SLURM_CONF=/etc/slurm.conf", "SBATCH_ACCOUNT=a"};

static void set(const char *const *list, size_t count)
{
    for (size_t i = 0; i < count; i++) assert_int_equal(putenv((char *)list[i]), 0);
}

static bool has(char **environment, const char *variable)
{
    for (; *environment; environment++)
        if (strcmp(*environment, variable) == 0) return true;
    return false;
}

#define COUNT(LIST) (sizeof(LIST) / sizeof *(LIST))

static void test_the_environment_has_the_listed_variables_only(void **state)
{
    char own[] = "TRACEPARENT=of-the-job";
    char **host = environ; /* cmocka reads it */
    (void)state;
    environ = NULL;
    set(passed, COUNT(passed));
    set(kept, COUNT(kept));
    set(of_slurm, COUNT(of_slurm));
    for (int k = 0; k < 2; k++) {
        char **made = child_environment_new(k ? CHILD_ENVIRONMENT_OF_SLURM : CHILD_ENVIRONMENT_OF_WORKER,
                                            k ? NULL : own);
        size_t count = 0;
        while (made[count]) count++;
        assert_int_equal(count, COUNT(passed) + (k ? COUNT(of_slurm) : 1));
        for (size_t i = 0; i < COUNT(passed); i++) assert_true(has(made, passed[i]));
        for (size_t i = 0; i < COUNT(of_slurm); i++) assert_int_equal(has(made, of_slurm[i]), k);
        assert_int_equal(has(made, own), !k);
        free(made);
    }
    environ = host;
}

static void test_a_process_without_an_environment_passes_none(void **state)
{
    char **host = environ;
    (void)state;
    environ = NULL;
    char **made = child_environment_new(CHILD_ENVIRONMENT_OF_SLURM, NULL);
    environ = host;
    assert_null(*made);
    free(made);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_the_environment_has_the_listed_variables_only),
        cmocka_unit_test(test_a_process_without_an_environment_passes_none),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

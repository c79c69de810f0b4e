// SPDX-License-Identifier: Apache-2.0
#include "base/core/child_environment.h"

#include <stdbool.h>
#include <stddef.h>
#include <string.h>
#include <unistd.h>

#include "base/core/memory.h"

/* The beginnings of the variables. */
static const char *const of_all[] = {
    "PATH=",         "TMPDIR=",       "TZ=",           "GLIBC_TUNABLES=", "MALLOC_ARENA_MAX=",
    "ASAN_OPTIONS=", "LSAN_OPTIONS=", "TSAN_OPTIONS=", "UBSAN_OPTIONS="};
static const char *const of_slurm[] = {"SLURM_", "SBATCH_"};

static bool begins_with_any(const char *variable, const char *const *list, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (strncmp(variable, list[i], strlen(list[i])) == 0) return true;
    return false;
}

static bool is_passed(const char *variable, child_environment_of of)
{
    return begins_with_any(variable, of_all, sizeof of_all / sizeof *of_all) ||
           (of == CHILD_ENVIRONMENT_OF_SLURM &&
            begins_with_any(variable, of_slurm, sizeof of_slurm / sizeof *of_slurm));
}

char **child_environment_new(child_environment_of of, char *own)
{
    size_t count = 0, used = 0;
    while (environ && environ[count]) count++;
    char **variables = mem_alloc((count + 2) * sizeof *variables);
    for (size_t i = 0; i < count; i++)
        if (is_passed(environ[i], of)) variables[used++] = environ[i];
    variables[used++] = own;
    variables[used] = NULL;
    return variables;
}

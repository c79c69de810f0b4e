// SPDX-License-Identifier: Apache-2.0
#include "service/results/lost_found.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/core/memory.h"
#include "files/file.h"

/* The path of an unused name in `directory`, to be freed. No other process creates names there: the daemon
 * holds the lock on the state directory. */
static char *free_place(const char *directory, const char *name)
{
    struct stat info;
    char *place = mem_printf("%s/%s", directory, name);
    for (int again = 1; lstat(place, &info) == 0; again++) {
        free(place);
        place = mem_printf("%s/%s~%d", directory, name, again);
    }
    return place;
}

bool lost_found_move(const char *work_dir, const char *part, const char *name, error *e)
{
    char *directory = mem_printf("%s/" LOST_FOUND_DIRECTORY "/%s", work_dir, part);
    char *from = mem_printf("%s/%s/%s", work_dir, part, name), *to = NULL;
    bool ok = store_directory_create(directory, e);
    if (ok) {
        to = free_place(directory, name);
        ok = rename(from, to) == 0 ||
             error_set(e, ERROR_INTERNAL, "cannot move %s to %s: %s", from, to, strerror(errno));
    }
    free(directory);
    free(from);
    free(to);
    return ok;
}

bool lost_found_flush(const char *work_dir, const char *part, error *e)
{
    char *from = mem_printf("%s/%s", work_dir, part),
         *to = mem_printf("%s/" LOST_FOUND_DIRECTORY "/%s", work_dir, part);
    bool ok = store_directory_sync(to, e) && store_directory_sync(from, e);
    free(from);
    free(to);
    return ok;
}

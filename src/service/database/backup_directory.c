// SPDX-License-Identifier: Apache-2.0
#include "service/database/backup_directory.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/memory.h"

char *backup_directory_path(const char *state_dir)
{
    return mem_printf("%s/copies", state_dir);
}

bool backup_directory_make(const char *state_dir, error *e)
{
    struct stat owner;
    char *path = backup_directory_path(state_dir);
    bool made = mkdir(path, 0700) == 0;
    bool ok = (made || errno == EEXIST) && stat(state_dir, &owner) == 0;
    if (ok && made && geteuid() == 0) ok = chown(path, owner.st_uid, owner.st_gid) == 0;
    if (!ok) error_set(e, ERROR_INTERNAL, "%s: %s", path, strerror(errno));
    free(path);
    return ok;
}

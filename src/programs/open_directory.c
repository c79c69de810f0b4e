// SPDX-License-Identifier: Apache-2.0
#include "programs/open_directory.h"

#include <pwd.h>
#include <stdbool.h>
#include <stddef.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/memory.h"

static bool is_own_group(const struct stat *info)
{
    const struct passwd *owner = getpwuid(info->st_uid);
    return info->st_gid == getegid() || (owner && info->st_gid == owner->pw_gid);
}

char *open_directory_describe(const char *path)
{
    struct stat info;
    if (stat(path, &info) != 0) return NULL;
    const bool others = info.st_mode & S_IWOTH, group = info.st_mode & S_IWGRP && !is_own_group(&info);
    if (!others && !group) return NULL;
    return mem_printf(
        "%s can write to %s (mode %04o) and can replace the queue and its results: chmod go-w %s",
        others ? "every user of this machine" : "another group", path, (unsigned)(info.st_mode & 07777),
        path);
}

// SPDX-License-Identifier: Apache-2.0
#include "programs/directory_check.h"

#include <errno.h>
#include <pwd.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/denial.h"
#include "base/core/memory.h"
#include "files/file.h"

/* 0 or the errno of the access to a directory. */
static int fault_of(const char *path, int mode)
{
    struct stat info;
    if (stat(path, &info) != 0) return errno;
    if (!S_ISDIR(info.st_mode)) return ENOTDIR;
    return access(path, mode) == 0 ? 0 : errno;
}

/* 0 or the errno of the creation of a directory and the directories above it. */
static int fault_of_creation(const char *path)
{
    char *parent = store_parent_of(path);
    int fault = fault_of(parent, W_OK | X_OK);
    if (fault == ENOENT && strcmp(parent, path) != 0) fault = fault_of_creation(parent);
    free(parent);
    return fault;
}

bool directory_check_usable(const char *setting, const char *path, error *e)
{
    struct stat link;
    int fault = fault_of(path, R_OK | W_OK | X_OK);
    if (fault == ENOENT && lstat(path, &link) != 0) /* a symbolic link without a target cannot be created */
        fault = fault_of_creation(path);
    if (!fault) return true;
    char *why = fault == EROFS ? denial_describe_read_only(path)
                               : denial_explain(path, fault, DENIAL_OWN, ": choose another directory");
    error_set(e, ERROR_INTERNAL, "%s: cannot write to %s: %s%s", setting, path, strerror(fault), why);
    free(why);
    return false;
}

bool directory_check_file(const char *setting, const char *path, error *e)
{
    char *directory = store_parent_of(path);
    const int fault = fault_of(directory, W_OK | X_OK);
    if (fault)
        error_set(e, ERROR_INTERNAL, "%s: cannot create %s: the directory %s: %s: %s", setting, path,
                  directory, strerror(fault),
                  fault == ENOENT ? "create it, or choose another one"
                                  : "choose a directory that the user of the service can write to");
    free(directory);
    return !fault;
}

static bool is_own_group(const struct stat *info)
{
    const struct passwd *owner = getpwuid(info->st_uid);
    return info->st_gid == getegid() || (owner && info->st_gid == owner->pw_gid);
}

char *directory_check_describe_writers(const char *path)
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

bool directory_check_contains(const char *directory, const char *path)
{
    char *parent = store_parent_of(path);
    const bool same = strcmp(parent, directory) == 0;
    free(parent);
    return same;
}

// SPDX-License-Identifier: Apache-2.0
#include "base/core/denial.h"

#include <errno.h>
#include <grp.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "base/core/user_name.h"

#define HOME_OF_ROOT "/root"

enum { RECORD_BYTES = 16384 };

static const mode_t owner_modes[] = {[DENIAL_READ] = 0400,
                                     [DENIAL_WRITE] = 0600,
                                     [DENIAL_OWN] = 0600,
                                     [DENIAL_SECRET] = 0400,
                                     [DENIAL_SETTINGS] = 0400};

typedef struct names {
    char user[USER_NAME_SIZE], group[USER_NAME_SIZE];
} names;

/* The names of a user and a group; their numbers if they have no names. */
static names names_of(uid_t uid, gid_t gid)
{
    names n;
    char buffer[RECORD_BYTES];
    struct group group, *found_group = NULL;
    user_name_of(uid, n.user);
    snprintf(n.group, sizeof n.group, "%u", (unsigned)gid);
    if (getgrgid_r(gid, &group, buffer, sizeof buffer, &found_group) == 0 && found_group)
        snprintf(n.group, sizeof n.group, "%s", group.gr_name);
    return n;
}

/* The first directory above the path that this process may not search, which the caller frees; NULL: there
 * is none. */
static char *find_closed_directory(const char *path)
{
    struct stat info;
    for (const char *slash = strchr(path, '/'); slash; slash = strchr(slash + 1, '/')) {
        char *directory = mem_strndup(path, slash > path ? (size_t)(slash - path) : 1);
        if (slash[1] && stat(directory, &info) == 0 && S_ISDIR(info.st_mode) && access(directory, X_OK) != 0)
            return directory;
        free(directory);
    }
    return NULL;
}

/* The path, or if it does not exist the nearest directory above it, which the caller frees. */
static char *find_existing(const char *path, struct stat *info)
{
    char *place = mem_strdup(path);
    while (stat(place, info) != 0) {
        char *slash = strrchr(place, '/');
        if (slash > place) {
            *slash = '\0';
            continue;
        }
        free(place);
        place = mem_strdup(slash ? "/" : ".");
    }
    return place;
}

/* The command that permits the access; the caller frees it. `path`: a directory of the service that does not
 * exist yet; NULL: `place` itself is needed. */
static char *command_for(const char *place, const char *path, const struct stat *info, const names *own,
                         denial_need need)
{
    const char *group = own->group, *user = own->user;
    if (need == DENIAL_READ || need == DENIAL_SETTINGS)
        return mem_printf("chmod o+r%s %s", S_ISDIR(info->st_mode) ? "x" : "", place);
    if (need == DENIAL_WRITE) return mem_printf("chgrp %s %s && chmod g+rwx %s", group, place, place);
    /* the group of root is not the group of a service that reads the file */
    if (need == DENIAL_SECRET && geteuid() == 0)
        return mem_printf("%s %s", info->st_mode & 0077 ? "chmod 600" : "chown root", place);
    if (need == DENIAL_SECRET) return mem_printf("chown root:%s %s && chmod 640 %s", group, place, place);
    return path ? mem_printf("install -d -o %s -g %s -m 0700 %s", user, group, path)
                : mem_printf("chown -R %s:%s %s", user, group, place);
}

/* The permissions that the owner of the file or directory lacks. */
static mode_t missing_of_owner(const struct stat *info, bool closed, denial_need need)
{
    const mode_t enter = closed || S_ISDIR(info->st_mode) ? 0100 : 0;
    return ((closed ? 0 : owner_modes[need]) | enter) & ~info->st_mode;
}

/* For a file or directory of this process. */
static char *advice_to_owner(const char *place, mode_t missing)
{
    if (!missing)
        return mem_printf(
            ". Its mode permits this: an attribute of the file system (lsattr -d %s) or a security module "
            "denies it",
            place);
    return mem_printf(". Run: chmod u+%s%s%s %s", missing & 0400 ? "r" : "", missing & 0200 ? "w" : "",
                      missing & 0100 ? "x" : "", place);
}

/* `owner`: of the place. */
static char *advice_on(const char *place, const char *path, const struct stat *info, bool closed,
                       const char *owner, const names *own, denial_need need)
{
    const bool is_own = info->st_uid == geteuid();
    if (closed && !is_own && need == DENIAL_SETTINGS)
        return mem_printf(". Move the file to /etc, or to another directory that the user %s can enter",
                          own->user);
    if ((info->st_mode & 0777) == 0 && !is_own)
        return mem_strdup(
            ". ProtectHome= or InaccessiblePaths= in the unit of systemd hides directories with this mode: "
            "see \"Permit more\" in systemd.md");
    if (closed && strcmp(place, HOME_OF_ROOT) == 0)
        return mem_strdup(
            ". Move what is needed from the home directory of root to a directory below /srv or /var");
    if (is_own && (closed || need != DENIAL_SECRET))
        return advice_to_owner(place, missing_of_owner(info, closed, need));
    if (need == DENIAL_SECRET && !closed && is_own)
        return mem_printf(". Run: chmod %s %s", geteuid() == 0 ? "640" : "600", place);
    const bool is_of_other = need == DENIAL_OWN && !path && info->st_uid != 0;
    if (closed && is_of_other) return mem_printf(". Run this command as root or as the user %s", owner);
    char *command = closed ? mem_printf("chmod o+x %s", place) : command_for(place, path, info, own, need);
    char *text =
        is_of_other
            ? mem_printf(". Run this command as the user %s. If the user %s is the user of the service, run "
                         "as root: %s",
                         owner, own->user, command)
            : mem_printf(". Run as root: %s", command);
    free(command);
    return text;
}

/* What the process needs of the place, with %s for its user. */
static const char *demand_of(const struct stat *info, bool closed, bool absent, denial_need need)
{
    static const char *const demands[] = {
        [DENIAL_READ] = "the user %s must be able to read it",
        [DENIAL_WRITE] = "the user %s must be able to write to it",
        [DENIAL_OWN] = "it must belong to the user %s",
        [DENIAL_SECRET] = "no user except root and %s may read it",
        [DENIAL_SETTINGS] = "the user %s must be able to read it",
    };
    if (closed) return "the user %s must be able to enter it";
    if (absent || (need == DENIAL_OWN && info->st_uid == geteuid())) return demands[DENIAL_WRITE];
    if (need == DENIAL_SECRET && geteuid() == 0)
        return "users other than its owner must not be able to read it";
    return demands[need];
}

char *denial_describe(const char *path, denial_need need)
{
    struct stat info;
    char *place = find_closed_directory(path);
    const bool closed = place != NULL;
    if (place)
        stat(place, &info);
    else
        place = find_existing(path, &info);
    const bool absent = !closed && strcmp(place, path) != 0;
    const names owner = names_of(info.st_uid, info.st_gid), own = names_of(geteuid(), getegid());
    char *demand = mem_printf(demand_of(&info, closed, absent, need), own.user);
    char *advice = advice_on(place, absent ? path : NULL, &info, closed, owner.user, &own, need);
    char *text = mem_printf("%s has the owner %s, the group %s and the mode %04o, and %s%s", place,
                            owner.user, owner.group, (unsigned)info.st_mode & 07777, demand, advice);
    free(advice);
    free(demand);
    free(place);
    return text;
}

char *denial_describe_directory_of_user(const char *path, const char *user)
{
    const names own = names_of(geteuid(), getegid());
    return mem_printf(
        "%s does not exist, and the user %s cannot create it. Run as root: install -d -o %s -g %s -m 0770 %s && "
        "setfacl -m u:%s:rwx,d:u:%s:rwx %s (\"A directory for each user\" in operations.md; the user can delete "
        "results with the setting output_mode = 0660 only)",
        path, own.user, own.user, own.group, path, user, user, path);
}

char *denial_describe_read_only(const char *directory)
{
    struct stat info;
    const bool absent = stat(directory, &info) != 0 && errno == ENOENT;
    const names own = names_of(geteuid(), getegid());
    char *creation = absent ? mem_printf("create the directory: run `install -d -o %s -g %s -m 0700 %s` as "
                                         "root. Then ",
                                         own.user, own.group, directory)
                            : mem_strdup("");
    char *text = mem_printf(
        ". If the disk itself can be written, %spermit the service of systemd to write: run `systemctl edit "
        "hexad.service` as root, add the lines [Service] and ReadWritePaths=%s, and run `systemctl restart "
        "hexad.service`",
        creation, directory);
    free(creation);
    return text;
}

char *denial_explain(const char *path, int fault, denial_need need, const char *otherwise)
{
    if (fault != EACCES && fault != EPERM) return mem_strdup(otherwise);
    char *why = denial_describe(path, need), *text = mem_printf(": %s", why);
    free(why);
    return text;
}

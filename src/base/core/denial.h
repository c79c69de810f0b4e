// SPDX-License-Identifier: Apache-2.0
/* denial: the file or directory that denies this process access, for messages about EACCES and EPERM.
 *
 * A message names its owner, group and mode, what this process needs, and a command for root that permits
 * it. The process is the service. Commands that users run (hexadctl token) have messages of their own.
 */
#ifndef HEXAD_BASE_CORE_DENIAL_H
#define HEXAD_BASE_CORE_DENIAL_H

/* What the process needs, and the command that permits it. If the process owns the file or directory, the
 * command changes the permissions of the owner. */
typedef enum denial_need {
    DENIAL_READ,  /* to read a file or directory of other users: permission for others */
    DENIAL_WRITE, /* to write to a directory of other users: permission for the group of the process */
    DENIAL_OWN, /* to own a file or directory of the service. If it belongs to a user other than root, this process is
                     probably started as the wrong user */
    DENIAL_SECRET, /* to read a file that no other user may read, or that other users may read at present */
    DENIAL_SETTINGS, /* to read the settings file: as DENIAL_READ, but a directory that is closed stays closed */
} denial_need;

/* Describes why access to the path is denied: by the first directory on the way that this process may not
 * search, else by the path, or if it does not exist by the nearest directory above it. Sentences without the
 * last point. The caller frees the text. Any thread may call it. */
char *denial_describe(const char *path, denial_need need);

/* Describes that the directory of a user below an output root is missing and cannot be made. Any thread. The
 * caller frees the text. */
char *denial_describe_directory_of_user(const char *path, const char *user);

/* The end of a message about a directory on a read-only file system: how a unit of systemd permits writing. A unit
 * cannot start if such a directory does not exist, so a missing one is created first. The caller frees it. */
char *denial_describe_read_only(const char *directory);

/* The end of a message about a failed call: ": " and the description if errno was EACCES or EPERM, otherwise
 * `otherwise`. The caller frees it. */
char *denial_explain(const char *path, int fault, denial_need need, const char *otherwise);

#endif

/* control_group: limits of memory that the kernel keeps (control groups, version 2), for processes that this one starts.
 *
 * systemd may delegate the group of a service to it (Delegate=memory). This process then moves into a group below, since
 * only groups without processes of their own have limited ones below, and makes a group for each process that it
 * starts. The kernel ends all processes of a group whose memory reaches its limit, and no others. Any thread may call
 * these functions, but one control_group belongs to one thread at a time.
 */
#ifndef HEXAD_BASE_CONTROL_GROUP_H
#define HEXAD_BASE_CONTROL_GROUP_H

#include <stdbool.h>
#include <stdint.h>

#include "base/error.h"

typedef struct control_groups control_groups;
typedef struct control_group control_group;

/* *groups is NULL, and that is no error, when no group with a controller of memory was delegated to this process. Error
 * (internal): the delegated group cannot be used. */
bool control_groups_open(control_groups **groups, error *e);

/* The same for a group that is a directory. Public so that tests can use a directory of their own. */
bool control_groups_open_at(const char *directory, control_groups **groups, error *e);
void control_groups_close(control_groups *groups); /* accepts NULL */

/* A new group of at most so much memory, without swap. NULL and an error (internal). */
control_group *control_group_new(control_groups *groups, int64_t memory_bytes, error *e);

/* Moves the calling process into the group; async-signal-safe. False: errno tells why. */
bool control_group_join(const control_group *g);

typedef struct control_group_use {
    int64_t peak_bytes; /* 0: not known */
    bool exceeded;      /* the kernel ended processes because the group had reached its limit */
} control_group_use;

/* Kills what is left in the group, and removes and frees it. Accepts NULL: then nothing is known. */
control_group_use control_group_end(control_group *g);

#endif

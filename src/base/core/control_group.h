// SPDX-License-Identifier: Apache-2.0
/* control_group: memory limits enforced by the kernel (control groups, version 2) for processes that this one
 * starts.
 *
 * systemd may delegate the group of a service to it (Delegate=memory). This process then moves to a subgroup,
 * since only groups without processes may have limited subgroups, and creates a group for each process that
 * it starts. If the memory of a group reaches its limit, the kernel kills all of its processes, and no
 * others. Any thread; each control_group belongs to one thread at a time.
 */
#ifndef HEXAD_BASE_CORE_CONTROL_GROUP_H
#define HEXAD_BASE_CORE_CONTROL_GROUP_H

#include <stdbool.h>
#include <stdint.h>

#include "base/core/error.h"

typedef struct control_groups control_groups;
typedef struct control_group control_group;

/* *groups is NULL, without an error, if no group with a memory controller was delegated to this process.
 * Error: internal (the delegated group cannot be used). */
bool control_groups_open(control_groups **groups, error *e);

/* control_groups_open for the group at a directory; for tests. */
bool control_groups_open_at(const char *directory, control_groups **groups, error *e);
void control_groups_close(control_groups *groups); /* accepts NULL */

/* Creates a group with a memory limit and without swap. Error: internal. */
control_group *control_group_new(control_groups *groups, int64_t memory_bytes, error *e);

/* Moves the calling process to the group; async-signal-safe. False: errno is set. */
bool control_group_join(const control_group *g);

typedef struct control_group_use {
    int64_t peak_bytes; /* 0: unknown */
    bool exceeded;      /* the kernel killed processes because the group reached its limit */
} control_group_use;

/* Kills the processes in the group, removes the group, and frees it. NULL: returns zeros. */
control_group_use control_group_end(control_group *g);

#endif

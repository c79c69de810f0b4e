// SPDX-License-Identifier: Apache-2.0
/* host: memory, name and boot of this machine, as available to this process. No state; any thread. */
#ifndef HEXAD_SERVICE_EXECUTOR_HOST_H
#define HEXAD_SERVICE_EXECUTOR_HOST_H

#include <stddef.h>
#include <stdint.h>

/* The main memory in MiB, or the limit of this process's control group (version 2, with its parents) if that
 * is lower. */
int64_t host_memory_mb(void);

/* The memory limit of the control group "/a/b" in the tree at `root`. INT64_MAX: no limit. Public so that
 * tests can use a tree of their own. */
int64_t host_group_memory_mb(const char *root, const char *group);

void host_name(char *name, size_t size);

/* A text that changes with each boot of the host (not of a container); "" when it is unknown. */
#define HOST_BOOT_ID_SIZE 40
void host_boot_id(char id[HOST_BOOT_ID_SIZE]);

#endif

/* host: what this machine has, as far as this process may use it. No state; any thread. */
#ifndef HEXAD_EXECUTOR_HOST_H
#define HEXAD_EXECUTOR_HOST_H

#include <stddef.h>
#include <stdint.h>

/* Its main memory, or what the control group of this process may have of it (version 2, with all that stand
 * above it) when that is less; in MiB. */
int64_t host_memory_mb(void);

/* The same from a tree of control groups at `root` and a process's line of it, "/a/b"; here so that it is
 * tested without such a tree of the kernel's. INT64_MAX: no bound. */
int64_t host_group_memory_mb(const char *root, const char *group);

void host_name(char *name, size_t size);

/* Another text after each start of the host, not of a container; "" where it cannot be told. */
#define HOST_BOOT_ID_SIZE 40
void host_boot_id(char id[HOST_BOOT_ID_SIZE]);

#endif

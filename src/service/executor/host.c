// SPDX-License-Identifier: Apache-2.0
#include "service/executor/host.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "files/file.h"

#define GROUPS "/sys/fs/cgroup"
#define MIB (1 << 20)

static int64_t read_bound_mb(const char *group)
{
    char *path = mem_printf("%s/memory.max", group);
    size_t length = 0;
    char *text = store_file_read(path, 64, &length, NULL), *end = NULL;
    long long bytes = text ? strtoll(text, &end, 10) : 0; /* "max", or no such file: no limit */
    int64_t bound = text && end != text && bytes > 0 ? bytes / MIB : INT64_MAX;
    free(text);
    free(path);
    return bound;
}

int64_t host_group_memory_mb(const char *root, const char *group)
{
    char *at = mem_printf("%s%s", root, group);
    size_t top = strlen(root);
    int64_t least = INT64_MAX;
    for (;;) {
        int64_t bound = read_bound_mb(at);
        if (bound < least) least = bound;
        char *slash = strrchr(at + top, '/');
        if (!slash) break;
        *slash = '\0';
    }
    free(at);
    return least;
}

int64_t host_memory_mb(void)
{
    int64_t memory = (int64_t)sysconf(_SC_PHYS_PAGES) * sysconf(_SC_PAGESIZE) / MIB;
    size_t length = 0;
    char *text = store_file_read("/proc/self/cgroup", 1 << 16, &length, NULL);
    char *line = text ? strstr(text, "0::") : NULL; /* the line of control groups version 2 */
    if (line) {
        line[strcspn(line, "\n")] = '\0';
        int64_t bound = host_group_memory_mb(GROUPS, line + strlen("0::"));
        if (bound < memory) memory = bound;
    }
    free(text);
    return memory;
}

void host_name(char *name, size_t size)
{
    name[0] = '\0';
    gethostname(name, size);
    name[size - 1] = '\0';
}

void host_boot_id(char id[HOST_BOOT_ID_SIZE])
{
    size_t length = 0;
    char *text = store_file_read("/proc/sys/kernel/random/boot_id", HOST_BOOT_ID_SIZE - 1, &length, NULL);
    if (text) text[strcspn(text, "\n")] = '\0';
    snprintf(id, HOST_BOOT_ID_SIZE, "%s", text ? text : "");
    free(text);
}

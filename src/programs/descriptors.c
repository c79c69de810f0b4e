// SPDX-License-Identifier: Apache-2.0
#include "programs/descriptors.h"

#include <dirent.h>
#include <fcntl.h>
#include <stdint.h>
#include <sys/resource.h>
#include <unistd.h>

/* Opens closed standard descriptors. Otherwise the next opened file would get such a number, and log lines
 * would be written to the queue. */
static void open_standard_descriptors(void)
{
    int fd;
    do {
        fd = open("/dev/null", O_RDWR);
    } while (fd >= 0 && fd <= STDERR_FILENO);
    if (fd >= 0) close(fd);
}

/* Raises the soft limit: each connection needs a descriptor, and the usual limit is too low. */
static void raise_descriptor_limit(void)
{
    struct rlimit limit;
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
    limit.rlim_cur = limit.rlim_max;
    setrlimit(RLIMIT_NOFILE, &limit);
}

void descriptors_prepare(void)
{
    open_standard_descriptors();
    raise_descriptor_limit();
}

size_t descriptors_limit(void)
{
    struct rlimit limit;
    return getrlimit(RLIMIT_NOFILE, &limit) == 0 && limit.rlim_cur < SIZE_MAX ? (size_t)limit.rlim_cur
                                                                              : SIZE_MAX;
}

size_t descriptors_open(void)
{
    size_t count = 0;
    DIR *listing = opendir("/proc/self/fd");
    if (!listing) return 0;
    while (readdir(listing)) count++;
    closedir(listing);
    return count - 3; /* ".", ".." and the descriptor of the listing */
}

// SPDX-License-Identifier: Apache-2.0
#include "base/core/descriptor_wait.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/log.h"

static _Noreturn void end_process(const char *what)
{
    log_write(LOG_LEVEL_ERROR, "%s failed: %s. The process ends.", what, strerror(errno));
    _exit(EXIT_FAILURE);
}

void descriptor_wait(struct pollfd *descriptors, nfds_t count, int timeout_ms)
{
    for (nfds_t k = 0; k < count; k++) descriptors[k].revents = 0;
    if (poll(descriptors, count, timeout_ms) < 0 && errno != EINTR) end_process("poll");
}

bool descriptor_take_event(int descriptor, void *event, size_t size)
{
    ssize_t length = read(descriptor, event, size);
    if (length < 0 && errno != EAGAIN && errno != EINTR) end_process("Reading an event descriptor");
    return length == (ssize_t)size;
}

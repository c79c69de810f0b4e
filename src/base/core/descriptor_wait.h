// SPDX-License-Identifier: Apache-2.0
/* descriptor_wait: waits for descriptors in a loop that runs as long as the process.
 *
 * If the system calls of such a loop failed permanently, the loop would use a CPU without waiting. Therefore
 * errors are logged, and the process ends with status EXIT_FAILURE. The caller's state must survive such an
 * end, as the queue does.
 */
#ifndef HEXAD_BASE_CORE_DESCRIPTOR_WAIT_H
#define HEXAD_BASE_CORE_DESCRIPTOR_WAIT_H

#include <poll.h>
#include <stdbool.h>
#include <stddef.h>

/* As poll. An interrupted call returns with all `revents` 0. */
void descriptor_wait(struct pollfd *descriptors, nfds_t count, int timeout_ms);

/* Reads one event of `size` bytes from a non-blocking eventfd or signalfd. False: there is no event; *event
 * is undefined. */
bool descriptor_take_event(int descriptor, void *event, size_t size);

#endif

/* descriptor_wait: waits for descriptors in a loop that runs as long as the process.
 *
 * An error of such a loop's system calls would make it run without ever waiting, and take a whole processor. Here it is
 * logged, and the process ends with status EXIT_FAILURE. The caller's unfinished work must be safe from a sudden end of
 * the process, as the queue's is.
 */
#ifndef HEXAD_BASE_DESCRIPTOR_WAIT_H
#define HEXAD_BASE_DESCRIPTOR_WAIT_H

#include <poll.h>
#include <stdbool.h>
#include <stddef.h>

/* As poll. An interrupted call returns with all `revents` 0. */
void descriptor_wait(struct pollfd *descriptors, nfds_t count, int timeout_ms);

/* Reads one event of `size` bytes from a non-blocking eventfd or signalfd. False: there is none; *event is then
 * undefined. */
bool descriptor_take_event(int descriptor, void *event, size_t size);

#endif

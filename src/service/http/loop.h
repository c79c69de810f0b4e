// SPDX-License-Identifier: Apache-2.0
/* loop: the thread that accepts connections and serves them with a libmicrohttpd daemon.
 *
 * The library (0.9.75) has no thread and no listening socket here, because of two faults. Its own thread
 * (MHD_epoll) takes 128 events at a time, and after exactly 128 events it waits for more: 128, 256 or 512
 * simultaneously active connections then get no answer. If accept fails for lack of descriptors, it stops
 * watching its listening socket and watches it again only when something else makes it run: after the last
 * connection nothing does.
 *
 * This loop waits until the library's set of descriptors or a listening socket is ready, accepts connections,
 * and then calls the library with a timeout of 0. If a connection cannot be accepted, the listening sockets
 * are not watched for a moment, and the log has the reason. No wait is longer than a second, so that nothing
 * depends on a wake-up. A daemon without its own thread has no descriptor that wakes it. Connections are
 * therefore resumed through the loop, which wakes itself.
 */
#ifndef HEXAD_SERVICE_HTTP_LOOP_H
#define HEXAD_SERVICE_HTTP_LOOP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"

struct MHD_Connection;
struct MHD_Daemon;
typedef struct loop loop;

/* Serves a daemon that was started with MHD_USE_EPOLL and MHD_USE_NO_LISTEN_SOCKET, and without an internal
 * thread, on `count` listening sockets, which do not block and which the loop closes. While the daemon has
 * `capacity` connections, no further ones are accepted. *l is set before the thread starts, since handlers in
 * that thread use it. On failure *l is NULL, and the caller keeps the daemon and the sockets. */
bool loop_start(struct MHD_Daemon *daemon, const int *listening, size_t count, unsigned capacity, loop **l,
                error *e);

/* Resumes a suspended connection. Any thread, including the loop's own. */
void loop_resume(loop *l, struct MHD_Connection *connection);

/* Makes the loop turn at least once more. Any thread. */
void loop_wake(loop *l);

/* The number of the loop's turns. It stays the same while the thread is stuck. Any thread. */
uint64_t loop_turns(const loop *l);

/* Stops accepting connections; existing connections are still served. */
void loop_quiesce(loop *l);

/* Ends the thread; no handler runs afterwards. Suspended connections can still be resumed. Accepts NULL. */
void loop_end(loop *l);

/* Ends the thread and stops the daemon. The caller has resumed all suspended connections. Accepts NULL. */
void loop_stop(loop *l);

#endif

/* loop: the thread that serves the connections of a libmicrohttpd daemon.
 *
 * The library's own thread has a fault (0.9.75, MHD_epoll): it takes 128 events at a time, and after exactly 128
 * events it waits for more. 128, 256 or 512 simultaneously active connections then get no answer. This loop waits
 * until the library's set of descriptors is ready and then calls the library with a timeout of 0.
 *
 * A daemon without its own thread has no descriptor that wakes it. Connections are therefore resumed through the
 * loop, which wakes itself.
 */
#ifndef HEXAD_HTTP_LOOP_H
#define HEXAD_HTTP_LOOP_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"

struct MHD_Connection;
struct MHD_Daemon;
typedef struct loop loop;

/* Serves a daemon that was started with MHD_USE_EPOLL and without an internal thread, on its own listening socket and
 * on `count` more, which do not block and which the loop closes. *l is set before the thread starts, since handlers in
 * that thread use it. On failure *l is NULL, and the caller keeps the daemon and the sockets. */
bool loop_start(struct MHD_Daemon *daemon, const int *more, size_t count, loop **l, error *e);

/* Resumes a suspended connection. Any thread, including the loop's own. */
void loop_resume(loop *l, struct MHD_Connection *connection);

/* Stops accepting connections; existing connections are still served. */
void loop_quiesce(loop *l);

/* Ends the thread; no handler runs afterwards. Suspended connections can still be resumed. Accepts NULL. */
void loop_end(loop *l);

/* Ends the thread and stops the daemon. The caller has resumed all suspended connections. Accepts NULL. */
void loop_stop(loop *l);

#endif

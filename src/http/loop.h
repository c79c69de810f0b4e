/* loop: the thread that serves the connections of a libmicrohttpd daemon.
 *
 * The library's own thread takes 128 events at a time and waits for more when exactly 128 came (0.9.75,
 * MHD_epoll), so that 128, 256 or 512 connections that are busy at once get no answer. Here the library never
 * waits: the loop waits for its set of descriptors to become ready, and then runs it with no time to wait.
 *
 * A daemon without a thread of its own has no descriptor that wakes it, so whoever resumes a connection says so
 * to the loop.
 */
#ifndef HEXAD_HTTP_LOOP_H
#define HEXAD_HTTP_LOOP_H

#include <stdbool.h>

#include "base/error.h"

struct MHD_Connection;
struct MHD_Daemon;
typedef struct loop loop;

/* Serves a daemon that was started with MHD_USE_EPOLL and without an internal thread. *l is set before the thread
 * begins, for the handlers that it runs. On failure it is NULL, and the daemon stays the caller's. */
bool loop_start(struct MHD_Daemon *daemon, loop **l, error *e);

/* Lets a suspended connection go on. Any thread, also the loop's own. */
void loop_resume(loop *l, struct MHD_Connection *connection);

/* Takes no more connections; those there are are still served. */
void loop_quiesce(loop *l);

/* Ends the thread, so that no handler runs any more; connections that are suspended can still be resumed. Accepts
 * NULL. */
void loop_end(loop *l);

/* Ends the thread and stops the daemon. Every suspended connection was resumed. Accepts NULL. */
void loop_stop(loop *l);

#endif

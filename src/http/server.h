/* server: HTTP/1.1 over libmicrohttpd, whose only user this is.
 *
 * One thread serves all connections with epoll; a second one ends connections whose client takes
 * longer than timeout_s to begin a request or, from its first line on, to bring all of it, however
 * it drips (the library itself only knows idle time). Bodies over the limit are answered 413:
 * before they are read when their length is announced, at its end for a chunked one, of which
 * nothing is kept. A request with two lengths is refused.
 */
#ifndef HEXAD_HTTP_SERVER_H
#define HEXAD_HTTP_SERVER_H

#include "http/jobs.h"
#include "http/listen.h"

typedef struct server server;

typedef struct server_settings {
    size_t body_limit_bytes;
    unsigned connection_limit;
    double timeout_s;
} server_settings;

/* Serves until server_stop. The socket stays the caller's; the context outlives the server. */
server *server_start(const server_settings *settings, const listen_socket *s,
                     const jobs_context *context, error *e);

/* Takes no more connections, lets replies that are on their way end, and stops. Accepts NULL. */
void server_stop(server *s);

#endif

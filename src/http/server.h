/* server: HTTP/1.1 over libmicrohttpd, whose only user this is.
 *
 * One thread serves all connections with epoll and runs the handlers that only look; those that write or wait
 * for a worker are run by a pool of threads (http/thread_pool), while their connection is suspended. How many connections there may be and how
 * slow they may be is for http/connections to say. Bodies over the limit are answered 413: before they are read when their
 * length is announced, at its end for a chunked one, of which nothing is kept. A request with two lengths is refused.
 * What the library refuses itself (a request line or headers that are none, headers over header_limit_bytes)
 * has an answer in HTML of its own; every other error is a problem document.
 */
#ifndef HEXAD_HTTP_SERVER_H
#define HEXAD_HTTP_SERVER_H

#include "http/connections.h"
#include "http/handler.h"
#include "http/listen.h"
#include "http/pages.h"
#include "http/route.h"
#include "http/wait_list.h"

typedef struct server server;

typedef struct server_settings {
    const route_table *routes;
    const http_context *context; /* for the handlers */
    http_counters *counters;     /* kept up by the server */
    wait_list *waiting;
    connections_settings connections;
    size_t body_limit_bytes, header_limit_bytes;
    unsigned estimates;            /* requests that may wait for workers at once */
    const address_ranges *proxies; /* whose Forwarded is believed; these outlive the server */
    const pages *pages;
} server_settings;

/* Serves until server_stop. The socket stays the caller's; access and all that the settings point to outlive the
 * server. */
server *server_start(const server_settings *settings, const listen_socket *s, access_control *access,
                     error *e);

/* Takes no more connections, lets replies that are on their way end, and stops. Accepts NULL. */
void server_stop(server *s);

#endif

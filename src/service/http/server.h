// SPDX-License-Identifier: Apache-2.0
/* server: HTTP/1.1 with libmicrohttpd; only src/service/http uses that library.
 *
 * One thread serves all connections with epoll. The table of routes says which handlers it runs
 * (route.runs_in).
 * All others, and the producers of streams, run in pools of threads (service/http/thread_pool), while their
 * connection is suspended. service/http/connections limits the number of connections and the time of clients.
 * A body over the limit is answered with 413 and not stored. If its length is announced, the answer is sent
 * before the body is read;
 * otherwise (chunked) at its end. A request that a proxy may interpret differently is refused
 * (service/http/head). The library itself refuses input that is not a request, and headers over
 * header_limit_bytes, with an answer in HTML.
 * All other errors are problem documents.
 */
#ifndef HEXAD_SERVICE_HTTP_SERVER_H
#define HEXAD_SERVICE_HTTP_SERVER_H

#include "service/http/connections.h"
#include "service/http/handler.h"
#include "service/http/listen.h"
#include "service/http/pages.h"
#include "service/http/route.h"
#include "service/http/wait_list.h"
#include "service/ledger/ledger.h"

typedef struct server server;

typedef struct server_settings {
    const route_table *routes;
    const http_context *context; /* for the handlers */
    http_counters *counters;     /* the server increments them */
    wait_list *waiting;
    /* with the limits of connections, clients, bodies (at least body_limit_bytes + 1) and answers; must
     * outlive the server, which sets the limits of its threads */
    ledger *counts;
    connections_settings connections;
    size_t body_limit_bytes, header_limit_bytes;
    unsigned estimates; /* maximum number of requests that wait for an estimate */
    /* maximum time, in s, that a request waits for a thread of a pool */
    double thread_wait_s;
    const address_ranges *proxies; /* proxies whose header Forwarded is trusted */
    const pages *pages;
    const char *
        allow_command; /* permits the user whose name follows, for unknown local users; NULL: there is none */
} server_settings;

/* The number of threads that run handlers. */
unsigned server_threads(unsigned estimates);

/* Serves `count` >= 1 sockets until server_stop. They stay the caller's; access and all that the settings
 * point to outlive the server. */
server *server_start(const server_settings *settings, const listen_socket *sockets, size_t count,
                     access_control *access, error *e);

/* The number of turns of the serving thread, and a call that makes it turn at least once more. */
uint64_t server_turns(const server *s);
void server_wake(server *s);

/* Stops accepting connections, waits a limited time for answers in progress, and stops. Accepts NULL. */
void server_stop(server *s);

#endif

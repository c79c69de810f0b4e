/* server: HTTP/1.1 over libmicrohttpd; only src/http uses that library.
 *
 * One thread serves all connections with epoll. It runs handlers that only read memory; handlers that may
 * wait (route.waits) run in a pool of threads (http/thread_pool) while their connection is suspended.
 * http/connections limits the number of connections and the time of clients. A body over the limit is
 * answered with 413: before it is read when its length is announced, at its end when it is chunked; nothing
 * of it is kept. A request that a proxy may read otherwise is refused (http/head). The library itself refuses
 * what is not a request at all, and headers over header_limit_bytes, with an answer in HTML; all other errors are
 * problem documents.
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
    http_counters *counters;     /* the server counts in them */
    wait_list *waiting;
    connections_settings connections;
    size_t body_limit_bytes, header_limit_bytes;
    size_t body_total_bytes, user_body_bytes;     /* of bodies in memory, at least body_limit_bytes + 1 */
    size_t answer_total_bytes, user_answer_bytes; /* of long answers in memory */
    unsigned estimates;                           /* how many requests may wait for an estimate at once */
    double thread_wait_s;                         /* how long a request may wait for a thread of a pool */
    const address_ranges *proxies;                /* whose header Forwarded is trusted */
    const pages *pages;
    const char
        *settings_file; /* of the service, which the answer to an unknown local user names; NULL: none */
} server_settings;

/* Serves `count` >= 1 sockets until server_stop. They stay the caller's; access and all that the settings point to outlive
 * the server. */
server *server_start(const server_settings *settings, const listen_socket *sockets, size_t count,
                     access_control *access, error *e);

/* Accepts no more connections, waits for the answers under way (not forever), and stops. Accepts NULL. */
void server_stop(server *s);

#endif

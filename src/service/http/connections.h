// SPDX-License-Identifier: Apache-2.0
/* connections: limits the open connections of the server by user and by client, limits the time that clients
 * may take, and notices closed connections.
 *
 * A connection belongs to a user once one of its requests has identified the caller: by a token, or on a Unix
 * socket by the connected process. Every other connection belongs to its client. A client is an address (of
 * IPv6 the network, the first 64 bits), or an unknown user on a Unix socket. The ledger limits the
 * connections of each user, from all addresses together (LEDGER_CONNECTIONS), and those of each client
 * (LEDGER_CLIENT_CONNECTIONS). In total there are at most connection_limit connections; admin_reserve of them
 * are reserved for administrators.
 *
 * If a new connection would exceed a limit, the server closes the connection without a user that has been
 * idle longest: of the same client for the limit of a client, of all clients for connection_limit. If there
 * is no such connection, the new connection stays open until its first request identifies the caller. An
 * administrator may be admitted then; other callers are refused. Therefore idle connections of unknown
 * clients do not lock users out.
 *
 * The watcher, a task, closes a connection if the client takes longer than timeout_s to begin a request. It
 * also closes it if the client takes longer than timeout_s to send a request, measured from its first line to
 * its last byte. The library limits only idle time. The serving thread calls all functions.
 */
#ifndef HEXAD_SERVICE_HTTP_CONNECTIONS_H
#define HEXAD_SERVICE_HTTP_CONNECTIONS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "service/auth/access.h"
#include "base/core/error.h"
#include "service/http/address.h"
#include "service/ledger/ledger.h"

typedef struct connections connections;
typedef struct client_connection client_connection;

typedef struct connections_settings {
    unsigned connection_limit;
    unsigned admin_reserve; /* at most half of connection_limit takes effect */
    double timeout_s;
} connections_settings;

/* The number of connections that the library must accept. It exceeds the limit, so that connections over the
 * limit get an answer. */
unsigned connections_capacity(const connections_settings *settings);

/* The maximum number of descriptors of all connections: each may also read a file that is sent, or write
 * an upload. */
size_t connections_descriptors(const connections_settings *settings);

/* The ledger and the access control must outlive the connections. */
connections *connections_start(const connections_settings *settings, ledger *counts, access_control *access,
                               error *e);
void connections_stop(connections *p); /* call it after the last connection was removed; accepts NULL */

client_connection *connections_add(connections *p, int fd);
/* call it before the descriptor is closed */
void connections_remove(connections *p, client_connection *which);

/* Call it when the headers of a request have arrived. Returns whether the connection is admitted;
 * otherwise *why has the reason. `client` is the sender of the request; behind a proxy it differs from the
 * address of the connection. `caller` is NULL if unknown. The connection is not closed in favour of others
 * until connections_end_request. */
bool connections_begin_request(connections *p, client_connection *which, const address *client,
                               const access_caller *caller, ledger_refusal *why);
void connections_end_request(connections *p, client_connection *which);

/* Call it when the body of the request has not arrived yet. Until connections_end_time the connection may be
 * closed in favour of others if it belongs to no user. */
void connections_await_body(connections *p, client_connection *which);

/* Start and stop the time limit of the client (timeout_s). It does not run while the server works on an
 * answer. */
void connections_begin_time(connections *p, client_connection *which);
void connections_end_time(connections *p, client_connection *which);

/* The name in the ledger of a client whose user is unknown. `client` is the sender of the request. */
void connections_name_client(const client_connection *which, const address *client,
                             char holder[LEDGER_HOLDER_SIZE]);

/* Both results remain valid as long as the connection. The address has version 0 on a Unix socket. */
const access_peer *connections_access(const client_connection *which);
const address *connections_address(const client_connection *which);

#endif

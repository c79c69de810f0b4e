/* connections: the open connections of the server: their limits and deadlines, and the watcher that notices closed ones. This module limits how many there are, by user and by
 * client, and how long a client may take.
 *
 * A connection belongs to a user once one of its requests has identified the caller: by a token, or on a Unix
 * socket by the process that connected. A user has at most user_limit connections, from all addresses
 * together. Any other connection belongs to its client: an address (of IPv6 the network, the first 64 bits),
 * or an unknown user on a Unix socket. A client has at most client_limit connections. In total there are at
 * most connection_limit, of which admin_reserve are for administrators alone.
 *
 * When a new connection would exceed a limit, the server closes the connection that belongs to no user and
 * has been idle longest: of the same client for client_limit, of all clients for connection_limit. When there
 * is none, the new connection stays open until its first request identifies the caller: an administrator
 * may be admitted, other callers are refused. So idle connections of strangers lock no user out.
 *
 * A thread closes connections whose client takes longer than timeout_s to begin a request, or from its first
 * line on to send all of it, however slowly the bytes arrive; the library itself limits only idle time. The
 * serving thread calls all functions.
 */
#ifndef HEXAD_HTTP_CONNECTIONS_H
#define HEXAD_HTTP_CONNECTIONS_H

#include <stdbool.h>
#include <stdint.h>

#include "auth/access.h"
#include "base/error.h"
#include "http/address.h"

typedef struct connections connections;
typedef struct client_connection client_connection;

typedef enum connection_decision {
    CONNECTION_ADMITTED,
    CONNECTION_TOO_MANY_OF_CLIENT,
    CONNECTION_TOO_MANY_OF_USER,
    CONNECTION_TOO_MANY
} connection_decision;

typedef struct connections_settings {
    unsigned connection_limit, client_limit, user_limit;
    unsigned admin_reserve; /* at most half of connection_limit is used */
    double timeout_s;
} connections_settings;

/* How many connections the library must be able to hold: more than the limit, so that those over it get an
 * answer. */
unsigned connections_room(const connections_settings *settings);

connections *connections_start(const connections_settings *settings, access_control *access, error *e);
void connections_stop(connections *p); /* after the last connection was removed; accepts NULL */

client_connection *connections_add(connections *p, int fd);
void connections_remove(connections *p, client_connection *which); /* before its descriptor is closed */

/* The headers of a request have arrived; the result states whether it is admitted. `client` is its sender:
 * behind a proxy another address than the connection's. `caller` is NULL when unknown. Until
 * connections_end_request the connection is not closed to make room for others. */
connection_decision connections_begin_request(connections *p, client_connection *which, const address *client,
                                              const access_caller *caller);
void connections_end_request(connections *p, client_connection *which);

/* The body of the request is still to come: until connections_end_time the connection may be closed to make room, if it
 * belongs to no user. */
void connections_await_body(connections *p, client_connection *which);

/* Starts and stops the client's clock (timeout_s). It stops while the server works on an answer. */
void connections_begin_time(connections *p, client_connection *which);
void connections_end_time(connections *p, client_connection *which);

/* Both live as long as the connection. The address has version 0 on a Unix socket. */
const access_peer *connections_access(const client_connection *which);
const address *connections_address(const client_connection *which);

#endif

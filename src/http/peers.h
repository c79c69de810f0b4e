/* peers: the connections of the server: how many there may be, whose, and how long a client may take.
 *
 * A connection belongs to a user once one of its requests has told who asks: by a token, or on a Unix socket by the
 * process that connected. A user has at most user_limit of them, wherever they come from. Other connections belong to
 * the client, an address (of IPv6 its network, the first 64 bits) or a stranger on a Unix socket, which has at most
 * client_limit. All together there are at most connection_limit, of which admin_reserve are for administrators alone.
 *
 * Where one more would be too many, the connection that belongs to no user and has stood idle longest is ended for it:
 * of that client, or of all. When there is none, the connection stays for a moment, so that its request can tell who
 * asks: an administrator may come in, others are refused. So nobody's idle connections shut others out.
 *
 * A thread ends connections whose client takes longer than timeout_s to begin a request or, from its first
 * line on, to bring all of it, however it drips: the library itself only knows idle time. All functions are called by
 * the serving thread.
 */
#ifndef HEXAD_HTTP_PEERS_H
#define HEXAD_HTTP_PEERS_H

#include <stdbool.h>
#include <stdint.h>

#include "auth/access.h"
#include "base/error.h"
#include "http/address.h"

typedef struct peers peers;
typedef struct peer peer;

typedef enum peer_standing {
    PEER_WELCOME,
    PEER_TOO_MANY_OF_CLIENT,
    PEER_TOO_MANY_OF_USER,
    PEER_TOO_MANY
} peer_standing;

typedef struct peers_settings {
    unsigned connection_limit, client_limit, user_limit;
    unsigned admin_reserve; /* at most half of connection_limit is used */
    double timeout_s;
} peers_settings;

/* Connections that the library must be able to hold: some more than the limit, so that those over it get an
 * answer. */
unsigned peers_room(const peers_settings *settings);

peers *peers_start(const peers_settings *settings, access_control *access, error *e);
void peers_stop(peers *p); /* after the last peer was removed; accepts NULL */

peer *peers_add(peers *p, int fd);
void peers_remove(peers *p, peer *which); /* before its descriptor is closed */

/* A request begins, of which the headers have come: whether there is room for it. `client` is who sent it, behind a
 * proxy another address than the connection's; `caller` is NULL for one who is not known. The connection is not ended
 * for others' sake before peers_end_request. */
peer_standing peers_begin_request(peers *p, peer *which, const address *client, const access_caller *caller);
void peers_end_request(peers *p, peer *which);

/* From now on the client's time runs (begin), or does not (the rest is the server's). */
void peers_begin_time(peers *p, peer *which);
void peers_end_time(peers *p, peer *which);

const access_peer *peers_access(const peer *which); /* lives as long as the peer */
const address *peers_address(const peer *which);    /* of version 0 on a Unix socket; as peers_access */

#endif

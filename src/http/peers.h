/* peers: the connections of the server, and how long and how many of them a client may hold.
 *
 * A client is a user on a Unix socket, an address on TCP (of IPv6 its network, the first 64 bits). Over its
 * share of connections, or over the limit of all, a connection is answered 429 or 503 at its first request
 * and ended; a flood of them is ended without an answer, so that what one client does takes no place from others.
 * A thread ends connections whose client takes longer than timeout_s to begin a request or, from its first
 * line on, to bring all of it, however it drips: the library itself only knows idle time. Any thread.
 */
#ifndef HEXAD_HTTP_PEERS_H
#define HEXAD_HTTP_PEERS_H

#include <stdbool.h>
#include <stdint.h>

#include "auth/access.h"
#include "base/error.h"

typedef struct peers peers;
typedef struct peer peer;

typedef enum peer_standing { PEER_WELCOME, PEER_TOO_MANY_OF_CLIENT, PEER_TOO_MANY } peer_standing;

typedef struct peers_settings {
    unsigned connection_limit, client_limit;
    double timeout_s;
} peers_settings;

/* Connections that the library must be able to hold: some more than the limit, so that those over it get an
 * answer. */
unsigned peers_room(const peers_settings *settings);

peers *peers_start(const peers_settings *settings, access_control *access, error *e);
void peers_stop(peers *p); /* after the last peer was removed; accepts NULL */

peer *peers_add(peers *p, int fd);
void peers_remove(peers *p, peer *which); /* before its descriptor is closed */

/* From now on the client's time runs (begin), or does not (the rest is the server's). */
void peers_begin_time(peers *p, peer *which);
void peers_end_time(peers *p, peer *which);

peer_standing peers_standing(const peer *which);
const access_peer *peers_access(const peer *which); /* lives as long as the peer */

#endif

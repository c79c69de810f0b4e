// SPDX-License-Identifier: Apache-2.0
/* listen: sockets that the server listens on.
 *
 * `reach` states which clients can connect; access control depends on it.
 */
#ifndef HEXAD_SERVICE_HTTP_LISTEN_H
#define HEXAD_SERVICE_HTTP_LISTEN_H

#include <sys/types.h>

#include "base/core/error.h"

typedef enum listen_reach { LISTEN_UNIX, LISTEN_LOOPBACK, LISTEN_NETWORK } listen_reach;

typedef struct listen_socket {
    int fd;
    char *where;   /* the given address, or that of a socket that was taken over */
    char *address; /* the address that is served:  "127.0.0.1:43121", "[::1]:1", "unix:/path" */
    listen_reach reach;
    char *unix_path; /* NULL for TCP; removed by listen_close, unless another socket is there now */
    dev_t device;    /* of the socket at unix_path */
    ino_t inode;
} listen_socket;

/* Opens the socket. `where` is HOST:PORT, [HOST]:PORT or unix:/path. For a path, `shared` permits users other
 * than the service's own to connect. The error contains `where`. */
bool listen_open(const char *where, bool shared, listen_socket *s, error *e);
/* What listen_open would report as `reach`, without opening the socket. Error spec_invalid: `where` is malformed, or
 * its host is unknown. */
bool listen_find_reach(const char *where, listen_reach *reach, error *e);
/* Whether listen_open can create the socket of a path: its directory exists and is writable, and no other file is
 * there. True for a port. Creates nothing. */
bool listen_check_place(const char *where, error *e);
/* Sets the mode of a path that listen_open opened; `shared` permits other users to connect. A failure is
 * logged. Sockets without a path are unchanged. */
void listen_share(const listen_socket *s, bool shared);
/* Takes over a listening socket from the service manager. On failure the socket is closed. */
bool listen_adopt(int fd, listen_socket *s, error *e);
void listen_close(listen_socket *s); /* accepts an empty socket, whose address is NULL */

#endif

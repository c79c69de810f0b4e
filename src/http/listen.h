/* listen: the socket that the server serves.
 *
 * Who may be let in depends on who can reach it, which is why that stands beside the descriptor.
 */
#ifndef HEXAD_HTTP_LISTEN_H
#define HEXAD_HTTP_LISTEN_H

#include "base/error.h"

typedef enum listen_reach { LISTEN_UNIX, LISTEN_LOOPBACK, LISTEN_NETWORK } listen_reach;

typedef struct listen_socket {
    int fd;
    char *address; /* what is really served: "127.0.0.1:43121", "[::1]:1", "unix:/path" */
    listen_reach reach;
    char *unix_path; /* NULL for TCP; removed by listen_close */
} listen_socket;

/* `where` is HOST:PORT, [HOST]:PORT or unix:/path; of a path, `shared` says whether users besides the service's
 * own may connect. On failure an error that names it. */
bool listen_open(const char *where, bool shared, listen_socket *s, error *e);
/* A socket that somebody else made and listens on. On failure it is closed. */
bool listen_adopt(int fd, listen_socket *s, error *e);
void listen_close(listen_socket *s); /* accepts an empty one, whose address is NULL */

#endif

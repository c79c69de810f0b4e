/* listen: the socket that the server serves.
 *
 * There is no authentication yet, so an address that other machines could reach is refused.
 */
#ifndef HEXAD_HTTP_LISTEN_H
#define HEXAD_HTTP_LISTEN_H

#include "base/error.h"

typedef struct listen_socket {
    int fd;
    char *address;   /* what is really served: "127.0.0.1:43121", "[::1]:1", "unix:/path" */
    char *unix_path; /* NULL for TCP; removed by listen_close */
} listen_socket;

/* `where` is HOST:PORT, [HOST]:PORT or unix:/path. On failure an error that names it. */
bool listen_open(const char *where, listen_socket *s, error *e);
/* A socket that somebody else made and listens on. On failure it is closed. */
bool listen_adopt(int fd, listen_socket *s, error *e);
void listen_close(listen_socket *s); /* accepts an empty one, whose address is NULL */

#endif

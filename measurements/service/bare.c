// SPDX-License-Identifier: Apache-2.0
/* A server that is nothing but libmicrohttpd, to hold the daemon's replies against: it makes the same reply
 * to whatever is asked, as the library's manual shows it, in the kind of server that the daemon has.
 *
 *     bare SOCKET BYTES      until standard input ends; says "ready" on standard output
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <microhttpd.h>

#include "base/core/memory.h"

enum { CONNECTIONS = 2048 };

static _Noreturn void die(const char *what)
{
    fprintf(stderr, "bench/bare: %s: %s\n", what, strerror(errno));
    exit(2);
}

static int open_socket(const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (strlen(path) >= sizeof address.sun_path) die("path");
    strcpy(address.sun_path, path);
    if (fd < 0 || bind(fd, (struct sockaddr *)&address, sizeof address) != 0 || listen(fd, CONNECTIONS) != 0)
        die(path);
    return fd;
}

typedef struct body {
    char *text;
    size_t bytes;
} body;

static enum MHD_Result answer(void *context, struct MHD_Connection *connection, const char *path,
                              const char *method, const char *version, const char *data, size_t *size,
                              void **slot)
{
    (void)path, (void)method, (void)version, (void)data, (void)size;
    static char seen;
    if (!*slot) { /* the headers; the reply belongs to the end of the request */
        *slot = &seen;
        return MHD_YES;
    }
    const body *b = context;
    struct MHD_Response *reply = MHD_create_response_from_buffer(b->bytes, b->text, MHD_RESPMEM_MUST_COPY);
    MHD_add_response_header(reply, MHD_HTTP_HEADER_CONTENT_TYPE, "application/json");
    enum MHD_Result done = MHD_queue_response(connection, MHD_HTTP_OK, reply);
    MHD_destroy_response(reply);
    return done;
}

int main(int argc, char **argv)
{
    body b = {.bytes = argc == 3 ? strtoul(argv[2], NULL, 10) : 0};
    if (!b.bytes) {
        fputs("usage: bare SOCKET BYTES\n", stderr);
        return 2;
    }
    b.text = mem_alloc(b.bytes);
    memset(b.text, ' ', b.bytes);
    struct MHD_Daemon *daemon =
        MHD_start_daemon(MHD_USE_EPOLL_INTERNAL_THREAD, 0, NULL, NULL, answer, &b, MHD_OPTION_LISTEN_SOCKET,
                         open_socket(argv[1]), MHD_OPTION_CONNECTION_LIMIT, CONNECTIONS, MHD_OPTION_END);
    if (!daemon) die("the server does not start");
    puts("ready");
    fflush(stdout);
    while (getchar() != EOF) {
    }
    MHD_stop_daemon(daemon);
    free(b.text);
    unlink(argv[1]);
    return 0;
}

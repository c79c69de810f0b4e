// SPDX-License-Identifier: Apache-2.0
#include "service/http/listen.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "base/core/log.h"
#include "base/core/memory.h"
#include "base/core/user_name.h"
#include "files/file.h"

#define BACKLOG 1024

/* Mode of a socket; with SHARED_MODE all users may connect, since the kernel identifies them. */
enum { OWN_MODE = 0700, SHARED_MODE = 0666 };

static bool fail(error *e, const char *where, const char *what)
{
    return error_set(e, ERROR_INTERNAL, "listen %s: %s: %s", where, what, strerror(errno));
}

static bool is_loopback(const struct sockaddr *address)
{
    if (address->sa_family == AF_INET) {
        const struct sockaddr_in *v4 = (const struct sockaddr_in *)(const void *)address;
        return ntohl(v4->sin_addr.s_addr) >> 24 == 127;
    }
    const struct sockaddr_in6 *v6 = (const struct sockaddr_in6 *)(const void *)address;
    return address->sa_family == AF_INET6 && IN6_IS_ADDR_LOOPBACK(&v6->sin6_addr);
}

/* Splits HOST:PORT; the host may be in brackets. The caller frees both. */
static bool split(const char *where, char **host, char **port)
{
    const char *colon = strrchr(where, ':');
    if (!colon || colon == where || !colon[1] || strspn(colon + 1, "0123456789") != strlen(colon + 1))
        return false;
    /* getaddrinfo would reduce it modulo 65536 */
    if (strlen(colon + 1) > 5 || atoi(colon + 1) > 65535) return false;
    size_t length = (size_t)(colon - where);
    if (where[0] == '[' && where[length - 1] == ']')
        *host = mem_strndup(where + 1, length - 2);
    else
        *host = mem_strndup(where, length);
    *port = mem_strdup(colon + 1);
    return true;
}

static char *describe(int fd)
{
    union {
        struct sockaddr any;
        struct sockaddr_in v4;
        struct sockaddr_in6 v6;
    } a;
    socklen_t size = sizeof a;
    char text[INET6_ADDRSTRLEN] = "";
    if (getsockname(fd, &a.any, &size) != 0) return mem_strdup("?");
    if (a.any.sa_family == AF_INET6) {
        inet_ntop(AF_INET6, &a.v6.sin6_addr, text, sizeof text);
        return mem_printf("[%s]:%d", text, ntohs(a.v6.sin6_port));
    }
    inet_ntop(AF_INET, &a.v4.sin_addr, text, sizeof text);
    return mem_printf("%s:%d", text, ntohs(a.v4.sin_port));
}

/* A refused Unix socket: the directory must let this process create it. */
static bool fail_to_create(const char *path, const char *where, error *e)
{
    const char *end = strrchr(path, '/');
    const int fault = errno;
    char user[USER_NAME_SIZE];
    user_name_of(geteuid(), user);
    return error_set(e, ERROR_INTERNAL,
                     "listen %s: %s: the user %s cannot create a socket in %.*s: set listen to a path in a "
                     "directory of this user, which root makes by: install -d -o %s DIRECTORY",
                     where, strerror(fault), user, end > path ? (int)(end - path) : 1, path, user);
}

static bool bind_and_listen(int fd, const struct sockaddr *address, socklen_t size, const char *where,
                            error *e)
{
    if (bind(fd, address, size) != 0)
        return errno == EADDRINUSE
                   ? error_set(e, ERROR_INTERNAL,
                               "listen %s: another process uses this port: stop it, or choose another port",
                               where)
               : errno == EACCES && address->sa_family == AF_UNIX
                   ? fail_to_create(where + strlen("unix:"), where, e)
                   : fail(e, where, "bind");
    return listen(fd, BACKLOG) == 0 || fail(e, where, "listen");
}

/* Finds the addresses of HOST:PORT. The caller frees them. */
static bool resolve(const char *where, struct addrinfo **found, listen_reach *reach, error *e)
{
    char *host = NULL, *port = NULL;
    const struct addrinfo hints = {.ai_socktype = SOCK_STREAM, .ai_flags = AI_PASSIVE | AI_NUMERICSERV};
    if (!split(where, &host, &port))
        return error_set(e, ERROR_SPEC_INVALID, "listen: must be HOST:PORT or unix:/path (given %s)", where);
    const int why = getaddrinfo(host, port, &hints, found);
    free(host);
    free(port);
    if (why != 0) return error_set(e, ERROR_SPEC_INVALID, "listen %s: %s", where, gai_strerror(why));
    *reach = LISTEN_LOOPBACK;
    for (const struct addrinfo *a = *found; a; a = a->ai_next)
        if (!is_loopback(a->ai_addr)) *reach = LISTEN_NETWORK;
    return true;
}

static bool open_tcp(const char *where, listen_socket *s, error *e)
{
    struct addrinfo *found;
    listen_reach reach;
    const int one = 1;
    if (!resolve(where, &found, &reach, e)) return false;
    const int fd = socket(found->ai_family, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const bool ok = fd < 0 || setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &one, sizeof one) != 0
                        ? fail(e, where, "socket")
                        : bind_and_listen(fd, found->ai_addr, found->ai_addrlen, where, e);
    if (ok)
        *s = (listen_socket){.fd = fd, .where = mem_strdup(where), .address = describe(fd), .reach = reach};
    else if (fd >= 0)
        close(fd);
    freeaddrinfo(found);
    return ok;
}

static bool fail_as_other_file(const char *where, error *e)
{
    return error_set(e, ERROR_SPEC_INVALID,
                     "listen %s: the path exists and is not a socket: choose another path", where);
}

/* Removes the socket of a daemon that has ended. The socket of a daemon that answers is kept. */
static bool remove_stale(const struct sockaddr_un *address, const char *where, error *e)
{
    struct stat info;
    if (lstat(address->sun_path, &info) != 0) return true;
    if (!S_ISSOCK(info.st_mode)) return fail_as_other_file(where, e);
    int probe = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0); /* its queue may be full */
    if (probe < 0) return fail(e, where, "socket");
    bool alive =
        connect(probe, (const struct sockaddr *)address, sizeof *address) == 0 || errno != ECONNREFUSED;
    close(probe);
    if (alive)
        return error_set(e, ERROR_SPEC_INVALID,
                         "listen %s: another process uses this socket: stop it, or choose another path",
                         where);
    return unlink(address->sun_path) == 0 || fail(e, where, "unlink");
}

static bool read_path(const char *where, struct sockaddr_un *address, error *e)
{
    const char *path = where + strlen("unix:");
    *address = (struct sockaddr_un){.sun_family = AF_UNIX};
    if (*path != '/' || strlen(path) >= sizeof address->sun_path)
        return error_set(e, ERROR_SPEC_INVALID,
                         "listen %s: the path must be absolute and have at most %zu bytes", where,
                         sizeof address->sun_path - 1);
    strcpy(address->sun_path, path);
    return true;
}

static bool open_unix(const char *where, bool shared, listen_socket *s, error *e)
{
    struct sockaddr_un address;
    if (!read_path(where, &address, e)) return false;
    const char *path = address.sun_path;
    if (!remove_stale(&address, where, e)) return false;
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd < 0) return fail(e, where, "socket");
    bool ok = bind_and_listen(fd, (struct sockaddr *)&address, sizeof address, where, e);
    struct stat made;
    if (ok && shared && chmod(path, SHARED_MODE) != 0) ok = fail(e, where, "chmod");
    if (ok && lstat(path, &made) != 0) ok = fail(e, where, "lstat");
    if (!ok) {
        close(fd);
        return false;
    }
    *s = (listen_socket){.fd = fd,
                         .where = mem_strdup(where),
                         .address = mem_strdup(where),
                         .reach = LISTEN_UNIX,
                         .unix_path = mem_strdup(path),
                         .device = made.st_dev,
                         .inode = made.st_ino};
    return true;
}

static bool is_path(const char *where)
{
    return strncmp(where, "unix:", 5) == 0;
}

bool listen_check_place(const char *where, error *e)
{
    struct sockaddr_un address;
    struct stat info;
    if (!is_path(where)) return true;
    if (!read_path(where, &address, e)) return false;
    const char *path = address.sun_path;
    char *directory = store_parent_of(path);
    bool ok = access(directory, W_OK | X_OK) == 0;
    if (!ok && errno == EACCES)
        fail_to_create(path, where, e);
    else if (!ok)
        error_set(e, ERROR_INTERNAL, "listen %s: the directory %s: %s: %schoose another path", where,
                  directory, strerror(errno), errno == ENOENT ? "create it, or " : "");
    else if (lstat(path, &info) == 0 && !S_ISSOCK(info.st_mode))
        ok = fail_as_other_file(where, e);
    free(directory);
    return ok;
}

bool listen_open(const char *where, bool shared, listen_socket *s, error *e)
{
    return is_path(where) ? open_unix(where, shared, s, e) : open_tcp(where, s, e);
}

bool listen_find_reach(const char *where, listen_reach *reach, error *e)
{
    struct sockaddr_un address;
    struct addrinfo *found;
    *reach = LISTEN_UNIX;
    if (is_path(where)) return read_path(where, &address, e);
    if (!resolve(where, &found, reach, e)) return false;
    freeaddrinfo(found);
    return true;
}

void listen_share(const listen_socket *s, bool shared)
{
    mode_t mode = shared ? SHARED_MODE : OWN_MODE;
    if (s->unix_path && chmod(s->unix_path, mode) != 0)
        log_write(LOG_LEVEL_ERROR, "%s: mode %04o cannot be set: %s", s->unix_path, (unsigned)mode,
                  strerror(errno));
}

bool listen_adopt(int fd, listen_socket *s, error *e)
{
    union {
        struct sockaddr any;
        struct sockaddr_un local;
    } a = {.any.sa_family = AF_UNSPEC};
    socklen_t size = sizeof a, flag_size = sizeof(int);
    int listens = 0, type = 0;
    if (getsockopt(fd, SOL_SOCKET, SO_ACCEPTCONN, &listens, &flag_size) != 0 ||
        getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &flag_size) != 0 || !listens || type != SOCK_STREAM ||
        getsockname(fd, &a.any, &size) != 0) {
        error_set(e, ERROR_SPEC_INVALID,
                  "the socket that systemd passed is not a listening stream socket: correct "
                  "ListenStream= of hexad.socket");
    } else {
        const bool local = a.any.sa_family == AF_UNIX;
        char *address = local ? mem_printf("unix:%s", a.local.sun_path) : describe(fd);
        *s = (listen_socket){.fd = fd,
                             .where = mem_strdup(address),
                             .address = address,
                             .reach = local                 ? LISTEN_UNIX
                                      : is_loopback(&a.any) ? LISTEN_LOOPBACK
                                                            : LISTEN_NETWORK};
        return true;
    }
    close(fd);
    return false;
}

void listen_close(listen_socket *s)
{
    if (!s->address) return;
    struct stat there;
    const bool own = s->unix_path && lstat(s->unix_path, &there) == 0 && there.st_dev == s->device &&
                     there.st_ino == s->inode; /* while the socket is open, no other file has its inode */
    if (s->fd >= 0) close(s->fd);
    if (own) unlink(s->unix_path);
    free(s->where);
    free(s->address);
    free(s->unix_path);
    *s = (listen_socket){.fd = -1};
}

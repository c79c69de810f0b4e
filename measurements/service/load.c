// SPDX-License-Identifier: Apache-2.0
/* Load on an HTTP server at a Unix socket, by one thread over many connections that are kept open.
 *
 *     load get SOCKET PATHS CONNECTIONS LIMIT        PATHS: a file of paths, one a line, asked for in turn
 *     load post SOCKET PATHS CONNECTIONS LIMIT BODY  BODY: a file, sent as JSON
 *     load streams SOCKET PATHS COPIES               event streams of each path, at once, to their ends
 *     load rows DIRECTORY SECONDS                    durable transactions of one row in a second
 *
 * LIMIT is a number of requests, or seconds with an s behind: "2.5s". Each connection sends a request when
 * the last one is answered; with get, after a first one that is not counted. get and post print one JSON
 * object: count and failed (answers other than 2xx, of all), rate (a second), bytes (of the last body),
 * p50_ms, p99_ms and max_ms from sending to the last byte. streams says "open" when every stream has begun
 * and, when every stream has ended, an object a line: path, ids (of the events) and received_ms (when each
 * came, of the wall clock). */
#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "durable.h"

enum { BUFFER = 1 << 16, READY = 256 };
/* Of a server that says nothing any more: longer than anything that is asked here takes. */
static const int PATIENCE_MS = 120000;

static _Noreturn void die(const char *what)
{
    fprintf(stderr, "bench/load: %s: %s\n", what, strerror(errno));
    exit(2);
}

static double now_s(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static char *read_file(const char *path, size_t *length)
{
    char *text = NULL;
    size_t room = 0;
    FILE *in = fopen(path, "r");
    ssize_t got = in ? getdelim(&text, &room, '\0', in) : -1;
    if (got <= 0) die(path);
    fclose(in);
    *length = (size_t)got;
    return text;
}

typedef struct list {
    char *text; /* that the items are parts of */
    char **item;
    size_t count;
} list;

static list read_lines(const char *path)
{
    size_t length;
    list l = {0};
    l.text = read_file(path, &length);
    l.item = mem_alloc((length + 1) * sizeof *l.item);
    for (char *at = strtok(l.text, "\n"); at; at = strtok(NULL, "\n")) l.item[l.count++] = at;
    return l;
}

static void free_lines(list *l)
{
    free(l->text);
    free(l->item);
}

static int connect_to(const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (strlen(path) >= sizeof address.sun_path) die("path");
    strcpy(address.sun_path, path);
    if (fd < 0 || connect(fd, (struct sockaddr *)&address, sizeof address) != 0) die(path);
    return fd;
}

static void write_all(int fd, const char *data, size_t length)
{
    while (length) {
        ssize_t wrote = write(fd, data, length);
        if (wrote < 0) die("write");
        data += wrote;
        length -= (size_t)wrote;
    }
}

/* ---- requests, one after the other on each connection */

typedef struct caller {
    int fd;
    size_t used; /* of the buffer: what has come of the answer */
    double sent_s;
    char buffer[BUFFER];
} caller;

typedef struct load {
    char **request; /* one for each path */
    size_t request_count, next;
    size_t most; /* requests; SIZE_MAX: until the time is over */
    double until_s;
    size_t sent, failed, bytes;
    double *took;
    size_t took_count, took_room;
} load;

static char *print_request(const char *path, const char *body, size_t length)
{
    if (!body) return mem_printf("GET %s HTTP/1.1\r\nHost: localhost\r\n\r\n", path);
    return mem_printf("POST %s HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
                      "Content-Length: %zu\r\n\r\n%.*s",
                      path, length, (int)length, body);
}

/* Sends the next request, if there is to be one. */
static bool ask(load *l, caller *c)
{
    c->used = 0;
    c->sent_s = now_s(CLOCK_MONOTONIC);
    if (l->sent == l->most || c->sent_s >= l->until_s) return false;
    const char *request = l->request[l->next++ % l->request_count];
    l->sent++;
    write_all(c->fd, request, strlen(request));
    return true;
}

/* Reads what has come; whether that was the end of the answer. */
static bool hear(load *l, caller *c)
{
    ssize_t got = read(c->fd, c->buffer + c->used, BUFFER - 1 - c->used);
    if (got <= 0) die("the server closed the connection, or its answer is too long");
    c->used += (size_t)got;
    c->buffer[c->used] = '\0';
    const char *end = strstr(c->buffer, "\r\n\r\n"), *length = strcasestr(c->buffer, "\r\nContent-Length:");
    if (!end) return false;
    if (!length || length > end) die("an answer has no length");
    l->bytes = strtoul(length + strlen("\r\nContent-Length:"), NULL, 10);
    if (c->used < (size_t)(end + 4 - c->buffer) + l->bytes) return false;
    if (strncmp(c->buffer, "HTTP/1.1 2", 10) != 0) l->failed++;
    if (l->took_count == l->took_room)
        l->took = mem_resize(l->took, (l->took_room = l->took_room * 2 + 1024) * sizeof *l->took);
    l->took[l->took_count++] = now_s(CLOCK_MONOTONIC) - c->sent_s;
    return true;
}

static void watch(int set, int fd, void *whose)
{
    struct epoll_event event = {.events = EPOLLIN, .data.ptr = whose};
    if (epoll_ctl(set, EPOLL_CTL_ADD, fd, &event) != 0) die("epoll_ctl");
}

static int wait_for_some(int set, struct epoll_event ready[READY])
{
    int count = epoll_wait(set, ready, READY, PATIENCE_MS);
    if (count == 0) errno = ETIMEDOUT;
    if (count <= 0) die("no answer");
    return count;
}

static void run_callers(load *l, int set, caller *callers, size_t count)
{
    struct epoll_event ready[READY];
    size_t busy = 0;
    for (size_t i = 0; i < count; i++) busy += ask(l, &callers[i]);
    while (busy) {
        int some = wait_for_some(set, ready);
        for (int i = 0; i < some; i++)
            if (hear(l, ready[i].data.ptr) && !ask(l, ready[i].data.ptr)) busy--;
    }
}

/* Each connection is answered once, which is not counted: a server takes them in a few at a time. */
static void warm_up(const load *l, int set, caller *callers, size_t count)
{
    load first = {.request = l->request, .request_count = l->request_count, .most = count, .until_s = 1e300};
    run_callers(&first, set, callers, count);
    free(first.took);
}

/* Returns how long that took. */
static double run_load(load *l, const char *socket_path, size_t count, bool warm, double span_s)
{
    caller *callers = mem_alloc(count * sizeof *callers);
    int set = epoll_create1(EPOLL_CLOEXEC);
    for (size_t i = 0; i < count; i++) {
        callers[i].fd = connect_to(socket_path);
        watch(set, callers[i].fd, &callers[i]);
    }
    if (warm) warm_up(l, set, callers, count);
    double start = now_s(CLOCK_MONOTONIC);
    l->until_s = start + span_s;
    run_callers(l, set, callers, count);
    span_s = now_s(CLOCK_MONOTONIC) - start;
    for (size_t i = 0; i < count; i++) close(callers[i].fd);
    close(set);
    free(callers);
    return span_s;
}

static int compare(const void *a, const void *b)
{
    const double *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

static int run_requests(const char *socket_path, const char *paths, const char *connections,
                        const char *limit, const char *body_path)
{
    load l = {.most = SIZE_MAX};
    size_t length = 0;
    list lines = read_lines(paths);
    char *end, *body = body_path ? read_file(body_path, &length) : NULL;
    double number = strtod(limit, &end), most_s = 1e300;
    if (*end == 's')
        most_s = number;
    else
        l.most = (size_t)number;
    l.request = mem_alloc(lines.count * sizeof *l.request);
    l.request_count = lines.count;
    for (size_t i = 0; i < lines.count; i++) l.request[i] = print_request(lines.item[i], body, length);
    double span_s = run_load(&l, socket_path, strtoul(connections, NULL, 10), !body, most_s);
    size_t n = l.took_count;
    if (!n) die("nothing was asked");
    qsort(l.took, n, sizeof *l.took, compare);
    printf("{\"count\": %zu, \"failed\": %zu, \"rate\": %.1f, \"bytes\": %zu, \"p50_ms\": %.4f, "
           "\"p99_ms\": %.4f, \"max_ms\": %.4f}\n",
           n, l.failed, (double)n / span_s, l.bytes, l.took[n / 2] * 1e3, l.took[n * 99 / 100] * 1e3,
           l.took[n - 1] * 1e3);
    for (size_t i = 0; i < l.request_count; i++) free(l.request[i]);
    free(l.request);
    free(l.took);
    free(body);
    free_lines(&lines);
    return 0;
}

/* ---- event streams */

typedef struct stream {
    int fd;
    const char *path;
    bool open; /* its headers have come */
    size_t used;
    long long *id;
    double *received_ms;
    size_t count, room;
    char buffer[BUFFER]; /* lines that have no end yet */
} stream;

/* A line is "id: 17", or not of interest here: the ids of progress have a dot. */
static void take_line(stream *s, const char *line)
{
    if (!*line || *line == '\r') s->open = true;
    if (strncmp(line, "id: ", 4) != 0 || strchr(line, '.')) return;
    if (s->count == s->room) {
        s->room = s->room * 2 + 8;
        s->id = mem_resize(s->id, s->room * sizeof *s->id);
        s->received_ms = mem_resize(s->received_ms, s->room * sizeof *s->received_ms);
    }
    s->id[s->count] = atoll(line + 4);
    s->received_ms[s->count++] = now_s(CLOCK_REALTIME) * 1e3;
}

/* Whether there may be more to come. */
static bool follow(stream *s)
{
    ssize_t got = read(s->fd, s->buffer + s->used, BUFFER - 1 - s->used);
    if (got < 0) die("read");
    if (got == 0) return false;
    s->used += (size_t)got;
    char *line = s->buffer, *end;
    while ((end = memchr(line, '\n', s->used - (size_t)(line - s->buffer)))) {
        *end = '\0';
        take_line(s, line);
        line = end + 1;
    }
    s->used -= (size_t)(line - s->buffer);
    memmove(s->buffer, line, s->used);
    if (s->used == BUFFER - 1) die("a line is too long");
    return true;
}

/* HTTP/1.0: an answer without a length ends with the connection, and is not sent in chunks. */
static void open_stream(stream *s, const char *socket_path, const char *path)
{
    s->path = path;
    s->fd = connect_to(socket_path);
    char *request =
        mem_printf("GET %s HTTP/1.0\r\nHost: localhost\r\nAccept: text/event-stream\r\n\r\n", path);
    write_all(s->fd, request, strlen(request));
    free(request);
}

static void print_stream(const stream *s)
{
    printf("{\"path\": \"%s\", \"ids\": [", s->path);
    for (size_t i = 0; i < s->count; i++) printf("%s%lld", i ? ", " : "", s->id[i]);
    fputs("], \"received_ms\": [", stdout);
    for (size_t i = 0; i < s->count; i++) printf("%s%.0f", i ? ", " : "", s->received_ms[i]);
    puts("]}");
}

static int run_streams(const char *socket_path, const char *paths, const char *copies)
{
    struct epoll_event ready[READY];
    list lines = read_lines(paths);
    size_t count = lines.count * strtoul(copies, NULL, 10), open = 0, left = count;
    stream *streams = mem_alloc(count * sizeof *streams);
    int set = epoll_create1(EPOLL_CLOEXEC);
    for (size_t i = 0; i < count; i++) {
        open_stream(&streams[i], socket_path, lines.item[i % lines.count]);
        watch(set, streams[i].fd, &streams[i]);
    }
    while (left) {
        int some = wait_for_some(set, ready);
        for (int i = 0; i < some; i++) {
            stream *s = ready[i].data.ptr;
            bool was_open = s->open;
            if (!follow(s)) {
                close(s->fd);
                left--;
            }
            open += s->open && !was_open;
            if (s->open && !was_open && open == count) {
                puts("open");
                fflush(stdout);
            }
        }
    }
    for (size_t i = 0; i < count; i++) {
        print_stream(&streams[i]);
        free(streams[i].id);
        free(streams[i].received_ms);
    }
    free(streams);
    close(set);
    free_lines(&lines);
    return 0;
}

static void raise_descriptor_limit(void)
{
    struct rlimit limit;
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
    limit.rlim_cur = limit.rlim_max;
    setrlimit(RLIMIT_NOFILE, &limit);
}

int main(int argc, char **argv)
{
    const char *what = argc > 1 ? argv[1] : "";
    raise_descriptor_limit();
    if ((strcmp(what, "get") == 0 && argc == 6) || (strcmp(what, "post") == 0 && argc == 7))
        return run_requests(argv[2], argv[3], argv[4], argv[5], argv[6]); /* NULL: the end of the words */
    if (strcmp(what, "streams") == 0 && argc == 5) return run_streams(argv[2], argv[3], argv[4]);
    if (strcmp(what, "rows") == 0 && argc == 4) {
        printf("%.1f\n", durable_rows(argv[2], strtod(argv[3], NULL)));
        return 0;
    }
    fputs("usage: load get SOCKET PATHS CONNECTIONS LIMIT | load post SOCKET PATHS CONNECTIONS LIMIT BODY |"
          " load streams SOCKET PATHS COPIES | load rows DIRECTORY SECONDS\n",
          stderr);
    return 2;
}

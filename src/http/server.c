#include "http/server.h"

#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <microhttpd.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/memory.h"
#include "http/route.h"

/* Headers of one request, and the library's own needs. */
#define CONNECTION_MEMORY_BYTES (32 * 1024)
/* How long a stop waits for replies on their way. */
#define STOP_MS 5000
/* How late the watch may notice an overdue connection. */
#define WATCH_MS 250
#define NEVER INT64_MAX

/* A connection, from accept to close. Guarded by the server's mutex. */
typedef struct peer {
    int fd;
    int64_t since_ms; /* idle since, or in a request since its first line; NEVER while answered */
    struct peer *previous, *next;
} peer;

struct server {
    server_settings settings;
    const jobs_context *context;
    struct MHD_Daemon *daemon;
    pthread_t watch;
    pthread_mutex_t mutex;
    pthread_cond_t changed; /* monotonic clock */
    peer *peers;
    size_t busy; /* requests between their headers and their end */
    bool stopping;
};

/* A request, from its headers to its end. */
typedef struct exchange {
    route_match route;
    char *body;
    size_t length, room;
    bool too_large; /* the body: what still comes is thrown away */
} exchange;

static void peer_mark(server *s, struct MHD_Connection *connection, int64_t since_ms)
{
    const union MHD_ConnectionInfo *info =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT);
    if (!info || !info->socket_context) return;
    pthread_mutex_lock(&s->mutex);
    ((peer *)info->socket_context)->since_ms = since_ms;
    pthread_mutex_unlock(&s->mutex);
}

/* A request line has come: the time that the connection stood idle is not the request's. */
static void *note_request(void *context, const char *uri, struct MHD_Connection *connection)
{
    (void)uri;
    peer_mark(context, connection, clock_monotonic_ms());
    return NULL;
}

static void note_connection(void *context, struct MHD_Connection *connection, void **socket_context,
                            enum MHD_ConnectionNotificationCode code)
{
    server *s = context;
    pthread_mutex_lock(&s->mutex);
    if (code == MHD_CONNECTION_NOTIFY_STARTED) {
        peer *p = mem_alloc(sizeof *p);
        p->fd = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd;
        p->since_ms = clock_monotonic_ms();
        p->next = s->peers;
        if (p->next) p->next->previous = p;
        s->peers = p;
        *socket_context = p;
        pthread_cond_broadcast(&s->changed);
    } else if (*socket_context) { /* the library closes the descriptor after this */
        peer *p = *socket_context;
        if (p->previous)
            p->previous->next = p->next;
        else
            s->peers = p->next;
        if (p->next) p->next->previous = p->previous;
        free(p);
        *socket_context = NULL;
    }
    pthread_mutex_unlock(&s->mutex);
}

static void wait_at_most(server *s, int64_t ms)
{
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    until.tv_sec += ms / 1000;
    until.tv_nsec += ms % 1000 * 1000000;
    if (until.tv_nsec >= 1000000000) {
        until.tv_nsec -= 1000000000;
        until.tv_sec++;
    }
    pthread_cond_timedwait(&s->changed, &s->mutex, &until);
}

static void *watch(void *argument)
{
    server *s = argument;
    int64_t limit_ms = (int64_t)(s->settings.timeout_s * 1000);
    pthread_mutex_lock(&s->mutex);
    while (!s->stopping) {
        int64_t now = clock_monotonic_ms();
        for (peer *p = s->peers; p; p = p->next) {
            if (p->since_ms == NEVER || now - p->since_ms < limit_ms) continue;
            shutdown(p->fd, SHUT_RDWR); /* the serving thread sees the end and cleans up */
            p->since_ms = NEVER;
        }
        if (s->peers)
            wait_at_most(s, limit_ms < 4 * WATCH_MS ? limit_ms / 4 + 1 : WATCH_MS);
        else
            pthread_cond_wait(&s->changed, &s->mutex);
    }
    pthread_mutex_unlock(&s->mutex);
    return NULL;
}

static enum MHD_Result queue_reply(struct MHD_Connection *connection, reply *r)
{
    struct MHD_Response *response;
    if (r->fd >= 0) {
        response = MHD_create_response_from_fd64((uint64_t)r->fd_bytes, r->fd);
        if (response) r->fd = -1; /* the response closes it */
    } else {
        response = MHD_create_response_from_buffer(r->length, r->body, MHD_RESPMEM_MUST_FREE);
        if (response) r->body = NULL;
    }
    enum MHD_Result done = MHD_NO;
    if (response) {
        MHD_add_response_header(response, MHD_HTTP_HEADER_CONTENT_TYPE, r->content_type);
        MHD_add_response_header(response, MHD_HTTP_HEADER_CACHE_CONTROL, "no-store");
        MHD_add_response_header(response, "X-Content-Type-Options", "nosniff");
        for (size_t i = 0; i < r->header_count; i++)
            MHD_add_response_header(response, r->header[i].name, r->header[i].value);
        done = MHD_queue_response(connection, (unsigned)r->status, response);
        MHD_destroy_response(response);
    }
    reply_clear(r);
    return done;
}

typedef struct framing {
    int lengths, codings;
    bool chunked;
    const char *length;
} framing;

static enum MHD_Result read_header(void *context, enum MHD_ValueKind kind, const char *key,
                                   const char *value)
{
    (void)kind;
    framing *f = context;
    if (strcasecmp(key, MHD_HTTP_HEADER_CONTENT_LENGTH) == 0) {
        f->lengths++;
        f->length = value;
    } else if (strcasecmp(key, MHD_HTTP_HEADER_TRANSFER_ENCODING) == 0) {
        f->codings++;
        f->chunked = value && strcasecmp(value, "chunked") == 0;
    }
    return MHD_YES;
}

/* "application/json", perhaps with parameters. */
static bool is_json(const char *type)
{
    static const char wanted[] = "application/json";
    size_t length = sizeof wanted - 1;
    return type && strncasecmp(type, wanted, length) == 0 &&
           (type[length] == '\0' || type[length] == ';' || type[length] == ' ');
}

/* Answers from the headers alone what needs no body; true when *r was filled. */
static bool refuse_early(const server *s, struct MHD_Connection *connection, const char *method,
                         const char *path, exchange *x, reply *r)
{
    framing f = {0};
    MHD_get_connection_values(connection, MHD_HEADER_KIND, read_header, &f);
    route_find(method, path, &x->route);
    const route_match *route = &x->route;
    if (f.lengths > 1 || f.codings > 1 || (f.lengths && f.codings) || (f.codings && !f.chunked)) {
        reply_set_problem(r, "request_invalid", NULL,
                          "the length of the body is given more than once or not at all");
    } else if (!route->known) {
        reply_set_problem(r, "not_found", NULL, "nothing is served at %.200s", path);
    } else if (!route->handler) {
        reply_set_problem(r, "method_not_allowed", NULL, "%.32s does not apply to %.200s", method,
                          path);
        reply_add_header(r, MHD_HTTP_HEADER_ALLOW, route->allow);
    } else if (f.length && strtoull(f.length, NULL, 10) > s->settings.body_limit_bytes) {
        reply_set_problem(r, "body_too_large", NULL,
                          "the body has %.24s bytes and the limit is %zu", f.length,
                          s->settings.body_limit_bytes);
    } else if (route->takes_body &&
               !is_json(MHD_lookup_connection_value(connection, MHD_HEADER_KIND,
                                                    MHD_HTTP_HEADER_CONTENT_TYPE))) {
        reply_set_problem(r, "media_type_unsupported", NULL, "the body must be application/json");
    }
    if (!r->status) return false;
    /* whatever follows on this connection is not to be taken for a request */
    reply_add_header(r, MHD_HTTP_HEADER_CONNECTION, "close");
    return true;
}

static enum MHD_Result begin(server *s, struct MHD_Connection *connection, const char *method,
                             const char *path, void **slot)
{
    exchange *x = mem_alloc(sizeof *x);
    reply r = {.fd = -1};
    *slot = x;
    pthread_mutex_lock(&s->mutex);
    s->busy++;
    pthread_mutex_unlock(&s->mutex);
    if (!refuse_early(s, connection, method, path, x, &r)) return MHD_YES;
    peer_mark(s, connection, NEVER);
    log_write(LOG_LEVEL_DEBUG, "request method=%.32s path=%.200s status=%d", method, path,
              r.status);
    return queue_reply(connection, &r);
}

/* Takes a piece of the body. Over the limit nothing is kept any more; the answer has to wait for the
 * end, since the library sends replies before a body or after it, and the watch bounds that. */
static enum MHD_Result take_body(const server *s, exchange *x, const char *data, size_t *size)
{
    if (x->too_large || *size > s->settings.body_limit_bytes - x->length) {
        free(x->body);
        x->body = NULL;
        x->length = x->room = 0;
        x->too_large = true;
        *size = 0;
        return MHD_YES;
    }
    if (x->length + *size + 1 > x->room) {
        x->room = (x->length + *size) * 2 + 1;
        x->body = mem_resize(x->body, x->room);
    }
    memcpy(x->body + x->length, data, *size);
    x->length += *size;
    *size = 0;
    return MHD_YES;
}

static enum MHD_Result read_query(void *context, enum MHD_ValueKind kind, const char *key,
                                  const char *value)
{
    (void)kind;
    jobs_request *request = context;
    request->query[request->query_count].key = key;
    request->query[request->query_count++].value = value;
    return MHD_YES;
}

static enum MHD_Result finish(server *s, struct MHD_Connection *connection, const char *method,
                              const char *path, exchange *x)
{
    reply r = {.fd = -1};
    jobs_request request = {.body = x->body ? x->body : "", .length = x->length};
    if (x->body) x->body[x->length] = '\0';
    memcpy(request.parameter, x->route.parameter, sizeof request.parameter);
    peer_mark(s, connection, NEVER);
    if (x->too_large) {
        reply_set_problem(&r, "body_too_large", NULL,
                          "the body is longer than the limit of %zu bytes",
                          s->settings.body_limit_bytes);
        reply_add_header(&r, MHD_HTTP_HEADER_CONNECTION, "close");
    } else if (MHD_get_connection_values(connection, MHD_GET_ARGUMENT_KIND, NULL, NULL) >
               JOBS_MAX_QUERY) {
        reply_set_problem(&r, "request_invalid", NULL, "the query has more than %d parameters",
                          JOBS_MAX_QUERY);
    } else {
        MHD_get_connection_values(connection, MHD_GET_ARGUMENT_KIND, read_query, &request);
        x->route.handler(s->context, &request, &r);
    }
    log_write(LOG_LEVEL_DEBUG, "request method=%.32s path=%.200s status=%d", method, path,
              r.status);
    return queue_reply(connection, &r);
}

static enum MHD_Result answer(void *context, struct MHD_Connection *connection, const char *path,
                              const char *method, const char *version, const char *data,
                              size_t *size, void **slot)
{
    (void)version;
    server *s = context;
    if (!*slot) return begin(s, connection, method, path, slot);
    if (*size) return take_body(s, *slot, data, size);
    return finish(s, connection, method, path, *slot);
}

static int hex_digit(char c)
{
    const char digits[] = "0123456789abcdef";
    const char *found = c ? strchr(digits, tolower((unsigned char)c)) : NULL;
    return found ? (int)(found - digits) : -1;
}

/* Decodes %XX in place, all but %00: that stays as it is written, so that it neither ends the text
 * for those who read it nor names anything. */
static size_t unescape(void *context, struct MHD_Connection *connection, char *text)
{
    (void)context;
    (void)connection;
    char *to = text;
    for (const char *from = text; *from; from++) {
        int high = *from == '%' ? hex_digit(from[1]) : -1;
        int low = high >= 0 ? hex_digit(from[2]) : -1;
        bool escaped = low >= 0 && (high || low);
        *to++ = escaped ? (char)(high << 4 | low) : *from;
        if (escaped) from += 2;
    }
    *to = '\0';
    return (size_t)(to - text);
}

static void complete(void *context, struct MHD_Connection *connection, void **slot,
                     enum MHD_RequestTerminationCode why)
{
    (void)why;
    server *s = context;
    exchange *x = *slot;
    peer_mark(s, connection, clock_monotonic_ms());
    if (!x) return;
    free(x->body);
    free(x);
    *slot = NULL;
    pthread_mutex_lock(&s->mutex);
    s->busy--;
    pthread_cond_broadcast(&s->changed);
    pthread_mutex_unlock(&s->mutex);
}

static void write_library_log(void *context, const char *format, va_list arguments)
{
    (void)context;
    log_write_list(LOG_LEVEL_DEBUG, format, arguments);
}

static void server_free(server *s)
{
    pthread_cond_destroy(&s->changed);
    pthread_mutex_destroy(&s->mutex);
    free(s);
}

server *server_start(const server_settings *settings, const listen_socket *socket,
                     const jobs_context *context, error *e)
{
    server *s = mem_alloc(sizeof *s);
    s->settings = *settings;
    s->context = context;
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&s->changed, &monotonic);
    pthread_condattr_destroy(&monotonic);
    pthread_mutex_init(&s->mutex, NULL);
    int why = pthread_create(&s->watch, NULL, watch, s);
    if (why != 0) {
        error_set(e, ERROR_INTERNAL, "no thread for the server: %s", strerror(why));
        server_free(s);
        return NULL;
    }
    /* the library knows whole seconds; the watch is exact, this is behind it */
    unsigned idle_s = (unsigned)settings->timeout_s + 1;
    /* the library closes the socket that it is given */
    int fd = fcntl(socket->fd, F_DUPFD_CLOEXEC, 0);
    s->daemon = fd < 0 ? NULL
                       : MHD_start_daemon(
                             MHD_USE_EPOLL_INTERNAL_THREAD | MHD_USE_ITC | MHD_USE_ERROR_LOG, 0,
                             NULL, NULL, answer, s, MHD_OPTION_EXTERNAL_LOGGER, write_library_log,
                             NULL, MHD_OPTION_LISTEN_SOCKET, fd, MHD_OPTION_CONNECTION_LIMIT,
                             settings->connection_limit, MHD_OPTION_CONNECTION_TIMEOUT, idle_s,
                             MHD_OPTION_CONNECTION_MEMORY_LIMIT, (size_t)CONNECTION_MEMORY_BYTES,
                             MHD_OPTION_STRICT_FOR_CLIENT, 1, MHD_OPTION_NOTIFY_COMPLETED, complete,
                             s, MHD_OPTION_URI_LOG_CALLBACK, note_request, s,
                             MHD_OPTION_UNESCAPE_CALLBACK, unescape, NULL, MHD_OPTION_NOTIFY_CONNECTION, note_connection, s, MHD_OPTION_END);
    if (s->daemon) return s;
    error_set(e, ERROR_INTERNAL, "the HTTP server does not start on %s: %s", socket->address,
              strerror(errno));
    if (fd >= 0) close(fd);
    server_stop(s);
    return NULL;
}

void server_stop(server *s)
{
    if (!s) return;
    int fd = s->daemon ? MHD_quiesce_daemon(s->daemon) : -1;
    int64_t until = clock_monotonic_ms() + STOP_MS;
    pthread_mutex_lock(&s->mutex);
    while (s->busy && clock_monotonic_ms() < until) wait_at_most(s, until - clock_monotonic_ms());
    s->stopping = true;
    pthread_cond_broadcast(&s->changed);
    pthread_mutex_unlock(&s->mutex);
    pthread_join(s->watch, NULL);
    if (s->daemon) MHD_stop_daemon(s->daemon);
    if (fd >= 0) close(fd);
    server_free(s);
}

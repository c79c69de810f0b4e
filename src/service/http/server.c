// SPDX-License-Identifier: Apache-2.0
#include "service/http/server.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/queue.h>
#include <sys/socket.h>
#include <unistd.h>

#include <microhttpd.h>

#include "files/scope.h"
#include "base/core/background.h"
#include "base/core/clock.h"
#include "base/core/hex.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/http/fields.h"
#include "service/http/forwarded.h"
#include "service/http/head.h"
#include "service/http/header_list.h"
#include "service/http/loop.h"
#include "service/http/parameter.h"
#include "service/http/route.h"
#include "service/http/thread_pool.h"
#include "service/http/wait_list.h"

/* A long body restarts the time limit of its request after each of this number of bytes. */
#define UPLOAD_STEP_BYTES (1 << 20)
/* Maximum time, in ms, between two writes to a stream; a closed connection is noticed by a write. */
#define STREAM_TICK_MS 15000
#define STREAM_BLOCK_BYTES 16384
/* Maximum time, in ms, that server_stop waits for answers in progress. */
#define STOP_MS 5000
/* Minimum length, in bytes, of answers that count for the memory of answers. A shorter answer takes little
 * more than its connection. */
#define LONG_ANSWER_BYTES 16384
/* Maximum number of threads of one user: this many submissions share a flush of the queue. The threads sleep
 * most of the time. Further threads wait for estimates. */
#define USER_THREADS 32
/* Number of threads that remain for other users. */
#define SPARE_THREADS 8
/* Minimum length, in bytes, of bodies that count as heavy work: a document takes up to 100 times the memory
 * of its text. */
#define HEAVY_BYTES 32768
/* Maximum number of simultaneous requests of heavy routes. */
#define HEAVY_AT_ONCE 2
/* Number of threads for heavy work, in total and of one user. Requests with long bodies may wait for
 * estimates. */
#define HEAVY_THREADS 16
#define HEAVY_USER_THREADS 12
/* Number of threads for pictures, in total and of one user. Each waits for a process that decodes a
 * picture. */
#define PICTURE_THREADS 4
#define PICTURE_USER_THREADS 2
/* Number of threads that produce the bytes of streams, in total and of one user. */
#define STREAM_THREADS 4
#define STREAM_USER_THREADS 2
/* Added to the nice value of threads for heavy work, for pictures and for streams. If both compute, such a
 * thread gets a tenth of the processor time of a thread with the priority of the process. */
#define HEAVY_NICE 10

struct server {
    server_settings settings;
    access_control *access;
    loop *loop;
    connections *connections;
    thread_pool *pool, *heavy_pool, *picture_pool, *stream_pool;
    pthread_mutex_t mutex;
    pthread_cond_t changed;       /* monotonic clock */
    size_t busy;                  /* requests between their headers and their end */
    LIST_HEAD(, exchange) unread; /* requests between their first line and the end of their headers */
};

/* A request, from its first line to its end. */
typedef struct exchange {
    thread_pool_work work; /* first member: the pool refers to it */
    server *s;
    struct MHD_Connection *connection;
    LIST_ENTRY(exchange) link; /* in the list of unread requests */
    head_target target;
    bool begun;   /* its headers have arrived */
    bool refused; /* refuse_unread has refused it; the library closes the connection */
    route_match route;
    access_caller caller;
    bool known;              /* whether `caller` is set */
    address client;          /* for limits and the log */
    const char *page_origin; /* origin of a page that may read the answer; NULL: none */
    http_request request;
    char *body;
    size_t capacity;           /* of `body`, taken from the ledger */
    ledger_decision body_fits; /* otherwise the rest of the body is ignored */
    size_t step;               /* bytes of a long body since the client's time was restarted */
    bool too_large;            /* the rest of the body is ignored */
    bool answered;             /* the rest of the body is discarded */
    bool opening;              /* the pool opens the sink, and the library's next call has no body */
    bool awaits;               /* there is a provisional answer */
    bool chunked;
    reply answer;
    int64_t answer_bytes;      /* taken from the ledger */
    reply_receipt *receipt;    /* of the answer that is being sent */
    struct MHD_Response *file; /* the answer that is being sent, if it is a file */
    bool sent;                 /* the whole answer, with its body */
    bool head;                 /* a HEAD request: the body is not sent */
    /* the values of headers that were sent several times; NULL: others */
    char *joined[HTTP_HEADER_COUNT];
} exchange;

static const char *const header_names[HTTP_HEADER_COUNT] = {
    [HTTP_ACCEPT] = "Accept",     [HTTP_IDEMPOTENCY_KEY] = "Idempotency-Key",
    [HTTP_IF_MATCH] = "If-Match", [HTTP_IF_NONE_MATCH] = "If-None-Match",
    [HTTP_IF_RANGE] = "If-Range", [HTTP_LAST_EVENT_ID] = "Last-Event-ID",
    [HTTP_ORIGIN] = "Origin",     [HTTP_PREFER] = "Prefer",
    [HTTP_RANGE] = "Range",       [HTTP_TRACEPARENT] = "traceparent",
};

static client_connection *connection_of(struct MHD_Connection *connection)
{
    const union MHD_ConnectionInfo *info =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT);
    return info ? info->socket_context : NULL;
}

/* Called when a request line has arrived. The time of the request begins now, without the idle time before
 * it. */
static void *note_request(void *context, const char *uri, struct MHD_Connection *connection)
{
    server *s = context;
    connections_begin_time(s->connections, connection_of(connection));
    exchange *x = mem_alloc(sizeof *x);
    x->s = s;
    x->connection = connection;
    x->answer.fd = -1;
    x->target = head_look(uri);
    LIST_INSERT_HEAD(&s->unread, x, link);
    return x;
}

static void leave_unread(exchange *x)
{
    LIST_REMOVE(x, link);
}

static void note_connection(void *context, struct MHD_Connection *connection, void **socket_context,
                            enum MHD_ConnectionNotificationCode code)
{
    server *s = context;
    if (code == MHD_CONNECTION_NOTIFY_STARTED) {
        int fd = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd;
        *socket_context = connections_add(s->connections, fd);
        s->settings.counters->connections++;
    } else { /* the library closes the descriptor after this */
        connections_remove(s->connections, *socket_context);
        s->settings.counters->connections--;
        *socket_context = NULL;
    }
}

/* A reply whose body a pool produces while it is sent. */
typedef struct stream {
    thread_pool_work work; /* first member: the pool refers to it */
    server *s;
    struct MHD_Connection *connection; /* suspended while the pool has the work or a topic is awaited */
    reply_source *source;
    const char *piece; /* the serving thread copies it */
    size_t length, sent;
    bool ended; /* no piece follows */
    char topic[REPLY_TOPIC_SIZE];
    char user[ACCESS_USER_SIZE];
    uint64_t generation; /* of the tokens that identified the caller; 0: without a token */
    int64_t until_ms;    /* end of the caller's session, wall clock; 0: no session */
} stream;

/* Whether the service stops, a token may have been revoked, or a session has ended. The client then
 * reconnects and is identified again. */
static bool is_outdated(const stream *t)
{
    access_control *access = t->s->access;
    return wait_list_is_dismissed(t->s->settings.waiting) ||
           (t->generation && t->generation != access_generation(access)) ||
           access_session_is_over(access, t->until_ms);
}

/* Produces the next piece, or lets the stream wait for its topic. */
static void produce_in_pool(thread_pool_work *work)
{
    stream *t = (stream *)(void *)work;
    wait_list *waiting = t->s->settings.waiting;
    uint64_t seen = wait_list_seen(waiting);
    ssize_t count = t->source->produce(t->source, &t->piece);
    t->length = count > 0 ? (size_t)count : 0;
    t->sent = 0;
    t->ended = count < 0;
    /* from its resumption on, the stream may end */
    if (count)
        loop_resume(t->s->loop, t->connection);
    else if (!wait_list_add(waiting, t->s->loop, t->connection, seen, t->topic,
                            clock_monotonic_ms() + STREAM_TICK_MS))
        thread_pool_add(t->s->stream_pool, work); /* something has happened meanwhile */
}

static void end_in_pool(thread_pool_work *work, thread_pool_refusal why)
{
    (void)why;
    stream *t = (stream *)(void *)work;
    t->ended = true;
    loop_resume(t->s->loop, t->connection);
}

/* Copies bytes that the pool has produced. If there are none, suspends the connection until there are. */
static ssize_t read_stream(void *context, uint64_t position, char *buffer, size_t size)
{
    (void)position;
    stream *t = context;
    size_t left = t->length - t->sent, count = left < size ? left : size;
    if ((!left && t->ended) || is_outdated(t)) return MHD_CONTENT_READER_END_OF_STREAM;
    if (!left) {
        MHD_suspend_connection(t->connection);
        thread_pool_add(t->s->stream_pool, &t->work);
        return 0;
    }
    memcpy(buffer, t->piece + t->sent, count);
    t->sent += count;
    return (ssize_t)count;
}

static void free_stream(void *context)
{
    stream *t = context;
    t->source->free(t->source);
    free(t);
}

static struct MHD_Response *open_stream(const exchange *x, reply *r)
{
    stream *t = mem_alloc(sizeof *t);
    *t = (stream){.s = x->s,
                  .connection = x->connection,
                  .source = r->source,
                  .generation = x->caller.generation,
                  .until_ms = x->caller.session_ends_ms};
    t->work = (thread_pool_work){.run = produce_in_pool, .refuse = end_in_pool, .user = t->user};
    memcpy(t->topic, r->topic, sizeof t->topic);
    memcpy(t->user, x->caller.user, sizeof t->user);
    struct MHD_Response *response =
        MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, STREAM_BLOCK_BYTES, read_stream, t, free_stream);
    if (response)
        r->source = NULL;
    else
        free(t);
    return response;
}

/* Permits the browser to show the answer to pages of this origin, and to cache it for this origin only. */
static void add_page_headers(const char *origin, struct MHD_Response *response)
{
    MHD_add_response_header(response, MHD_HTTP_HEADER_VARY, MHD_HTTP_HEADER_ORIGIN);
    if (!origin) return;
    MHD_add_response_header(response, "Access-Control-Allow-Origin", origin);
    MHD_add_response_header(response, "Access-Control-Expose-Headers",
                            "Allow, Content-Range, ETag, Location, Preference-Applied, Retry-After,"
                            " WWW-Authenticate");
}

/* The holder of the memory of a long answer: the user, or the client if its user is unknown. */
static const char *reader_of(const exchange *x, char text[LEDGER_HOLDER_SIZE])
{
    if (*x->caller.user) return x->caller.user;
    connections_name_client(connection_of(x->connection), &x->client, text);
    return text;
}

/* Whether the request may be repeated after its answer was refused. */
static bool changes_nothing(const exchange *x, const char *method)
{
    return strcmp(method, MHD_HTTP_METHOD_GET) == 0 ||
           (x->route.found && x->route.found->scope == SCOPE_READ);
}

/* Counts a long answer, or replaces it by a refusal: clients that do not read their answers would fill the
 * memory. An answer that is longer than the limit counts as the limit. */
static void count_answer(exchange *x, reply *r)
{
    ledger *counts = x->s->settings.counts;
    char text[LEDGER_HOLDER_SIZE];
    if (!r->body || r->length < LONG_ANSWER_BYTES) return;
    const ledger_limits most = ledger_get_limits(counts, LEDGER_ANSWERS);
    int64_t bytes = (int64_t)r->length;
    if (most.holder && bytes > most.holder) bytes = most.holder;
    if (most.all && bytes > most.all) bytes = most.all;
    ledger_decision fits = ledger_take(counts, LEDGER_ANSWERS, reader_of(x, text), bytes);
    if (fits == LEDGER_FITS)
        x->answer_bytes = bytes;
    else
        reply_set_refusal(r, ledger_explain(counts, LEDGER_ANSWERS, fits, reader_of(x, text)));
}

static enum MHD_Result queue_reply(exchange *x, reply *r)
{
    struct MHD_Response *response;
    const bool is_file = r->fd >= 0;
    if (r->source) {
        response = open_stream(x, r);
    } else if (is_file) {
        response =
            MHD_create_response_from_fd_at_offset64((uint64_t)r->fd_bytes, r->fd, (uint64_t)r->fd_offset);
        if (response) r->fd = -1; /* the response closes it */
    } else if (r->constant) {
        response = MHD_create_response_from_buffer(r->length, (void *)(uintptr_t)r->constant,
                                                   MHD_RESPMEM_PERSISTENT);
    } else {
        response = MHD_create_response_from_buffer(r->length, r->body, MHD_RESPMEM_MUST_FREE);
        if (response) r->body = NULL;
    }
    enum MHD_Result done = MHD_NO;
    if (response) {
        if (r->content_type) MHD_add_response_header(response, MHD_HTTP_HEADER_CONTENT_TYPE, r->content_type);
        MHD_add_response_header(response, "X-Content-Type-Options", "nosniff");
        MHD_add_response_header(response, MHD_HTTP_HEADER_CACHE_CONTROL,
                                r->cache_control ? r->cache_control : "no-store");
        for (size_t i = 0; i < r->header_count; i++)
            MHD_add_response_header(response, r->header[i].name, r->header[i].value);
        /* readers of chunks differ in malformed ones, so no bytes after this body are read as a request */
        if (x->chunked) MHD_add_response_header(response, MHD_HTTP_HEADER_CONNECTION, "close");
        if (pages_has_listed(x->s->settings.pages)) add_page_headers(x->page_origin, response);
        done = MHD_queue_response(x->connection, (unsigned)r->status, response);
        if (is_file)
            x->file = response;
        else
            MHD_destroy_response(response);
    }
    x->receipt = r->receipt;
    r->receipt = NULL;
    reply_clear(r);
    return done;
}

/* Identifies the caller and the client address. */
static void identify(exchange *x, const fields *f)
{
    const client_connection *from = connection_of(x->connection);
    const char *session =
        MHD_lookup_connection_value(x->connection, MHD_COOKIE_KIND, access_session_cookie(x->s->access));
    x->known = f->authorizations < 2 &&
               access_identify(x->s->access, connections_access(from), f->authorization, session, &x->caller);
    x->client = *connections_address(from);
    if (f->forwarded_count && f->forwarded_count <= FIELDS_MOST_FORWARDED)
        x->client = forwarded_client(&x->client, x->s->settings.proxies, f->forwarded, f->forwarded_count);
}

/* Refuses a connection over a limit, at its first request. */
static bool refuse_connection(exchange *x, reply *r)
{
    client_connection *p = connection_of(x->connection);
    bool is_user = x->known && (x->caller.generation || connections_access(p)->local);
    ledger_refusal why;
    if (connections_begin_request(x->s->connections, p, &x->client, is_user ? &x->caller : NULL, &why))
        return false;
    x->s->settings.counters->refused++;
    reply_set_refusal(r, why);
    return true;
}

/* Refuses a user of the Unix socket without a token. The answer has the user's number, because looking up the
 * name may block the serving thread; hexadctl adds the name to `allow_command`. */
static void set_user_unknown(uid_t uid, const char *allow_command, reply *r)
{
    if (allow_command) {
        reply_set_problem(r, "unauthorized", NULL,
                          "the user with the number %u may not use this service: ask the administrator to run"
                          " `%s %u` as root, or send a token",
                          (unsigned)uid, allow_command, (unsigned)uid);
        reply_add_member(r, "allow_command", json_new_string(allow_command));
    } else {
        reply_set_problem(
            r, "unauthorized", NULL,
            "the user with the number %u may not use this service, which has no settings file:"
            " ask the administrator to restart it with %u in its option --unix_users, or send a token",
            (unsigned)uid, (unsigned)uid);
    }
}

static void set_unauthorized(const exchange *x, const access_peer *from, const fields *f, reply *r)
{
    if (from->local && !f->authorization)
        set_user_unknown(from->uid, x->s->settings.allow_command, r);
    else
        reply_set_problem(r, "unauthorized", NULL,
                          f->authorization
                              ? ACCESS_TOKEN_UNKNOWN
                              : "this request requires a token: send the header Authorization: Bearer TOKEN");
    reply_add_header(r, MHD_HTTP_HEADER_WWW_AUTHENTICATE,
                     f->authorization ? "Bearer realm=\"hexad\", error=\"invalid_token\""
                                      : "Bearer realm=\"hexad\"");
}

/* Whether a page of another origin sent the request. Links on it may lead to routes that need no scope. */
static bool is_foreign_page(const exchange *x, const fields *f)
{
    if (f->origins) return f->origins > 1 || !pages_is_permitted(x->s->settings.pages, f->origin);
    if (!f->site || strcmp(f->site, "same-origin") == 0 || strcmp(f->site, "none") == 0) return false;
    const route *found = x->route.found;
    return !(found && !found->scope && f->destination && strcmp(f->destination, "document") == 0);
}

/* On TCP, refuses requests for other hosts and from web pages of other origins, unless they have a token. A
 * request without Host is not from a browser, since all browsers send it. */
static bool refuse_page(const exchange *x, const fields *f, reply *r)
{
    const access_peer *from = connections_access(connection_of(x->connection));
    if (from->local || (f->authorization && x->known)) return false;
    bool other_host = f->hosts && !pages_is_host(x->s->settings.pages, f->host);
    if (!other_host && !is_foreign_page(x, f)) return false;
    if (f->authorization && !from->scopes)
        set_unauthorized(x, from, f, r); /* a program with a wrong token */
    else if (other_host)
        reply_set_problem(r, "misdirected_request", NULL,
                          "this service does not have the host name %.200s: use the address that it listens "
                          "on, send a token, or add an origin with this host to the setting page_origins",
                          f->host);
    else
        reply_set_problem(r, "origin_forbidden", NULL,
                          "pages of %.200s may not send requests to this service: add this origin to the "
                          "setting page_origins",
                          f->origins ? f->origin : "another site");
    return true;
}

/* Answers a preflight request (CORS) of a page that may send requests. */
static bool answer_preflight(const exchange *x, const char *method, reply *r)
{
    if (!x->page_origin || strcmp(method, MHD_HTTP_METHOD_OPTIONS) != 0 ||
        !MHD_lookup_connection_value(x->connection, MHD_HEADER_KIND, "Access-Control-Request-Method"))
        return false;
    reply_set_empty(r, MHD_HTTP_NO_CONTENT);
    reply_add_header(r, "Access-Control-Allow-Methods", "GET, HEAD, POST, PUT, PATCH, DELETE");
    reply_add_header(
        r, "Access-Control-Allow-Headers",
        "Accept, Authorization, Content-Type, Idempotency-Key, If-Match, If-None-Match, If-Range,"
        " Last-Event-ID, Prefer, Range, traceparent");
    reply_add_header(r, "Access-Control-Max-Age", "600");
    return true;
}

/* Refuses a caller without the scope. Only an administrator can give it, by a setting or a token. */
static void set_scope_missing(const exchange *x, const fields *f, unsigned scope, reply *r)
{
    const access_caller *caller = &x->caller;
    char scopes[SCOPE_TEXT_SIZE];
    if (connections_access(connection_of(x->connection))->local && !f->authorization)
        reply_set_problem(
            r, "forbidden", NULL,
            "this request requires the scope %s, which %s does not have: ask the administrator to add "
            "%s to the setting unix_admins",
            scope_name(scope), caller->user, caller->user);
    else
        reply_set_problem(
            r, "forbidden", NULL,
            "this request requires the scope %s, which %s does not have: use a token with this scope, or "
            "ask the administrator to run `hexadctl token add %s --scopes %s`",
            scope_name(scope), caller->user, caller->generation ? caller->user : "USER",
            scope_print(caller->scopes | scope, scopes));
}

/* Refuses callers without a token or without the scope of the route. */
static bool refuse_caller(const exchange *x, const fields *f, reply *r)
{
    const route_match *match = &x->route;
    if (match->found && !match->found->scope) return false; /* the route needs no scope */
    if (!x->known) {
        set_unauthorized(x, connections_access(connection_of(x->connection)), f, r);
        return true;
    }
    if (!match->found || x->caller.scopes & match->found->scope) return false;
    set_scope_missing(x, f, match->found->scope, r);
    return true;
}

static bool refuse_body(const exchange *x, const fields *f, reply *r)
{
    size_t limit = x->s->settings.body_limit_bytes;
    if (x->route.found->body && f->coded) {
        reply_set_problem(r, "media_type_unsupported", NULL,
                          "the body is encoded: send it as it is, without the header Content-Encoding");
        reply_add_header(r, MHD_HTTP_HEADER_ACCEPT_ENCODING, "identity");
        return true;
    }
    if (x->route.found->opener) return false;
    if (f->length && strtoull(f->length, NULL, 10) > limit) {
        reply_set_problem(r, "body_too_large", NULL,
                          "the body has %.24s bytes, above the limit of %zu (setting body_limit_bytes): put "
                          "long arrays into files that the spec names",
                          f->length, limit);
        return true;
    }
    if (!x->route.found->body) return false;
    const char *type =
        MHD_lookup_connection_value(x->connection, MHD_HEADER_KIND, MHD_HTTP_HEADER_CONTENT_TYPE);
    bool patch = strcmp(x->route.found->method, "PATCH") == 0;
    if (fields_is_media_type(type, "application/json") ||
        (patch && fields_is_media_type(type, ROUTE_MERGE_PATCH)))
        return false;
    reply_set_problem(r, "media_type_unsupported", NULL,
                      "the body must be JSON: send the header Content-Type: application/json");
    return true;
}

static enum MHD_Result read_query(void *context, enum MHD_ValueKind kind, const char *key, const char *value)
{
    (void)kind;
    http_request *request = context;
    assert(request->query_count < HTTP_MAX_QUERY); /* checked by head_look */
    request->query[request->query_count].key = key;
    request->query[request->query_count++].value = value;
    return MHD_YES;
}

/* Fills the request for the handler, except for the body. False if *r was filled with a refusal. */
static bool read_request(exchange *x, const char *method, reply *r)
{
    http_request *request = &x->request;
    request->caller = &x->caller;
    request->came_ms = clock_monotonic_ms();
    request->announced = -1;
    memcpy(request->parameter, x->route.parameter, sizeof request->parameter);
    for (size_t i = 0; i < HTTP_HEADER_COUNT; i++) {
        x->joined[i] = header_list_join(x->connection, header_names[i]);
        request->header[i] =
            x->joined[i] ? x->joined[i]
                         : MHD_lookup_connection_value(x->connection, MHD_HEADER_KIND, header_names[i]);
    }
    if (strcmp(method, MHD_HTTP_METHOD_HEAD) == 0)
        request->header[HTTP_RANGE] = NULL; /* defined for GET only */
    MHD_get_connection_values(x->connection, MHD_GET_ARGUMENT_KIND, read_query, request);
    return parameter_check_query(x->s->settings.routes->parameters, x->route.found->query, request, r);
}

/* Makes the sink of a long body. False if *r was filled with a refusal. */
static bool make_sink(exchange *x, const fields *f, reply *r)
{
    http_request *request = &x->request;
    if (!x->route.found->opener) return true;
    if (f->length) request->announced = (int64_t)strtoull(f->length, NULL, 10);
    request->waits =
        MHD_lookup_connection_value(x->connection, MHD_HEADER_KIND, MHD_HTTP_HEADER_EXPECT) != NULL;
    request->sink = x->route.found->opener(x->s->settings.context, request, r);
    return request->sink != NULL;
}

/* Refuses requests with wrong headers. True if *r was filled. */
static bool refuse(exchange *x, const fields *f, const char *method, const char *path, reply *r)
{
    const route_match *match = &x->route;
    if (refuse_caller(x, f, r)) return true;
    if (!match->known) {
        reply_set_problem(r, "not_found", NULL,
                          "the path %.200s does not exist: see /v1/openapi.json for the paths", path);
        return true;
    }
    if (!match->found) {
        reply_set_problem(r, "method_not_allowed", NULL,
                          "the method %.32s is not allowed at %.200s: use one of the header Allow", method,
                          path);
        reply_add_header(r, MHD_HTTP_HEADER_ALLOW, match->allow);
        return true;
    }
    return refuse_body(x, f, r) || !read_request(x, method, r) || !make_sink(x, f, r);
}

/* Refuses a head that a proxy may interpret differently. True if *r was filled. */
static bool refuse_head(const exchange *x, const fields *f, const char *method, const char *version, reply *r)
{
    bool old = strcmp(version, MHD_HTTP_VERSION_1_0) == 0;
    if (head_refuse(x->connection, method, version, &x->target, r)) return true;
    if (f->hosts > 1 || (!f->hosts && !old)) {
        reply_set_problem(r, "request_invalid", NULL, "the header Host is missing or repeated: send it once");
        return true;
    }
    if (f->lengths + f->codings <= 1 && (!f->codings || (f->chunked && !old))) return false;
    reply_set_problem(r, "request_invalid", NULL,
                      "the length of the body is missing or repeated: send Content-Length once");
    return true;
}

static bool has_body(const fields *f)
{
    return f->codings || (f->length && strcmp(f->length, "0") != 0);
}

/* As refuse. *early: the answer is sent at once and the body is never read. Otherwise the answer follows the
 * body, since many clients send everything before they read. */
static bool refuse_early(exchange *x, const char *method, const char *path, const char *version, bool *early,
                         reply *r)
{
    fields f = fields_read(x->connection);
    route_find(x->s->settings.routes, method, path, &x->route);
    identify(x, &f);
    if (f.origins == 1 && pages_is_listed(x->s->settings.pages, f.origin)) x->page_origin = f.origin;
    bool waits = MHD_lookup_connection_value(x->connection, MHD_HEADER_KIND, MHD_HTTP_HEADER_EXPECT) != NULL;
    *early = waits || (f.length && strtoull(f.length, NULL, 10) > x->s->settings.body_limit_bytes);
    x->chunked = f.codings > 0;
    if (refuse_head(x, &f, method, version, r) || refuse_connection(x, r)) {
        *early = true;
    } else if (answer_preflight(x, method, r)) {
        return true;
    } else if (refuse_page(x, &f, r)) {
        *early = true;
    } else if (!refuse(x, &f, method, path, r)) {
        return false;
    } else if (!x->known && r->status == MHD_HTTP_UNAUTHORIZED && has_body(&f)) {
        *early = true; /* an unknown client cannot keep a connection by a body that does not arrive */
    }
    /* the unread body must not be read as the next request */
    if (*early) reply_add_header(r, MHD_HTTP_HEADER_CONNECTION, "close");
    return true;
}

static void note_answer(const exchange *x, const char *method, const char *path, const reply *r)
{
    x->s->settings.counters->answers[r->status / 100]++;
    char client[ADDRESS_TEXT_SIZE];
    log_write(LOG_LEVEL_DEBUG, "request method=%.32s path=%.200s status=%d user=%s client=%s", method, path,
              r->status, *x->caller.user ? x->caller.user : "-", address_print(&x->client, client));
}

/* A provisional answer becomes the final one. When the service stops, a request that has waited is answered
 * in the serving thread (call_handler). */
static void refuse_in_pool(thread_pool_work *work, thread_pool_refusal why)
{
    exchange *x = (exchange *)(void *)work;
    x->answered = x->awaits || !x->request.waited || why == THREAD_POOL_IS_BUSY;
    if (x->awaits)
        x->answer.provisional = false;
    else if (why == THREAD_POOL_IS_BUSY)
        reply_set_unavailable(&x->answer, "the service is busy, and the request has waited as long as it may"
                                          " (setting thread_wait_s)");
    else if (x->answered)
        reply_set_unavailable(&x->answer, "the service is stopping: try again later");
    loop_resume(x->s->loop, x->connection);
}

static void open_in_pool(thread_pool_work *work)
{
    exchange *x = (exchange *)(void *)work;
    x->request.sink->open(x->request.sink);
    loop_resume(x->s->loop, x->connection);
}

/* Opens the sink in the pool, because files are created for it. The body is read afterwards. */
static void open_sink(exchange *x)
{
    x->opening = true;
    MHD_suspend_connection(x->connection);
    x->work = (thread_pool_work){.run = open_in_pool, .refuse = refuse_in_pool, .user = x->caller.user};
    thread_pool_add(x->s->pool, &x->work);
}

static enum MHD_Result begin(exchange *x, const char *method, const char *path, const char *version)
{
    server *s = x->s;
    leave_unread(x);
    x->begun = true;
    x->head = strcmp(method, MHD_HTTP_METHOD_HEAD) == 0;
    pthread_mutex_lock(&s->mutex);
    s->busy++;
    pthread_mutex_unlock(&s->mutex);
    bool early = false;
    x->answered = refuse_early(x, method, path, version, &early, &x->answer);
    if (!x->answered || !early) {
        connections_await_body(s->connections, connection_of(x->connection));
        if (!x->answered && x->request.sink) open_sink(x);
        return MHD_YES;
    }
    connections_end_time(s->connections, connection_of(x->connection));
    note_answer(x, method, path, &x->answer);
    return queue_reply(x, &x->answer);
}

static void drop_body(exchange *x)
{
    ledger_give_back(x->s->settings.counts, LEDGER_BODIES, x->caller.user, (int64_t)x->capacity);
    free(x->body);
    x->body = NULL;
    x->request.length = x->capacity = 0;
}

/* Increases the capacity of the body to at least `bytes`. False: the limits do not permit it, and the
 * received part of the body was discarded. */
static bool reserve_body(exchange *x, size_t bytes)
{
    size_t limit = x->s->settings.body_limit_bytes + 1, capacity = 2 * bytes < limit ? 2 * bytes : limit;
    if (bytes <= x->capacity) return true;
    x->body_fits =
        ledger_take(x->s->settings.counts, LEDGER_BODIES, x->caller.user, (int64_t)(capacity - x->capacity));
    if (x->body_fits != LEDGER_FITS) {
        drop_body(x);
        return false;
    }
    x->body = mem_resize(x->body, capacity);
    x->capacity = capacity;
    return true;
}

/* Takes a piece of the body. A long body goes to its sink. A body over the limit is discarded. Its answer is
 * sent at its end, since the library sends answers only before or after a body. The time limit bounds this
 * wait. */
static enum MHD_Result take_body(exchange *x, const char *data, size_t *size)
{
    size_t *length = &x->request.length;
    if (x->answered) {
        *size = 0;
        return MHD_YES;
    }
    if (x->request.sink) {
        x->request.sink->take(x->request.sink, data, *size);
        x->step += *size;
        if (x->step >= UPLOAD_STEP_BYTES)
            connections_begin_time(x->s->connections, connection_of(x->connection));
        x->step %= UPLOAD_STEP_BYTES;
        *size = 0;
        return MHD_YES;
    }
    if (x->too_large || x->body_fits != LEDGER_FITS || *size > x->s->settings.body_limit_bytes - *length) {
        x->too_large = x->body_fits == LEDGER_FITS;
        drop_body(x);
    } else if (reserve_body(x, *length + *size + 1)) {
        memcpy(x->body + *length, data, *size);
        *length += *size;
    }
    *size = 0;
    return MHD_YES;
}

/* Passes the body to the request. False if it was too long; *r was filled. */
static bool read_body(exchange *x, reply *r)
{
    if (x->too_large) {
        reply_set_problem(
            r, "body_too_large", NULL,
            "the body exceeds the limit of %zu bytes (setting body_limit_bytes): put long arrays "
            "into files that the spec names",
            x->s->settings.body_limit_bytes);
        reply_add_header(r, MHD_HTTP_HEADER_CONNECTION, "close");
        return false;
    }
    if (x->body_fits != LEDGER_FITS) {
        reply_set_refusal(r,
                          ledger_explain(x->s->settings.counts, LEDGER_BODIES, x->body_fits, x->caller.user));
        return false;
    }
    if (x->body) x->body[x->request.length] = '\0';
    x->request.body = x->body ? x->body : "";
    return true;
}

/* Calls the handler. After a provisional answer calls the route's `awaiting`. */
static void run_handler(exchange *x)
{
    const server_settings *c = &x->s->settings;
    const route *of = x->route.found;
    x->request.last = wait_list_is_dismissed(c->waiting);
    (x->awaits ? of->awaiting : of->handler)(c->context, &x->request, &x->answer);
    assert(of->streams || !x->answer.source);
    x->awaits = x->answer.provisional;
    x->answered = x->answer.status && !x->awaits;
}

static void run_in_pool(thread_pool_work *work)
{
    exchange *x = (exchange *)(void *)work;
    wait_list *waiting = x->s->settings.waiting;
    for (;;) {
        uint64_t seen = wait_list_seen(waiting);
        run_handler(x);
        if (x->answered) break;
        bool before = x->request.waited;
        x->request.waited = true;
        /* from here on the connection may be resumed, and the request may end */
        if (wait_list_add(waiting, x->s->loop, x->connection, seen, x->answer.topic, x->answer.again_ms))
            return;
        x->request.waited = before;
    }
    loop_resume(x->s->loop, x->connection);
}

/* The weight of a request, in bytes of bodies. 0: the request is not heavy. */
static size_t weight_of(const exchange *x)
{
    if (x->route.found->runs_in == ROUTE_HEAVY_POOL)
        return x->s->settings.body_limit_bytes / HEAVY_AT_ONCE + 1;
    return x->request.length < HEAVY_BYTES ? 0 : x->request.length;
}

static void give_to_pool(exchange *x)
{
    MHD_suspend_connection(x->connection);
    x->work = (thread_pool_work){
        .run = run_in_pool, .refuse = refuse_in_pool, .user = x->caller.user, .weight = weight_of(x)};
    if (x->route.found->runs_in == ROUTE_PICTURE_POOL)
        thread_pool_add(x->s->picture_pool, &x->work);
    else
        thread_pool_add(x->work.weight ? x->s->heavy_pool : x->s->pool, &x->work);
}

/* Calls the handler. False: a pool will call it, and the connection is suspended. */
static bool call_handler(exchange *x)
{
    const server_settings *c = &x->s->settings;
    const route *of = x->route.found;
    if (of->kept && of->kept(c->context, &x->request, &x->answer)) return true;
    /* when the service stops, waiting requests are answered here, because the pools refuse work */
    if (of->runs_in != ROUTE_SERVING_THREAD && !(x->request.waited && wait_list_is_dismissed(c->waiting))) {
        give_to_pool(x);
        return false;
    }
    run_handler(x);
    assert(x->answered);
    return true;
}

static enum MHD_Result finish(exchange *x, const char *method, const char *path)
{
    connections_end_time(x->s->connections, connection_of(x->connection));
    if (!x->answered && read_body(x, &x->answer) && !call_handler(x)) return MHD_YES;
    if (changes_nothing(x, method)) count_answer(x, &x->answer);
    note_answer(x, method, path, &x->answer);
    return queue_reply(x, &x->answer);
}

static enum MHD_Result answer(void *context, struct MHD_Connection *connection, const char *path,
                              const char *method, const char *version, const char *data, size_t *size,
                              void **slot)
{
    (void)context;
    (void)connection;
    exchange *x = *slot;
    if (!x->begun) return begin(x, method, path, version);
    if (x->opening) { /* the library repeats the first call, in which the connection was suspended */
        x->opening = false;
        return MHD_YES;
    }
    if (*size) return take_body(x, data, size);
    return finish(x, method, path);
}

/* Decodes %XX in place. %00, which stays, matches nothing. */
static size_t unescape(void *context, struct MHD_Connection *connection, char *text)
{
    (void)context;
    (void)connection;
    char *to = text;
    for (const char *from = text; *from;) *to++ = hex_next_of_uri(&from);
    *to = '\0';
    return (size_t)(to - text);
}

static void end_exchange(exchange *x)
{
    if (x->request.sink) x->request.sink->drop(x->request.sink);
    if (x->receipt) x->receipt->end(x->receipt, x->sent);
    if (x->file) MHD_destroy_response(x->file);
    for (size_t i = 0; i < HTTP_HEADER_COUNT; i++) free(x->joined[i]);
    free(x);
}

static void end_exchange_in_pool(thread_pool_work *work)
{
    end_exchange((exchange *)(void *)work);
}

static void end_refused_exchange(thread_pool_work *work, thread_pool_refusal why)
{
    (void)why;
    end_exchange_in_pool(work);
}

/* Ends a request in the pool if files have to be closed or removed, which takes long if they are large. After
 * the dismissal the pool may not exist any more. */
static void finish_exchange(exchange *x)
{
    bool is_simple = !x->request.sink && !x->receipt && !x->file;
    x->work = (thread_pool_work){
        .run = end_exchange_in_pool, .refuse = end_refused_exchange, .user = x->caller.user};
    if (is_simple || wait_list_is_dismissed(x->s->settings.waiting))
        end_exchange(x);
    else
        thread_pool_add(x->s->pool, &x->work);
}

static void complete(void *context, struct MHD_Connection *connection, void **slot,
                     enum MHD_RequestTerminationCode why)
{
    server *s = context;
    exchange *x = *slot;
    connections_end_request(s->connections, connection_of(connection));
    if (!x) return;
    bool begun = x->begun;
    if (!begun) leave_unread(x);
    reply_clear(&x->answer);
    x->sent = why == MHD_REQUEST_TERMINATED_COMPLETED_OK && !x->head;
    drop_body(x);
    char text[LEDGER_HOLDER_SIZE];
    ledger_give_back(s->settings.counts, LEDGER_ANSWERS, reader_of(x, text), x->answer_bytes);
    finish_exchange(x);
    *slot = NULL;
    if (!begun) return;
    pthread_mutex_lock(&s->mutex);
    s->busy--;
    pthread_cond_broadcast(&s->changed);
    pthread_mutex_unlock(&s->mutex);
}

/* Writes an answer to the socket without the library, and closes the connection. */
static void answer_at_once(exchange *x, const reply *r)
{
    char *text = mem_printf(
        "HTTP/1.1 %d %s\r\nContent-Type: %s\r\nContent-Length: %zu\r\nConnection: close\r\n\r\n%s", r->status,
        MHD_get_reason_phrase_for((unsigned)r->status), r->content_type, r->length, r->body);
    int fd = MHD_get_connection_info(x->connection, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd;
    /* all earlier answers have been sent; the answers of the library find the connection closed */
    send(fd, text, strlen(text), MSG_DONTWAIT | MSG_NOSIGNAL);
    shutdown(fd, SHUT_WR);
    free(text);
    note_answer(x, "-", "-", r);
}

/* The library (0.9.75) answers twice when it refuses a head that has arrived, and calls no handler. It logs a
 * message before the first answer. Each message therefore triggers a check of the heads that no handler has
 * received. */
static void refuse_unread(server *s)
{
    exchange *x;
    LIST_FOREACH (x, &s->unread, link) {
        reply r = {.fd = -1};
        if (x->refused || !head_refuse_unread(x->connection, &r)) continue;
        x->refused = true;
        answer_at_once(x, &r);
        reply_clear(&r);
    }
}

/* Whether the message is about options of TCP. The library (0.9.75) sets them for each answer, on Unix
 * sockets, too, which refuse them. */
static bool is_about_tcp(const char *format)
{
    static const char option[] = "Setting %s option to ", push[] = "Failed to push the data";
    return strncmp(format, option, strlen(option)) == 0 || strncmp(format, push, strlen(push)) == 0;
}

static void write_library_log(void *context, const char *format, va_list arguments)
{
    if (is_about_tcp(format)) return;
    refuse_unread(context);
    log_write_list(LOG_LEVEL_DEBUG, format, arguments);
}

/* Starts the library; NULL on failure. */
static struct MHD_Daemon *start_daemon(server *s)
{
    const server_settings *settings = &s->settings;
    /* an additional limit in whole seconds; the limit of service/http/connections is exact */
    unsigned idle_s = (unsigned)settings->connections.timeout_s + 1;
    struct MHD_OptionItem options[] = {
        {MHD_OPTION_EXTERNAL_LOGGER, (intptr_t)write_library_log, s},
        {MHD_OPTION_CONNECTION_LIMIT, (intptr_t)connections_capacity(&settings->connections), NULL},
        {MHD_OPTION_CONNECTION_TIMEOUT, (intptr_t)idle_s, NULL},
        {MHD_OPTION_CONNECTION_MEMORY_LIMIT, (intptr_t)settings->header_limit_bytes, NULL},
#if MHD_VERSION >= 0x01000000 /* see service/http/head */
        {MHD_OPTION_CLIENT_DISCIPLINE_LVL, 1, NULL},
#endif
        {MHD_OPTION_NOTIFY_COMPLETED, (intptr_t)complete, s},
        {MHD_OPTION_URI_LOG_CALLBACK, (intptr_t)note_request, s},
        {MHD_OPTION_UNESCAPE_CALLBACK, (intptr_t)unescape, NULL},
        {MHD_OPTION_NOTIFY_CONNECTION, (intptr_t)note_connection, s},
        {MHD_OPTION_END, 0, NULL},
    };
    return MHD_start_daemon(MHD_USE_EPOLL | MHD_USE_NO_LISTEN_SOCKET | MHD_ALLOW_SUSPEND_RESUME |
                                MHD_USE_ERROR_LOG,
                            0, NULL, NULL, answer, s, MHD_OPTION_ARRAY, options, MHD_OPTION_END);
}

unsigned server_threads(unsigned estimates)
{
    return USER_THREADS + estimates + SPARE_THREADS + HEAVY_THREADS + estimates + PICTURE_THREADS;
}

/* Starts a pool, in which each user has at most `of_user` threads. */
static bool start_pool(const server *s, thread_pool_settings *pool, unsigned of_user, thread_pool **started,
                       error *e)
{
    pool->counts = s->settings.counts;
    pool->patience_ms = (int64_t)(s->settings.thread_wait_s * 1000);
    ledger_limit(pool->counts, pool->kind, (ledger_limits){.holder = of_user});
    return (*started = thread_pool_start(pool, e)) != NULL;
}

static bool start_pools(server *s, error *e)
{
    const server_settings *c = &s->settings;
    const unsigned of_user = USER_THREADS + c->estimates, heavy_of_user = HEAVY_USER_THREADS + c->estimates;
    thread_pool_settings usual = {.kind = LEDGER_THREADS, .threads = of_user + SPARE_THREADS};
    thread_pool_settings heavy = {.kind = LEDGER_HEAVY_THREADS,
                                  .threads = HEAVY_THREADS + c->estimates,
                                  .most_weight = c->body_limit_bytes + HEAVY_AT_ONCE,
                                  .nice = HEAVY_NICE};
    thread_pool_settings pictures = {
        .kind = LEDGER_PICTURE_THREADS, .threads = PICTURE_THREADS, .nice = HEAVY_NICE};
    thread_pool_settings streams = {
        .kind = LEDGER_STREAM_THREADS, .threads = STREAM_THREADS, .nice = HEAVY_NICE};
    return start_pool(s, &usual, of_user, &s->pool, e) &&
           start_pool(s, &heavy, heavy_of_user, &s->heavy_pool, e) &&
           start_pool(s, &pictures, PICTURE_USER_THREADS, &s->picture_pool, e) &&
           start_pool(s, &streams, STREAM_USER_THREADS, &s->stream_pool, e);
}

/* Serves copies of the descriptors, since the loop closes its own. */
static bool serve_sockets(server *s, const listen_socket *sockets, size_t count, error *e)
{
    const unsigned capacity = connections_capacity(&s->settings.connections);
    int *fd = mem_alloc(count * sizeof *fd);
    size_t copied = 0;
    struct MHD_Daemon *daemon = NULL;
    while (copied < count && (fd[copied] = fcntl(sockets[copied].fd, F_DUPFD_CLOEXEC, 0)) >= 0 &&
           fcntl(fd[copied], F_SETFL, fcntl(fd[copied], F_GETFL) | O_NONBLOCK) == 0)
        copied++;
    bool ok = copied == count && (daemon = start_daemon(s)) != NULL;
    if (!ok)
        error_set(e, ERROR_INTERNAL, "the HTTP server cannot start on %s: %s",
                  sockets[copied < count ? copied : 0].address, strerror(errno));
    ok = ok && loop_start(daemon, fd, count, capacity, &s->loop, e);
    if (!ok && daemon) MHD_stop_daemon(daemon);
    for (size_t k = 0; !ok && k < copied; k++) close(fd[k]);
    free(fd);
    return ok;
}

server *server_start(const server_settings *settings, const listen_socket *sockets, size_t count,
                     access_control *access, error *e)
{
    for (size_t i = 0; i < settings->routes->count; i++)
        assert(settings->routes->row[i].runs_in != ROUTE_UNDECLARED);
    server *s = mem_alloc(sizeof *s);
    s->settings = *settings;
    s->access = access;
    background_init_condition(&s->changed);
    pthread_mutex_init(&s->mutex, NULL);
    s->connections = connections_start(&settings->connections, settings->counts, access, e);
    if (s->connections && start_pools(s, e) && serve_sockets(s, sockets, count, e)) return s;
    server_stop(s);
    return NULL;
}

uint64_t server_turns(const server *s)
{
    return loop_turns(s->loop);
}

void server_wake(server *s)
{
    loop_wake(s->loop);
}

/* Waits a limited time until all requests are answered. */
static void wait_for_replies(server *s)
{
    int64_t until_ms = clock_monotonic_ms() + STOP_MS;
    pthread_mutex_lock(&s->mutex);
    while (s->busy && background_wait_until(&s->changed, &s->mutex, until_ms)) {
    }
    pthread_mutex_unlock(&s->mutex);
}

void server_stop(server *s)
{
    if (!s) return;
    if (s->loop) loop_quiesce(s->loop);
    wait_list_dismiss(s->settings.waiting);
    thread_pool_refuse(s->pool); /* waiting requests may take long */
    thread_pool_refuse(s->heavy_pool);
    thread_pool_refuse(s->picture_pool);
    thread_pool_refuse(s->stream_pool);
    wait_for_replies(s);
    loop_end(s->loop);         /* otherwise clients would add work to the pool */
    thread_pool_stop(s->pool); /* resumes the connections of its work */
    thread_pool_stop(s->heavy_pool);
    thread_pool_stop(s->picture_pool);
    thread_pool_stop(s->stream_pool);
    loop_stop(s->loop);
    connections_stop(s->connections);
    pthread_cond_destroy(&s->changed);
    pthread_mutex_destroy(&s->mutex);
    free(s);
}

// SPDX-License-Identifier: Apache-2.0
/* handler: the function that answers the requests of a route. It receives a request and fills a reply; it has
 * no access to the socket.
 */
#ifndef HEXAD_SERVICE_HTTP_HANDLER_H
#define HEXAD_SERVICE_HTTP_HANDLER_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "service/auth/access.h"
#include "service/http/reply.h"

/* Counters of the server, for /metrics. */
typedef struct http_counters {
    atomic_uint_fast64_t answers[6];  /* by the first digit of the status */
    atomic_uint_fast64_t refused;     /* connections over a limit */
    atomic_uint_fast64_t connections; /* open connections */
} http_counters;

/* Data for the handlers. The server passes it on; the routes define it (service/api/context.h). */
typedef struct http_context http_context;

#define HTTP_MAX_PARAMETERS 2
#define HTTP_MAX_QUERY 8

/* The headers that handlers read. */
typedef enum http_header {
    HTTP_ACCEPT,
    HTTP_IDEMPOTENCY_KEY,
    HTTP_IF_MATCH,
    HTTP_IF_NONE_MATCH,
    HTTP_IF_RANGE,
    HTTP_LAST_EVENT_ID,
    HTTP_ORIGIN,
    HTTP_PREFER,
    HTTP_RANGE,
    HTTP_TRACEPARENT,
    HTTP_HEADER_COUNT
} http_header;

/* Receives a long body. */
typedef struct http_sink {
    /* Called before the first piece, by a thread of the pool. */
    void (*open)(struct http_sink *sink);
    /* Receives a piece of at most header_limit_bytes, in the serving thread. */
    void (*take)(struct http_sink *sink, const char *bytes, size_t count);
    /* Called at the end of every request, also of a failed one, by a thread of the pool. */
    void (*drop)(struct http_sink *sink);
} http_sink;

typedef struct http_request {
    const access_caller *caller;
    const char *parameter[HTTP_MAX_PARAMETERS]; /* the {..} parts of the route, in order */
    const char *header[HTTP_HEADER_COUNT];      /* NULL: not sent; see header_list_join for repeated ones */
    size_t query_count;
    struct {
        const char *key, *value; /* value may be NULL */
    } query[HTTP_MAX_QUERY];
    const char *body; /* NUL-terminated */
    size_t length;
    http_sink *sink;   /* instead of a body, for a route with an opener */
    int64_t came_ms;   /* arrival, monotonic clock */
    bool last;         /* the answer must not wait, because the service is stopping */
    bool waited;       /* the handler was called before and its answer has waited since */
    int64_t announced; /* for openers: the length of the body; -1: unknown */
    bool waits;        /* for openers: the client sends the body only after a 100 answer (Expect) */
} http_request;

/* Makes a sink for the body after the headers have arrived, in the serving thread. On refusal returns NULL
 * and fills the reply. */
typedef http_sink *http_opener(const http_context *c, const http_request *request, reply *r);

/* Fills an empty reply whose fd is -1. Any thread. */
typedef void http_handler(const http_context *c, const http_request *request, reply *r);

/* Like a handler, in the serving thread. False, with the reply unchanged: the handler must be called. */
typedef bool http_keeper(const http_context *c, const http_request *request, reply *r);

#endif

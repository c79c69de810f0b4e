/* handler: what answers a route: a function from a request to a reply, without a socket. */
#ifndef HEXAD_HTTP_HANDLER_H
#define HEXAD_HTTP_HANDLER_H

#include <stdatomic.h>
#include <stddef.h>

#include "auth/access.h"
#include "executor/estimator.h"
#include "executor/executor.h"
#include "http/lounge.h"
#include "http/reply.h"
#include "http/shelf.h"
#include "queue/queue.h"
#include "store/inputs.h"
#include "store/output.h"
#include "store/path_map.h"
#include "store/root.h"
#include "webhook/hosts.h"

/* What the server counts, for /metrics. */
typedef struct http_counters {
    atomic_uint_fast64_t answers[6];  /* by the first digit of their status */
    atomic_uint_fast64_t refused;     /* connections over a limit */
    atomic_uint_fast64_t connections; /* open ones */
    atomic_bool copying;              /* a backup is being made */
} http_counters;

/* What handlers work on; borrowed, and outlives the server. */
typedef struct http_context {
    queue *q;
    executor *x;
    estimator *estimator;     /* NULL: nothing is estimated */
    const store_roots *roots; /* of inputs too */
    store_inputs *inputs;
    const store_outputs *outputs;
    const path_map *mappings;      /* of paths; NULL: none */
    const webhook_hosts *webhooks; /* NULL: none */
    const char *state_dir;
    int max_attempts;        /* of a job that names no number */
    int64_t most_waiting;    /* jobs of one user; 0: any number */
    int64_t retention_s;     /* of a job that names no time */
    double wait_s;           /* longest that an answer may be asked to wait */
    int64_t started_ms;      /* wall clock */
    http_counters *counters; /* the server's */
    lounge *lounge;
    shelf *shelf; /* NULL: no document is kept */
} http_context;

#define HTTP_MAX_PARAMETERS 2
#define HTTP_MAX_QUERY 8

/* The headers that handlers look at. */
typedef enum http_header {
    HTTP_ACCEPT,
    HTTP_IDEMPOTENCY_KEY,
    HTTP_IF_MATCH,
    HTTP_IF_NONE_MATCH,
    HTTP_IF_RANGE,
    HTTP_LAST_EVENT_ID,
    HTTP_PREFER,
    HTTP_RANGE,
    HTTP_TRACEPARENT,
    HTTP_HEADER_COUNT
} http_header;

/* What takes a long body piece by piece, in the serving thread. */
typedef struct http_sink {
    void (*take)(struct http_sink *sink, const char *bytes, size_t count);
    void (*drop)(struct http_sink *sink); /* at the end of the request, whatever came of it */
} http_sink;

typedef struct http_request {
    const access_caller *caller;
    const char *parameter[HTTP_MAX_PARAMETERS]; /* the {..} of the route, in order */
    const char *header[HTTP_HEADER_COUNT];      /* NULL: not sent */
    size_t query_count;
    struct {
        const char *key, *value; /* value may be NULL */
    } query[HTTP_MAX_QUERY];
    const char *body; /* NUL-terminated */
    size_t length;
    http_sink *sink;   /* of a route that has an opener, instead of a body */
    int64_t came_ms;   /* monotonic */
    bool last;         /* an answer may not wait any more: the service ends */
    int64_t announced; /* for openers: bytes of the body that will come, -1: not known */
    bool waits;        /* for openers: the client sends its body only when it is told to (Expect) */
} http_request;

/* Opens a sink for the body of a request of which the headers are known; or NULL and a filled reply. */
typedef http_sink *http_opener(const http_context *c, const http_request *request, reply *r);

/* Fills an empty reply whose fd is -1. Any thread. */
typedef void http_handler(const http_context *c, const http_request *request, reply *r);

#endif

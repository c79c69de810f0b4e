/* jobs: the handlers of the REST interface, from a request to a reply, without a socket. */
#ifndef HEXAD_HTTP_JOBS_H
#define HEXAD_HTTP_JOBS_H

#include <stddef.h>

#include "executor/executor.h"
#include "http/reply.h"
#include "queue/queue.h"
#include "store/output.h"
#include "store/root.h"

/* What handlers work on; borrowed, and outlives the server. */
typedef struct jobs_context {
    queue *q;
    executor *x;
    const store_roots *roots;
    const store_outputs *outputs;
    const char *state_dir;
    int max_attempts;     /* of a job that names no number */
    int64_t most_waiting; /* jobs of one user; 0: any number */
    int64_t retention_s;  /* of a job that names no time */
} jobs_context;

#define JOBS_MAX_PARAMETERS 2
#define JOBS_MAX_QUERY 8

typedef struct jobs_request {
    const char *parameter[JOBS_MAX_PARAMETERS]; /* the {..} of the route, in order */
    size_t query_count;
    struct {
        const char *key, *value; /* value may be NULL */
    } query[JOBS_MAX_QUERY];
    const char *body; /* NUL-terminated */
    size_t length;
} jobs_request;

/* Each fills an empty reply whose fd is -1. Any thread. */
typedef void jobs_handler(const jobs_context *c, const jobs_request *request, reply *r);

jobs_handler jobs_submit, jobs_list, jobs_show, jobs_cancel, jobs_list_results, jobs_send_result;
jobs_handler jobs_health, jobs_version;

#endif

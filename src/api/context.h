/* context: what the handlers of all routes work on. The members are borrowed and outlive the server. */
#ifndef HEXAD_API_CONTEXT_H
#define HEXAD_API_CONTEXT_H

#include <stdatomic.h>
#include <stdint.h>

#include "api/document_cache.h"
#include "api/submission_rate.h"
#include "executor/estimator.h"
#include "executor/executor.h"
#include "http/handler.h"
#include "http/wait_list.h"
#include "queue/queue.h"
#include "results/output_place.h"
#include "store/inputs.h"
#include "store/path_map.h"
#include "store/root.h"
#include "webhook/delivery.h"
#include "webhook/hosts.h"

struct http_context {
    access_control *access;
    queue *q;
    executor *x;
    estimator *estimator;     /* NULL: no estimates */
    const store_roots *roots; /* where jobs may read, uploads included */
    store_inputs *inputs;
    bool share_inputs; /* users may name what others have sent */
    output_place *outputs;
    const path_map *mappings;       /* of paths; NULL: none */
    const webhook_hosts *webhooks;  /* NULL: none */
    const char *const *slurm_allow; /* options of sbatch that jobs may ask for */
    size_t slurm_allow_count;
    wait_list *waiting; /* dismissed when the service stops */
    const char *work_dir;
    const char *worker;             /* path of hexad-worker */
    int max_attempts;               /* of a job that names none */
    int64_t most_waiting;           /* unfinished jobs of one user; 0: any number */
    const user_numbers *priorities; /* the highest that a user may give; NULL: any */
    submission_rate *rate;          /* of each user; NULL: any */
    int64_t retention_s;            /* of a job that names none */
    double wait_s;                  /* the longest wait that a client may ask for */
    double thumbnail_timeout_s;     /* of a process that makes one */
    int64_t started_ms;             /* wall clock */
    const http_counters *counters;  /* of the server */
    const delivery_counters *calls; /* of webhooks */
    atomic_bool *copying;           /* true while a backup is made */
    document_cache *documents;      /* NULL: no document is cached */
    const struct page *page;        /* api/page.h; NULL: there is none */
    double session_s;               /* how long a session lasts */
};

#endif

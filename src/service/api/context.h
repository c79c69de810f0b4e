// SPDX-License-Identifier: Apache-2.0
/* context: the objects and settings that the handlers of all routes use. Pointers are borrowed and outlive
 * the server. All members are constant while the server runs. */
#ifndef HEXAD_SERVICE_API_CONTEXT_H
#define HEXAD_SERVICE_API_CONTEXT_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdint.h>

#include "service/api/document_cache.h"
#include "service/executor/estimator.h"
#include "service/executor/executor.h"
#include "service/http/handler.h"
#include "service/http/wait_list.h"
#include "service/ledger/ledger.h"
#include "service/queue/queue.h"
#include "service/results/output_place.h"
#include "service/uploads/upload_store.h"
#include "files/path_map.h"
#include "files/root.h"
#include "service/webhook/delivery.h"
#include "service/webhook/hosts.h"

struct http_context {
    access_control *access;
    ledger *counts; /* what users hold, and their limits */
    queue *q;
    executor *x;
    estimator *estimator;     /* NULL: no estimates */
    const store_roots *roots; /* directories that jobs may read, with the directory of uploads */
    store_inputs *inputs;     /* uploaded files */
    bool share_inputs;        /* jobs may read files that other users have uploaded */
    output_place *outputs;
    const path_map *mappings;       /* setting path_mappings; NULL: none */
    const webhook_hosts *webhooks;  /* NULL: jobs may not name webhooks */
    const char *const *slurm_allow; /* options of sbatch that specs may contain */
    size_t slurm_allow_count;
    wait_list *waiting;             /* dismissed when the service stops */
    const char *work_dir;           /* the directory of results/ and attempts/ */
    const char *worker;             /* path of hexad-worker */
    size_t max_files;               /* of a data set */
    int max_attempts;               /* default for specs without limits.max_attempts */
    const user_numbers *priorities; /* highest allowed priority of each user; NULL: no limit */
    int64_t retention_s;            /* default for specs without retention, in seconds */
    double wait_s;                  /* longest wait that `Prefer: wait` can request, in seconds */
    double thumbnail_timeout_s;     /* time limit of a process that makes a thumbnail, in seconds */
    int64_t started_ms;             /* start of the service, wall clock */
    const http_counters *counters;  /* the server changes them */
    const delivery_counters *calls; /* calls of webhooks; the delivery thread changes them */
    pthread_mutex_t *frame_checks;  /* held while the values of frames are checked: one check at a time */
    atomic_bool *copying;           /* true while a backup is made; the handler of backups changes it */
    document_cache *documents;      /* NULL: documents are not cached */
    const struct page *page;        /* service/api/web_page.h; NULL: no page is served */
    const struct openapi *openapi;  /* service/api/openapi.h */
    double session_s;               /* length of a session, in seconds */
};

#endif

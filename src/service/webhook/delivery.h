// SPDX-License-Identifier: Apache-2.0
/* delivery: tasks that call webhooks when jobs have ended.
 *
 * They post the notifications in the queue's outbox: concurrently to several hosts, sequentially to one host.
 * A notification is repeated until the receiver answers with a status of 2xx or the maximum number of tries
 * is reached; only then it is removed from the outbox. A crash of this program therefore loses no
 * notification, but a receiver may get a notification twice. The headers are those of standardwebhooks.com,
 * version 1.0.0. webhook-id is a globally unique id of the end of a job, equal in all tries.
 * webhook-timestamp is the time of the try in seconds. webhook-signature is `v1,` and the base64 of the
 * HMAC-SHA256 of `ID.TIMESTAMP.BODY` with the key. The body has the schema JobEnded of the OpenAPI document.
 * The tasks follow no redirects, use no proxy and discard the bodies of answers.
 */
#ifndef HEXAD_SERVICE_WEBHOOK_DELIVERY_H
#define HEXAD_SERVICE_WEBHOOK_DELIVERY_H

#include <stdatomic.h>

#include "base/core/error.h"
#include "service/queue/queue.h"
#include "service/webhook/hosts.h"

typedef struct delivery delivery;

/* Numbers of calls since the start, for /metrics. */
typedef struct delivery_counters {
    atomic_uint_fast64_t delivered;
    atomic_uint_fast64_t failed; /* failed, and a further try follows */
    /* the last of webhook_tries has failed, or the receiver answered with 410 */
    atomic_uint_fast64_t given_up;
} delivery_counters;

typedef struct delivery_settings {
    const webhook_hosts *hosts; /* checked again before each try; must outlive the delivery */
    const char *host;           /* the name of this machine, for the receivers */
    /* File of the key. If its first line is `whsec_` and the base64 of 24 to 64 bytes, the key is these
     * bytes. Any other line is itself the key. */
    const char *secret_file;
    int calls;            /* maximum number of simultaneous calls */
    int tries;            /* maximum number of tries of a notification */
    double timeout_s;     /* time limit of a try */
    double retry_s;       /* wait before the second try; doubled before each further try */
    double retry_most_s;  /* maximum of this wait */
    double retry_after_s; /* maximum wait that a receiver can request (Retry-After) */
    delivery_counters *counters;
} delivery_settings;

/* Whether the file contains a valid secret. Errors as delivery_add. */
bool delivery_check_secret(const char *file, error *e);

/* Adds the tasks to the runner. The queue must outlive the delivery. Error spec_invalid: the secret is
 * missing, has no valid form, or other users can read it. */
delivery *delivery_add(runner *to, const delivery_settings *settings, queue *q, error *e);
/* After runner_stop, which aborts tries in progress; they do not count. Accepts NULL. */
void delivery_free(delivery *c);

#endif

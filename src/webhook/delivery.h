/* delivery: the threads that call webhooks when jobs have ended.
 *
 * They post the notifications in the queue's outbox: to several hosts at a time, to one host one after
 * another. A notification is tried until the receiver answers with a status of 2xx or the tries are used up,
 * and leaves the outbox only then. So a receiver may get one twice, but none is lost when this program dies.
 * The headers are those of standardwebhooks.com, version 1.0.0: webhook-id is one id for each end of a job, the
 * same in each try, and of no other service; webhook-timestamp is the second of the try; webhook-signature is
 * `v1,` and the base64 of the HMAC-SHA256, under the key, of `ID.TIMESTAMP.BODY`. The body is the schema JobEnded
 * of the OpenAPI document. The threads follow no redirect, use no proxy and discard the body of an answer.
 */
#ifndef HEXAD_WEBHOOK_DELIVERY_H
#define HEXAD_WEBHOOK_DELIVERY_H

#include <stdatomic.h>

#include "base/error.h"
#include "queue/queue.h"
#include "webhook/hosts.h"

typedef struct delivery delivery;

/* Calls since the start, for /metrics. */
typedef struct delivery_counters {
    atomic_uint_fast64_t delivered;
    atomic_uint_fast64_t failed; /* and repeated */
    atomic_uint_fast64_t
        given_up; /* the last one that webhook_tries allows has failed, or the receiver is gone (410) */
} delivery_counters;

typedef struct delivery_settings {
    const webhook_hosts *hosts; /* checked again before each try; outlive the delivery */
    const char *host;           /* the name of this machine, for the receivers */
    /* Its first line is `whsec_` and the base64 of a key of 24 to 64 bytes; another text is itself the key. */
    const char *secret_file;
    int calls;            /* at a time, at most */
    int tries;            /* of a delivery, at most */
    double timeout_s;     /* of a try */
    double retry_s;       /* before the second try, doubled before each further one, */
    double retry_most_s;  /* and at most this */
    double retry_after_s; /* the longest wait that a receiver may ask for (Retry-After) */
    delivery_counters *counters;
} delivery_settings;

/* The queue outlives the delivery. Error spec_invalid: the secret is missing, of no valid form, or
 * readable by others. */
delivery *delivery_start(const delivery_settings *settings, queue *q, error *e);
/* Aborts a try that is under way, which then does not count. Accepts NULL. */
void delivery_stop(delivery *c);

#endif

/* courier: the threads that tell others that jobs have ended.
 *
 * They post what the queue's outbox holds, to several hosts at a time and to one host one after another, each
 * delivery until the receiver answers with a status of 2xx or the tries are spent. A delivery leaves the outbox
 * afterwards, so a receiver may be told twice, and is never told nothing because this program died. The headers
 * are those of standardwebhooks.com:
 * webhook-id is one number per end of a job and stays the same when it is told again; webhook-timestamp is
 * the second of the try; webhook-signature is `v1,` and the base64 of the HMAC-SHA256, under the secret, of
 * `ID.TIMESTAMP.BODY`. The body is `{"type": "job.ended", "data": {"job", "state", "outcome"}}`. No redirect
 * is followed, no proxy is asked, the body of an answer is not kept.
 */
#ifndef HEXAD_WEBHOOK_COURIER_H
#define HEXAD_WEBHOOK_COURIER_H

#include "base/error.h"
#include "queue/queue.h"
#include "webhook/hosts.h"

typedef struct courier courier;

typedef struct courier_settings {
    const webhook_hosts *hosts; /* looked at again before each try; outlives the courier */
    const char *secret_file;    /* its bytes without a line break at the end are the secret */
    int calls;                  /* at a time, at most */
    int tries;                  /* of a delivery, at most */
    double timeout_s;           /* of a try */
    double retry_s;             /* before the second try, doubled before each further one, */
    double retry_most_s;        /* and at most this */
} courier_settings;

/* Errors: spec_invalid, the secret is missing, short, or can be read by others. The queue outlives the
 * courier. */
courier *courier_start(const courier_settings *settings, queue *q, error *e);
/* Breaks off a try that is under way; it counts as none. Accepts NULL. */
void courier_stop(courier *c);

#endif

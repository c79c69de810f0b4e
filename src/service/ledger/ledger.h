// SPDX-License-Identifier: Apache-2.0
/* ledger: what each user holds of the daemon's resources, and how much it may hold.
 *
 * One table (ledger.c) has a row for each resource: what is counted, the settings that limit it, the problem
 * of a refusal, and what a caller can do. All refusals have the same form.
 *
 * A holder is a name: that of a user, or "client ADDRESS" for a client whose user is unknown; for uploads the
 * hash of the user's name, since the store has only that. The ledger counts in memory, so a restart begins
 * with 0, except for uploads, whose store counts its files again. The queue counts jobs, attempts and results
 * in the database; the ledger has the rows of these resources, and the first two limits.
 *
 * Any thread may call all functions. None of them blocks, or calls another module while it holds the ledger's
 * mutex.
 */
#ifndef HEXAD_SERVICE_LEDGER_LEDGER_H
#define HEXAD_SERVICE_LEDGER_LEDGER_H

#include <stdint.h>

typedef enum ledger_resource {
    LEDGER_CONNECTIONS,        /* of users */
    LEDGER_CLIENT_CONNECTIONS, /* of clients whose user is unknown */
    LEDGER_BODIES,             /* bytes */
    LEDGER_ANSWERS,            /* bytes */
    LEDGER_THREADS,            /* of each pool of service/http/server */
    LEDGER_HEAVY_THREADS,
    LEDGER_PICTURE_THREADS,
    LEDGER_STREAM_THREADS,
    LEDGER_DELIVERIES, /* jobs whose results are copied again at the same time */
    LEDGER_UPLOADS,    /* at the same time */
    LEDGER_UPLOAD_BYTES,
    LEDGER_SUBMISSIONS, /* jobs an hour: what is taken is given back at the rate of the limit */
    LEDGER_JOBS,        /* unfinished; counted by the queue */
    LEDGER_TASKS,       /* unfinished; counted by the queue */
    LEDGER_ATTEMPTS,    /* running; counted by the queue */
    LEDGER_RESULTS,     /* limited and counted by the queue */
    LEDGER_RESOURCES
} ledger_resource;

typedef struct ledger_limits {
    int64_t holder; /* of each holder; 0: no limit */
    int64_t all;    /* of all holders together; 0: no limit */
} ledger_limits;

typedef enum ledger_decision { LEDGER_FITS, LEDGER_HOLDER_FULL, LEDGER_ALL_FULL } ledger_decision;

/* Length of the names of holders, with the final 0. */
#define LEDGER_HOLDER_SIZE 80

typedef struct ledger ledger;

ledger *ledger_new(void);    /* without limits */
void ledger_free(ledger *l); /* accepts NULL */

void ledger_limit(ledger *l, ledger_resource what, ledger_limits limits);
ledger_limits ledger_get_limits(ledger *l, ledger_resource what);

/* Whether the holder may take `amount` more. Some resources leave each holder an amount that it may take
 * although the limit of all holders is reached. */
ledger_decision ledger_check(ledger *l, ledger_resource what, const char *holder, int64_t amount);
/* As ledger_check, and takes the amount if it fits. */
ledger_decision ledger_take(ledger *l, ledger_resource what, const char *holder, int64_t amount);
/* Takes the amount whether it fits or not; a negative one is given back. Not for a rate. */
void ledger_add(ledger *l, ledger_resource what, const char *holder, int64_t amount);
void ledger_give_back(ledger *l, ledger_resource what, const char *holder, int64_t amount);
int64_t ledger_held(ledger *l, ledger_resource what, const char *holder);

/* Why a holder may not take more: the code of a problem, the message for the caller, and the time in seconds
 * after which a repetition may succeed (0: only after a change by the caller). */
typedef struct ledger_refusal {
    const char *code; /* a constant */
    int64_t retry_s;
    char message[512];
} ledger_refusal;

/* `why` is not LEDGER_FITS, and the row of the resource has a refusal for it. */
ledger_refusal ledger_explain(ledger *l, ledger_resource what, ledger_decision why, const char *holder);

#endif

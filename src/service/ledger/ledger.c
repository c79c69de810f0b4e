// SPDX-License-Identifier: Apache-2.0
#include "service/ledger/ledger.h"

#include <assert.h>
#include <inttypes.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/queue.h>

#include "base/core/clock.h"
#include "base/core/hash.h"
#include "base/core/memory.h"

/* The refusal for one limit; code NULL: work beyond the limit waits. */
typedef struct rule {
    const char *setting; /* NULL: a constant of the program */
    const char *code;
    int64_t retry_s; /* for Retry-After; of a rate it is computed, and messages state it instead of the
                      * remedy */
    const char *remedy;
} rule;

typedef struct row {
    const char *what; /* name of the limited resource in messages, in the plural */
    rule holder, all;
    int64_t each; /* amount that each holder may have even if the limit of all holders is reached */
    bool an_hour; /* the limit is a rate */
} row;

static const row rows[LEDGER_RESOURCES] = {
    [LEDGER_CONNECTIONS] = {.what = "connections",
                            .holder = {"user_connection_limit", "too_many_requests", 1, "close some"},
                            .all = {"connection_limit", "unavailable", 1, "try again later"}},
    [LEDGER_CLIENT_CONNECTIONS] = {.what = "connections without a token",
                                   .holder = {"client_connection_limit", "too_many_requests", 1,
                                              "close some, or send a token"}},
    /* each: a short body */
    [LEDGER_BODIES] = {.what = "bytes of bodies in memory",
                       .holder = {"user_body_bytes", "too_many_requests", 1, "try again later"},
                       .all = {"body_total_bytes", "unavailable", 5, "try again later"},
                       .each = 16384},
    /* each: most answers */
    [LEDGER_ANSWERS] = {.what = "bytes of answers that are being sent",
                        .holder = {"user_answer_bytes", "too_many_requests", 1,
                                   "read them, or send fewer requests at once"},
                        .all = {"answer_total_bytes", "unavailable", 5, "try again later"},
                        .each = 1 << 20},
    [LEDGER_THREADS] = {.what = "threads for requests"},
    [LEDGER_HEAVY_THREADS] = {.what = "threads for long requests"},
    [LEDGER_PICTURE_THREADS] = {.what = "threads for pictures"},
    [LEDGER_STREAM_THREADS] = {.what = "threads for streams"},
    [LEDGER_DELIVERIES] = {.what = "jobs whose results are delivered again"},
    [LEDGER_UPLOADS] = {.what = "simultaneous uploads",
                        .holder = {"user_uploads", "too_many_requests", 1, "wait for one to end"}},
    [LEDGER_UPLOAD_BYTES] =
        {.what = "bytes of uploads",
         .holder = {"user_upload_bytes", "storage_full", 0,
                    "delete uploads that are not needed; unused ones expire after inputs_keep_s"}},
    [LEDGER_SUBMISSIONS] = {.what = "submissions in an hour",
                            .holder = {"user_submissions", "too_many_submissions"},
                            .an_hour = true},
    [LEDGER_JOBS] = {.what = "unfinished jobs",
                     .holder = {"user_queued", "too_many_jobs", 5, "wait for some to end, or cancel some"}},
    [LEDGER_TASKS] = {.what = "unfinished tasks",
                      .holder = {"user_tasks", "too_many_tasks", 5,
                                 "submit fewer frames, wait for some to end, or cancel some jobs"}},
    [LEDGER_ATTEMPTS] = {.what = "running attempts", .holder = {.setting = "user_running"}},
    [LEDGER_RESULTS] = {.what = "results, none of which was fetched",
                        .holder = {"user_results_mb or user_results_count", "results_full", 30,
                                   "fetch results with hexadctl fetch, so that hexad may delete them"},
                        .all = {"results_mb or results_count", "results_full", 30,
                                "fetch results with hexadctl fetch, so that hexad may delete them"}},
};

/* A unit of a rate is counted as this many parts, which are given back at `limits.holder` parts a
 * millisecond: it is the number of milliseconds in an hour. */
#define PARTS_OF_RATE 3600000

/* What a holder has. It is freed when that is nothing. */
typedef struct account {
    LIST_ENTRY(account) link;
    char holder[LEDGER_HOLDER_SIZE];
    int64_t held[LEDGER_RESOURCES];  /* of a rate: in parts, at the time `at_ms` */
    int64_t at_ms[LEDGER_RESOURCES]; /* monotonic */
} account;

/* Size of the hash table of accounts: the default of connection_limit. */
enum { CHAINS = 2048 };
/* Minimum number of accounts at which those that hold nothing are searched for and freed. */
enum { SWEEP_LEAST = 64 };

struct ledger {
    pthread_mutex_t mutex;
    ledger_limits limits[LEDGER_RESOURCES];
    int64_t all[LEDGER_RESOURCES]; /* amounts that all holders have together; unused for rates */
    size_t count, sweep_at;        /* numbers of accounts */
    LIST_HEAD(, account) chain[CHAINS];
};

ledger *ledger_new(void)
{
    ledger *l = mem_alloc(sizeof *l);
    pthread_mutex_init(&l->mutex, NULL);
    l->sweep_at = SWEEP_LEAST;
    return l;
}

static void free_account(ledger *l, account *a)
{
    LIST_REMOVE(a, link);
    l->count--;
    free(a);
}

void ledger_free(ledger *l)
{
    if (!l) return;
    for (size_t i = 0; i < CHAINS; i++)
        while (!LIST_EMPTY(&l->chain[i])) free_account(l, LIST_FIRST(&l->chain[i]));
    pthread_mutex_destroy(&l->mutex);
    free(l);
}

void ledger_limit(ledger *l, ledger_resource what, ledger_limits limits)
{
    pthread_mutex_lock(&l->mutex);
    l->limits[what] = limits;
    pthread_mutex_unlock(&l->mutex);
}

ledger_limits ledger_get_limits(ledger *l, ledger_resource what)
{
    pthread_mutex_lock(&l->mutex);
    ledger_limits limits = l->limits[what];
    pthread_mutex_unlock(&l->mutex);
    return limits;
}

/* ---- accounts; the caller holds the mutex */

static size_t chain_of(const char *holder)
{
    return hash_add_text(HASH_NONE, holder) % CHAINS;
}

static account *find(const ledger *l, const char *holder)
{
    account *a;
    LIST_FOREACH (a, &l->chain[chain_of(holder)], link)
        if (strcmp(a->holder, holder) == 0) return a;
    return NULL;
}

/* What an account holds now, in parts for a rate. */
static int64_t held_now(const ledger *l, const account *a, ledger_resource what, int64_t now_ms)
{
    if (!a || !rows[what].an_hour || !a->held[what]) return a ? a->held[what] : 0;
    const int64_t passed_ms = now_ms - a->at_ms[what]; /* after an hour, all has been given back */
    if (passed_ms >= PARTS_OF_RATE) return 0;
    const int64_t left = a->held[what] - passed_ms * l->limits[what].holder;
    return left > 0 ? left : 0;
}

static void free_empty(ledger *l, account *a, int64_t now_ms)
{
    for (ledger_resource k = 0; k < LEDGER_RESOURCES; k++)
        if (held_now(l, a, k, now_ms)) return;
    free_account(l, a);
}

/* Frees the accounts that hold nothing because time has passed. */
static void sweep(ledger *l, int64_t now_ms)
{
    for (size_t i = 0; i < CHAINS; i++)
        for (account *a = LIST_FIRST(&l->chain[i]), *next; a; a = next) {
            next = LIST_NEXT(a, link);
            free_empty(l, a, now_ms);
        }
    l->sweep_at = 2 * l->count + SWEEP_LEAST;
}

static account *open_account(ledger *l, const char *holder, int64_t now_ms)
{
    account *a = find(l, holder);
    if (a) return a;
    if (l->count >= l->sweep_at) sweep(l, now_ms);
    a = mem_alloc(sizeof *a);
    snprintf(a->holder, sizeof a->holder, "%s", holder);
    LIST_INSERT_HEAD(&l->chain[chain_of(holder)], a, link);
    l->count++;
    return a;
}

/* ---- what may be taken */

static int64_t parts_of(ledger_resource what, int64_t amount)
{
    return rows[what].an_hour ? amount * PARTS_OF_RATE : amount;
}

static ledger_decision decide(const ledger *l, ledger_resource what, int64_t held, int64_t amount)
{
    const ledger_limits *most = &l->limits[what];
    if (most->holder && amount > parts_of(what, most->holder) - held) return LEDGER_HOLDER_FULL;
    if (most->all && amount > most->all - l->all[what] && held + amount > rows[what].each)
        return LEDGER_ALL_FULL;
    return LEDGER_FITS;
}

ledger_decision ledger_check(ledger *l, ledger_resource what, const char *holder, int64_t amount)
{
    const int64_t now_ms = clock_monotonic_ms();
    pthread_mutex_lock(&l->mutex);
    const int64_t held = held_now(l, find(l, holder), what, now_ms);
    ledger_decision decision = decide(l, what, held, parts_of(what, amount));
    pthread_mutex_unlock(&l->mutex);
    return decision;
}

ledger_decision ledger_take(ledger *l, ledger_resource what, const char *holder, int64_t amount)
{
    const int64_t now_ms = clock_monotonic_ms(), parts = parts_of(what, amount);
    pthread_mutex_lock(&l->mutex);
    const int64_t held = held_now(l, find(l, holder), what, now_ms);
    ledger_decision decision = decide(l, what, held, parts);
    if (decision == LEDGER_FITS && amount && (l->limits[what].holder || !rows[what].an_hour)) {
        account *a = open_account(l, holder, now_ms);
        a->held[what] = held + parts;
        a->at_ms[what] = now_ms;
        if (!rows[what].an_hour) l->all[what] += parts;
    }
    pthread_mutex_unlock(&l->mutex);
    return decision;
}

void ledger_add(ledger *l, ledger_resource what, const char *holder, int64_t amount)
{
    const int64_t now_ms = clock_monotonic_ms();
    assert(!rows[what].an_hour);
    if (!amount) return;
    pthread_mutex_lock(&l->mutex);
    account *a = open_account(l, holder, now_ms);
    a->held[what] += amount;
    l->all[what] += amount;
    free_empty(l, a, now_ms);
    pthread_mutex_unlock(&l->mutex);
}

void ledger_give_back(ledger *l, ledger_resource what, const char *holder, int64_t amount)
{
    ledger_add(l, what, holder, -amount);
}

int64_t ledger_held(ledger *l, ledger_resource what, const char *holder)
{
    pthread_mutex_lock(&l->mutex);
    int64_t held = held_now(l, find(l, holder), what, clock_monotonic_ms());
    pthread_mutex_unlock(&l->mutex);
    return held / parts_of(what, 1);
}

/* ---- refusals */

/* The time until a unit of a rate is left, in seconds, rounded up. The limit may have been removed since the
 * refusal. */
static int64_t find_wait_s(ledger *l, ledger_resource what, const char *holder)
{
    pthread_mutex_lock(&l->mutex);
    const int64_t most = l->limits[what].holder,
                  over =
                      held_now(l, find(l, holder), what, clock_monotonic_ms()) - (most - 1) * PARTS_OF_RATE;
    pthread_mutex_unlock(&l->mutex);
    return over > 0 && most > 0 ? 1 + (over - 1) / (most * 1000) : 1;
}

ledger_refusal ledger_explain(ledger *l, ledger_resource what, ledger_decision why, const char *holder)
{
    const row *of = &rows[what];
    const bool all = why == LEDGER_ALL_FULL;
    const rule *broken = all ? &of->all : &of->holder;
    const ledger_limits most = ledger_get_limits(l, what);
    const int64_t limit = all ? most.all : most.holder;
    char subject[LEDGER_HOLDER_SIZE + 8], number[32] = "", later[40];
    assert(broken->code);
    if (limit) snprintf(number, sizeof number, "%" PRId64 ", ", limit);
    ledger_refusal refusal = {.code = broken->code, .retry_s = broken->retry_s};
    if (of->an_hour) refusal.retry_s = find_wait_s(l, what, holder);
    snprintf(subject, sizeof subject, "%s has", holder);
    snprintf(later, sizeof later, "try again in %" PRId64 " s", refusal.retry_s);
    snprintf(refusal.message, sizeof refusal.message, "%s reached the limit of %s (%ssetting %s): %s",
             all ? "all users together have" : subject, of->what, number, broken->setting,
             of->an_hour ? later : broken->remedy);
    return refusal;
}

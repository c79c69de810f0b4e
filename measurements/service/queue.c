// SPDX-License-Identifier: Apache-2.0
/* The queue against the machine it runs on, as ratios in one run: how many submissions are acknowledged in
 * a second by 16 threads, over what SQLite makes of durable transactions of one row; and how long a
 * listing, a look at a job and a claim take with 100 000 jobs waiting, of one user and of a thousand, over an
 * empty queue. Exits 1 when a claim is missed. */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/core/memory.h"
#include "durable.h"
#include "service/queue/queue.h"
#include "files/file.h"

enum { CLIENTS = 16, FILLERS = 200, WAITING = 100000, USERS = 1000, ROUNDS = 5, LOOKS = 1000 };
/* of one measurement of a rate; five of each alternate, so that a noisy neighbour hits both */
static const double SPAN_S = 2;
static const double LEAST_RATIO = 7, MOST_RATIO = 3;

static _Noreturn void die(const char *what)
{
    fprintf(stderr, "bench/queue: %s\n", what);
    exit(2);
}

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static const queue_submission job = {
    .name = "sphere",
    .labels = "[\"shot\"]",
    .spec =
        "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"sphere\",\"center\":[0,0,0],\"radius\":1}},"
        "\"sampling\":{\"count\":1000}}",
    .max_attempts = 3,
    .threads = 1,
    .memory_mb = 4096,
};

typedef struct client {
    queue *q;
    double until_s; /* 0: until `most` */
    int users, most, done;
    pthread_t thread;
} client;

/* Jobs of users in turn. */
static void submit_one(queue *q, int number, int users, queue_receipt *receipt)
{
    char owner[32];
    error e = {0};
    queue_submission s = job;
    snprintf(owner, sizeof owner, "user%d", number % users);
    s.owner = owner;
    if (!queue_put(q, &s, receipt, &e)) die(e.message);
}

static void *submit(void *argument)
{
    client *c = argument;
    while (c->until_s > 0 ? now_s() < c->until_s : c->done < c->most) {
        queue_receipt receipt;
        submit_one(c->q, c->done++, c->users, &receipt);
    }
    return NULL;
}

static int submit_all(queue *q, int clients, int users, double span_s, int most)
{
    client *c = mem_alloc((size_t)clients * sizeof *c);
    int done = 0;
    for (int i = 0; i < clients; i++) {
        c[i] = (client){
            .q = q, .users = users, .until_s = span_s > 0 ? now_s() + span_s : 0, .most = most / clients};
        if (pthread_create(&c[i].thread, NULL, submit, &c[i]) != 0) die("no thread");
    }
    for (int i = 0; i < clients; i++) {
        pthread_join(c[i].thread, NULL);
        done += c[i].done;
    }
    free(c);
    return done;
}

static int compare(const void *a, const void *b)
{
    const double *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

typedef struct latency { /* the 99th percentile, in ms */
    double list, status, claim;
} latency;

static double percentile(double *s)
{
    qsort(s, LOOKS, sizeof *s, compare);
    return s[LOOKS * 99 / 100] * 1e3;
}

/* Of one job in every listing, since an empty queue has no page of fifty. Each look on a queue of as many
 * jobs as before: what is claimed is ended and another one put. */
static latency measure_looks(queue *q, int users)
{
    static double list[LOOKS], status[LOOKS], claim[LOOKS];
    const queue_resources room = {.threads = 8, .all_threads = 8, .memory_mb = 65536, .all_memory_mb = 65536};
    const queue_ending ending = {
        .state = QUEUE_SUCCEEDED, .outcome = QUEUE_CONVERGED, .exit_status = 0, .signal = -1};
    for (int i = 0; i < LOOKS; i++) {
        queue_receipt receipt;
        queue_claimed claimed;
        queue_job *jobs, one;
        size_t count;
        bool found, accepted;
        submit_one(q, i, users, &receipt);
        double t0 = now_s();
        if (!queue_list(q, &(queue_filter){.state = QUEUE_QUEUED, .limit = 1}, &jobs, &count, NULL))
            die("list");
        double t1 = now_s();
        queue_jobs_free(jobs, count);
        double t2 = now_s();
        if (!queue_get(q, receipt.id, &one, &found, NULL) || !found) die("get");
        double t3 = now_s();
        queue_job_clear(&one);
        double t4 = now_s();
        if (!queue_claim(q, &room, &claimed, &found, NULL) || !found) die("claim");
        double t5 = now_s();
        queue_fence fence = {claimed.job.id, claimed.task.number, claimed.task.attempt};
        if (!queue_finish(q, &fence, &ending, &accepted, NULL) || !accepted) die("finish");
        queue_claimed_clear(&claimed);
        list[i] = t1 - t0;
        status[i] = t3 - t2;
        claim[i] = t5 - t4;
    }
    return (latency){percentile(list), percentile(status), percentile(claim)};
}

static bool judge(const char *what, double value, double bound, bool at_least)
{
    bool ok = at_least ? value >= bound : value <= bound;
    printf("%-44s %8.2f  (%s %g)%s\n", what, value, at_least ? "at least" : "at most", bound,
           ok ? "" : "  MISSED");
    return ok;
}

static bool bench_rates(queue *q, const char *base)
{
    double rows[ROUNDS], jobs[ROUNDS], ratio[ROUNDS];
    for (int i = 0; i < ROUNDS; i++) {
        rows[i] = durable_rows(base, SPAN_S);
        jobs[i] = submit_all(q, CLIENTS, 1, SPAN_S, 0) / SPAN_S;
        ratio[i] = jobs[i] / rows[i];
        printf("durable rows %.0f/s, submissions by %d threads %.0f/s\n", rows[i], CLIENTS, jobs[i]);
    }
    qsort(ratio, ROUNDS, sizeof *ratio, compare);
    return judge("submissions over rows, median", ratio[ROUNDS / 2], LEAST_RATIO, true);
}

static bool bench_looks(queue *q, const latency *empty, int users)
{
    printf("waiting: %d, of %d user%s\n", submit_all(q, FILLERS, users, 0, WAITING), users,
           users > 1 ? "s" : "");
    latency full = measure_looks(q, users);
    printf("99th percentile, ms: list %.3f and %.3f, status %.3f and %.3f, claim %.2f and %.2f\n",
           empty->list, full.list, empty->status, full.status, empty->claim, full.claim);
    bool ok = judge("list with 100 000 jobs over an empty queue", full.list / empty->list, MOST_RATIO, false);
    ok &= judge("status", full.status / empty->status, MOST_RATIO, false);
    ok &= judge("claim", full.claim / empty->claim, MOST_RATIO, false);
    return ok;
}

int main(int argc, char **argv)
{
    char base[256], *place[4];
    snprintf(base, sizeof base, "%s/hexad-bench-XXXXXX", argc > 1 ? argv[1] : "/tmp");
    if (!mkdtemp(base)) die("no directory");
    queue *q[4];
    for (int i = 0; i < 4; i++) {
        error e = {0};
        place[i] = mem_printf("%s/%d", base, i);
        if (!store_directory_create(place[i], &e) || !(q[i] = queue_open(place[i], &e))) die(e.message);
    }
    bool ok = bench_rates(q[0], base);
    latency empty = measure_looks(q[1], 1);
    ok &= bench_looks(q[2], &empty, 1);
    ok &= bench_looks(q[3], &empty, USERS);
    for (int i = 0; i < 4; i++) {
        queue_close(q[i]);
        free(place[i]);
    }
    store_remove(base, NULL);
    return ok ? 0 : 1;
}

#include "service/api/submission_rate.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

#define HOUR_MS 3600000.0

typedef struct bucket {
    char *user;
    double left;
    int64_t at_ms; /* monotonic time of `left` */
} bucket;

struct submission_rate {
    double most;
    pthread_mutex_t mutex;
    bucket *item;
    size_t count, capacity;
};

submission_rate *submission_rate_new(int64_t jobs_an_hour)
{
    submission_rate *r = mem_alloc(sizeof *r);
    r->most = (double)jobs_an_hour;
    pthread_mutex_init(&r->mutex, NULL);
    return r;
}

void submission_rate_free(submission_rate *r)
{
    if (!r) return;
    for (size_t i = 0; i < r->count; i++) free(r->item[i].user);
    free(r->item);
    pthread_mutex_destroy(&r->mutex);
    free(r);
}

static void fill(const submission_rate *r, bucket *b, int64_t now_ms)
{
    b->left = fmin(r->most, b->left + r->most * (double)(now_ms - b->at_ms) / HOUR_MS);
    b->at_ms = now_ms;
}

/* Removes full buckets: they equal those of new users. */
static void forget(submission_rate *r, int64_t now_ms)
{
    size_t kept = 0;
    for (size_t i = 0; i < r->count; i++) {
        fill(r, &r->item[i], now_ms);
        if (r->item[i].left < r->most)
            r->item[kept++] = r->item[i];
        else
            free(r->item[i].user);
    }
    r->count = kept;
}

static bucket *find(submission_rate *r, const char *user, int64_t now_ms)
{
    for (size_t i = 0; i < r->count; i++)
        if (strcmp(r->item[i].user, user) == 0) return &r->item[i];
    if (r->count == r->capacity) forget(r, now_ms);
    if (r->count == r->capacity)
        r->item = mem_resize(r->item, (r->capacity = r->capacity * 2 + 8) * sizeof *r->item);
    bucket *b = &r->item[r->count++];
    *b = (bucket){mem_strdup(user), r->most, now_ms};
    return b;
}

bool submission_rate_take(submission_rate *r, const char *user, int64_t now_ms, int64_t *wait_s)
{
    pthread_mutex_lock(&r->mutex);
    bucket *b = find(r, user, now_ms);
    fill(r, b, now_ms);
    bool ok = b->left >= 1;
    if (ok)
        b->left--;
    else
        *wait_s = (int64_t)ceil((1 - b->left) * HOUR_MS / r->most / 1000);
    pthread_mutex_unlock(&r->mutex);
    return ok;
}

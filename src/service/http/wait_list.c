// SPDX-License-Identifier: Apache-2.0
#include "service/http/wait_list.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/queue.h>

#include <microhttpd.h>

#include "base/core/clock.h"
#include "base/core/memory.h"

#define TOPIC_SIZE 32
/* Maximum delay, in ms, of resuming a connection after its deadline. */
#define TICK_MS 250

typedef struct waiter {
    loop *served_by;
    struct MHD_Connection *connection;
    char topic[TOPIC_SIZE];
    int64_t until_ms;
    LIST_ENTRY(waiter) link;
} waiter;

struct wait_list {
    runner_task *task;
    pthread_mutex_t mutex;
    LIST_HEAD(, waiter) waiters;
    uint64_t happened;
    bool dismissed;
};

static bool is_wanted(const waiter *w, const char *const *topics, size_t count)
{
    if (!*w->topic) return count > 0;
    for (size_t i = 0; i < count; i++)
        if (strcmp(w->topic, topics[i]) == 0) return true;
    return false;
}

/* The caller holds the mutex. A waiter leaves the list before its connection is resumed, since the connection
 * may wait again at once. */
static void resume_waiters(wait_list *l, const char *const *topics, size_t count)
{
    int64_t now = clock_monotonic_ms();
    for (waiter *w = LIST_FIRST(&l->waiters), *next; w; w = next) {
        next = LIST_NEXT(w, link);
        if (!l->dismissed && w->until_ms > now && !is_wanted(w, topics, count)) continue;
        LIST_REMOVE(w, link);
        loop_resume(w->served_by, w->connection);
        free(w);
    }
}

static int64_t resume_overdue(void *context)
{
    wait_list *l = context;
    pthread_mutex_lock(&l->mutex);
    resume_waiters(l, NULL, 0);
    const bool any = !LIST_EMPTY(&l->waiters);
    pthread_mutex_unlock(&l->mutex);
    return any ? clock_monotonic_ms() + TICK_MS : RUNNER_WHEN_WOKEN;
}

wait_list *wait_list_new(runner *to)
{
    wait_list *l = mem_alloc(sizeof *l);
    pthread_mutex_init(&l->mutex, NULL);
    l->task = runner_add(to, "wait-list", resume_overdue, l);
    return l;
}

void wait_list_dismiss(wait_list *l)
{
    pthread_mutex_lock(&l->mutex);
    l->dismissed = true;
    resume_waiters(l, NULL, 0);
    pthread_mutex_unlock(&l->mutex);
}

void wait_list_free(wait_list *l)
{
    if (!l) return;
    pthread_mutex_destroy(&l->mutex);
    free(l);
}

bool wait_list_is_dismissed(wait_list *l)
{
    pthread_mutex_lock(&l->mutex);
    bool dismissed = l->dismissed;
    pthread_mutex_unlock(&l->mutex);
    return dismissed;
}

uint64_t wait_list_seen(wait_list *l)
{
    pthread_mutex_lock(&l->mutex);
    uint64_t happened = l->happened;
    pthread_mutex_unlock(&l->mutex);
    return happened;
}

bool wait_list_add(wait_list *l, loop *served_by, struct MHD_Connection *connection, uint64_t seen,
                   const char *topic, int64_t until_ms)
{
    pthread_mutex_lock(&l->mutex);
    bool stays = !l->dismissed && seen == l->happened;
    if (stays) {
        waiter *w = mem_alloc(sizeof *w);
        w->served_by = served_by;
        w->connection = connection;
        w->until_ms = until_ms;
        strncpy(w->topic, topic, sizeof w->topic - 1);
        LIST_INSERT_HEAD(&l->waiters, w, link);
        if (!LIST_NEXT(w, link)) runner_wake(l->task);
    }
    pthread_mutex_unlock(&l->mutex);
    return stays;
}

void wait_list_wake(wait_list *l, const char *const *topics, size_t count)
{
    pthread_mutex_lock(&l->mutex);
    l->happened++;
    resume_waiters(l, topics, count);
    pthread_mutex_unlock(&l->mutex);
}

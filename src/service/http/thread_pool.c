// SPDX-License-Identifier: Apache-2.0
#include "service/http/thread_pool.h"

#include <errno.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "base/core/background.h"
#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"

typedef STAILQ_HEAD(work_list, thread_pool_work) work_list;

/* The work of one user. Freed when none waits or runs. */
typedef struct line {
    char *user;
    work_list waiting;
    TAILQ_ENTRY(line) link;
} line;

struct thread_pool {
    pthread_mutex_t mutex;
    pthread_cond_t changed;   /* monotonic clock */
    TAILQ_HEAD(, line) lines; /* ordered by the last service, least recent first */
    bool refusing, stopping;
    thread_pool_settings settings;
    size_t weight; /* sum of the weights of running work */
    unsigned count;
    pthread_t thread[];
};

static int64_t running_of(const thread_pool *p, const line *l)
{
    return ledger_held(p->settings.counts, p->settings.kind, l->user);
}

static line *line_of(thread_pool *p, const char *user)
{
    line *found;
    TAILQ_FOREACH (found, &p->lines, link)
        if (strcmp(found->user, user) == 0) return found;
    found = mem_alloc(sizeof *found);
    found->user = mem_strdup(user);
    STAILQ_INIT(&found->waiting);
    TAILQ_INSERT_TAIL(&p->lines, found, link);
    return found;
}

/* The line whose turn it is, if its work may begin now; otherwise NULL. */
static line *choose(const thread_pool *p)
{
    line *l, *found = NULL;
    int64_t fewest = INT64_MAX;
    TAILQ_FOREACH (l, &p->lines, link) {
        if (STAILQ_EMPTY(&l->waiting) ||
            ledger_check(p->settings.counts, p->settings.kind, l->user, 1) != LEDGER_FITS ||
            running_of(p, l) >= fewest)
            continue;
        found = l;
        fewest = running_of(p, l);
    }
    bool fits =
        found && (!p->weight || p->weight + STAILQ_FIRST(&found->waiting)->weight <= p->settings.most_weight);
    return fits ? found : NULL;
}

static int64_t waits_since_ms(const line *l)
{
    return STAILQ_EMPTY(&l->waiting) ? INT64_MAX : STAILQ_FIRST(&l->waiting)->since_ms;
}

/* The line whose first work has waited longest; NULL: no work waits. */
static line *find_oldest(const thread_pool *p)
{
    line *l, *found = NULL;
    TAILQ_FOREACH (l, &p->lines, link)
        if (waits_since_ms(l) < (found ? waits_since_ms(found) : INT64_MAX)) found = l;
    return found;
}

static thread_pool_work *take_first(line *l)
{
    thread_pool_work *work = STAILQ_FIRST(&l->waiting);
    STAILQ_REMOVE_HEAD(&l->waiting, link);
    return work;
}

static thread_pool_work *take(thread_pool *p, line *l)
{
    thread_pool_work *work = take_first(l);
    ledger_take(p->settings.counts, p->settings.kind, l->user, 1);
    p->weight += work->weight;
    TAILQ_REMOVE(&p->lines, l, link);
    TAILQ_INSERT_TAIL(&p->lines, l, link);
    return work;
}

static void free_empty_line(thread_pool *p, line *l)
{
    if (!STAILQ_EMPTY(&l->waiting) || running_of(p, l)) return;
    TAILQ_REMOVE(&p->lines, l, link);
    free(l->user);
    free(l);
}

static void end_work(thread_pool *p, line *l)
{
    ledger_give_back(p->settings.counts, p->settings.kind, l->user, 1);
    free_empty_line(p, l);
}

/* Refuses the oldest work if it has waited too long. False: there is none. The caller holds the mutex, which
 * is released during the refusal. */
static bool refuse_late(thread_pool *p)
{
    line *l = find_oldest(p);
    if (!l || clock_monotonic_ms() - waits_since_ms(l) < p->settings.patience_ms) return false;
    thread_pool_work *work = take_first(l);
    free_empty_line(p, l);
    pthread_mutex_unlock(&p->mutex);
    work->refuse(work, THREAD_POOL_IS_BUSY);
    pthread_mutex_lock(&p->mutex);
    return true;
}

/* Waits until there may be something to do. Work that cannot begin is refused when it has waited too long. */
static void wait_for_work(thread_pool *p)
{
    const line *l = find_oldest(p);
    if (l)
        background_wait_until(&p->changed, &p->mutex, waits_since_ms(l) + p->settings.patience_ms);
    else
        pthread_cond_wait(&p->changed, &p->mutex);
}

static void *run_work(void *argument)
{
    thread_pool *p = argument;
    if (setpriority(PRIO_PROCESS, 0, getpriority(PRIO_PROCESS, 0) + p->settings.nice) !=
        0) /* of this thread only (Linux) */
        log_write(LOG_LEVEL_WARNING, "cannot lower the priority of a thread: %s", strerror(errno));
    pthread_mutex_lock(&p->mutex);
    for (;;) {
        if (refuse_late(p)) continue;
        line *mine = choose(p);
        if (mine) {
            thread_pool_work *work = take(p, mine);
            size_t weight = work->weight; /* the work may be freed after it has run */
            pthread_mutex_unlock(&p->mutex);
            work->run(work);
            pthread_mutex_lock(&p->mutex);
            p->weight -= weight;
            if (weight) pthread_cond_broadcast(&p->changed); /* several pieces of work may fit now */
            end_work(p, mine);
        } else if (p->stopping) {
            break;
        } else {
            wait_for_work(p);
        }
    }
    pthread_mutex_unlock(&p->mutex);
    return NULL;
}

thread_pool *thread_pool_start(const thread_pool_settings *settings, error *e)
{
    thread_pool *p = mem_alloc(sizeof *p + settings->threads * sizeof *p->thread);
    pthread_mutex_init(&p->mutex, NULL);
    background_init_condition(&p->changed);
    TAILQ_INIT(&p->lines);
    p->settings = *settings;
    for (; p->count < settings->threads; p->count++) {
        if (background_start(&p->thread[p->count], run_work, p, "the server", e)) continue;
        thread_pool_stop(p);
        return NULL;
    }
    return p;
}

/* Moves all work that has not begun to `all`. */
static void take_all(thread_pool *p, work_list *all)
{
    for (line *l = TAILQ_FIRST(&p->lines), *next; l; l = next) {
        next = TAILQ_NEXT(l, link);
        STAILQ_CONCAT(all, &l->waiting);
        free_empty_line(p, l);
    }
}

void thread_pool_refuse(thread_pool *p)
{
    if (!p) return;
    work_list all = STAILQ_HEAD_INITIALIZER(all);
    pthread_mutex_lock(&p->mutex);
    p->refusing = true;
    take_all(p, &all);
    pthread_mutex_unlock(&p->mutex);
    while (!STAILQ_EMPTY(&all)) {
        thread_pool_work *work = STAILQ_FIRST(&all);
        STAILQ_REMOVE_HEAD(&all, link);
        work->refuse(work, THREAD_POOL_STOPS);
    }
}

void thread_pool_stop(thread_pool *p)
{
    if (!p) return;
    thread_pool_refuse(p);
    pthread_mutex_lock(&p->mutex);
    p->stopping = true;
    pthread_cond_broadcast(&p->changed);
    pthread_mutex_unlock(&p->mutex);
    for (unsigned i = 0; i < p->count; i++) pthread_join(p->thread[i], NULL);
    pthread_cond_destroy(&p->changed);
    pthread_mutex_destroy(&p->mutex);
    free(p);
}

void thread_pool_add(thread_pool *p, thread_pool_work *work)
{
    work->since_ms = clock_monotonic_ms();
    pthread_mutex_lock(&p->mutex);
    bool refused = p->refusing;
    if (!refused) STAILQ_INSERT_TAIL(&line_of(p, work->user)->waiting, work, link);
    pthread_mutex_unlock(&p->mutex);
    if (refused)
        work->refuse(work, THREAD_POOL_STOPS);
    else
        /* after the unlocking, so that the woken thread need not wait for the mutex */
        pthread_cond_signal(&p->changed);
}

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

/* The work of one user. Freed when it is empty. */
typedef struct line {
    char *user;
    unsigned running;
    thread_pool_work *first, *last; /* work that has not begun */
    struct line *next;
} line;

struct thread_pool {
    pthread_mutex_t mutex;
    pthread_cond_t changed; /* monotonic clock */
    line *lines;            /* ordered by the last service, least recent first */
    bool refusing, stopping;
    thread_pool_settings settings;
    size_t weight; /* sum of the weights of running work */
    unsigned count;
    pthread_t thread[];
};

static void append_line(thread_pool *p, line *added)
{
    line **at = &p->lines;
    while (*at) at = &(*at)->next;
    added->next = NULL;
    *at = added;
}

static void remove_line(thread_pool *p, const line *gone)
{
    line **at = &p->lines;
    while (*at != gone) at = &(*at)->next;
    *at = gone->next;
}

static line *line_of(thread_pool *p, const char *user)
{
    line *found = p->lines;
    while (found && strcmp(found->user, user) != 0) found = found->next;
    if (found) return found;
    found = mem_alloc(sizeof *found);
    found->user = mem_strdup(user);
    append_line(p, found);
    return found;
}

/* The line whose turn it is, if its work may begin now; otherwise NULL. */
static line *choose(const thread_pool *p)
{
    line *found = NULL;
    for (line *l = p->lines; l; l = l->next)
        if (l->first && l->running < p->settings.most_of_user && (!found || l->running < found->running))
            found = l;
    bool fits = found && (!p->weight || p->weight + found->first->weight <= p->settings.most_weight);
    return fits ? found : NULL;
}

/* The line whose first work has waited longest; NULL: no work waits. */
static line *find_oldest(const thread_pool *p)
{
    line *found = NULL;
    for (line *l = p->lines; l; l = l->next)
        if (l->first && (!found || l->first->since_ms < found->first->since_ms)) found = l;
    return found;
}

static thread_pool_work *take_first(line *l)
{
    thread_pool_work *work = l->first;
    l->first = work->next;
    if (!l->first) l->last = NULL;
    return work;
}

static thread_pool_work *take(thread_pool *p, line *l)
{
    thread_pool_work *work = take_first(l);
    l->running++;
    p->weight += work->weight;
    remove_line(p, l);
    append_line(p, l);
    return work;
}

static void free_empty_line(thread_pool *p, line *l)
{
    if (l->running || l->first) return;
    remove_line(p, l);
    free(l->user);
    free(l);
}

static void end_work(thread_pool *p, line *l)
{
    l->running--;
    free_empty_line(p, l);
}

/* Refuses the oldest work if it has waited too long. False: there is none. The caller holds the mutex, which is
 * released during the refusal. */
static bool refuse_late(thread_pool *p)
{
    line *l = find_oldest(p);
    if (!l || clock_monotonic_ms() - l->first->since_ms < p->settings.patience_ms) return false;
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
        background_wait_until(&p->changed, &p->mutex, l->first->since_ms + p->settings.patience_ms);
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
    p->settings = *settings;
    for (; p->count < settings->threads; p->count++) {
        if (background_start(&p->thread[p->count], run_work, p, "the server", e)) continue;
        thread_pool_stop(p);
        return NULL;
    }
    return p;
}

/* Removes all work that has not begun. */
static thread_pool_work *take_all(thread_pool *p)
{
    thread_pool_work *all = NULL, **end = &all;
    for (line *l = p->lines, *next; l; l = next) {
        next = l->next;
        *end = l->first;
        if (l->last) end = &l->last->next;
        l->first = l->last = NULL;
        l->running++; /* end_work frees the line unless more of its work runs */
        end_work(p, l);
    }
    return all;
}

void thread_pool_refuse(thread_pool *p)
{
    if (!p) return;
    pthread_mutex_lock(&p->mutex);
    p->refusing = true;
    thread_pool_work *all = take_all(p);
    pthread_mutex_unlock(&p->mutex);
    for (thread_pool_work *work = all, *next; work; work = next) {
        next = work->next;
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
    work->next = NULL;
    work->since_ms = clock_monotonic_ms();
    pthread_mutex_lock(&p->mutex);
    bool refused = p->refusing;
    if (!refused) {
        line *l = line_of(p, work->user);
        if (l->last)
            l->last->next = work;
        else
            l->first = work;
        l->last = work;
    }
    pthread_mutex_unlock(&p->mutex);
    if (refused)
        work->refuse(work, THREAD_POOL_STOPS);
    else
        /* after the unlocking, so that the woken thread need not wait for the mutex */
        pthread_cond_signal(&p->changed);
}

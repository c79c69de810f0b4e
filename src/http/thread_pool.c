#include "http/thread_pool.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/background.h"
#include "base/memory.h"

struct thread_pool {
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    thread_pool_work *first, *last;
    bool stopping;
    unsigned count;
    pthread_t thread[];
};

static void *run_work(void *argument)
{
    thread_pool *p = argument;
    pthread_mutex_lock(&p->mutex);
    for (;;) {
        while (!p->first && !p->stopping) pthread_cond_wait(&p->changed, &p->mutex);
        thread_pool_work *mine = p->first;
        if (!mine) break;
        p->first = mine->next;
        if (!p->first) p->last = NULL;
        pthread_mutex_unlock(&p->mutex);
        mine->run(mine);
        pthread_mutex_lock(&p->mutex);
    }
    pthread_mutex_unlock(&p->mutex);
    return NULL;
}

thread_pool *thread_pool_start(unsigned threads, error *e)
{
    thread_pool *p = mem_alloc(sizeof *p + threads * sizeof *p->thread);
    pthread_mutex_init(&p->mutex, NULL);
    pthread_cond_init(&p->changed, NULL);
    for (; p->count < threads; p->count++) {
        if (background_start(&p->thread[p->count], run_work, p, "the server", e)) continue;
        thread_pool_stop(p);
        return NULL;
    }
    return p;
}

void thread_pool_stop(thread_pool *p)
{
    if (!p) return;
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
    pthread_mutex_lock(&p->mutex);
    if (p->last)
        p->last->next = work;
    else
        p->first = work;
    p->last = work;
    pthread_cond_signal(&p->changed);
    pthread_mutex_unlock(&p->mutex);
}

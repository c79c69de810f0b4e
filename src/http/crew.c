#include "http/crew.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

struct crew {
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    crew_work *first, *last;
    bool stopping;
    unsigned count;
    pthread_t thread[];
};

static void *labour(void *argument)
{
    crew *c = argument;
    pthread_mutex_lock(&c->mutex);
    for (;;) {
        while (!c->first && !c->stopping) pthread_cond_wait(&c->changed, &c->mutex);
        crew_work *mine = c->first;
        if (!mine) break;
        c->first = mine->next;
        if (!c->first) c->last = NULL;
        pthread_mutex_unlock(&c->mutex);
        mine->run(mine);
        pthread_mutex_lock(&c->mutex);
    }
    pthread_mutex_unlock(&c->mutex);
    return NULL;
}

crew *crew_start(unsigned threads, error *e)
{
    crew *c = mem_alloc(sizeof *c + threads * sizeof *c->thread);
    pthread_mutex_init(&c->mutex, NULL);
    pthread_cond_init(&c->changed, NULL);
    for (; c->count < threads; c->count++) {
        int why = pthread_create(&c->thread[c->count], NULL, labour, c);
        if (why == 0) continue;
        error_set(e, ERROR_INTERNAL, "no thread for the server: %s", strerror(why));
        crew_stop(c);
        return NULL;
    }
    return c;
}

void crew_stop(crew *c)
{
    if (!c) return;
    pthread_mutex_lock(&c->mutex);
    c->stopping = true;
    pthread_cond_broadcast(&c->changed);
    pthread_mutex_unlock(&c->mutex);
    for (unsigned i = 0; i < c->count; i++) pthread_join(c->thread[i], NULL);
    pthread_cond_destroy(&c->changed);
    pthread_mutex_destroy(&c->mutex);
    free(c);
}

void crew_give(crew *c, crew_work *work)
{
    work->next = NULL;
    pthread_mutex_lock(&c->mutex);
    if (c->last)
        c->last->next = work;
    else
        c->first = work;
    c->last = work;
    pthread_cond_signal(&c->changed);
    pthread_mutex_unlock(&c->mutex);
}

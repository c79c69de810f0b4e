#include "executor/leftovers.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/background.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/memory.h"

/* Between two looks for a directory that cannot be reached: disks come back when people bring them back. */
#define AGAIN_MS 60000

struct leftovers {
    queue *q;
    const store_outputs *outputs;
    queue_copy *copies; /* a name is NULL once its file is gone */
    size_t count;
    pthread_t thread;
    pthread_mutex_t mutex;
    pthread_cond_t stopping;
    bool stop;
};

static bool remove_one(const leftovers *l, const queue_copy *c, bool first)
{
    error e = {0};
    if (store_output_clear(l->outputs, c->directory, c->name, &e) && queue_forget_copy(l->q, c->name, &e)) {
        log_write(LOG_LEVEL_INFO, "leftover of a copy removed directory=%s name=%s", c->directory, c->name);
        return true;
    }
    log_write(first ? LOG_LEVEL_WARNING : LOG_LEVEL_DEBUG,
              "a copy that was cut off may have left %s in %s, which is tried again: %s", c->name,
              c->directory, e.message);
    return false;
}

/* Waits for the next round; false: it is to end. */
static bool wait_for_round(leftovers *l)
{
    int64_t until_ms = clock_wall_ms() + AGAIN_MS;
    struct timespec until = {.tv_sec = (time_t)(until_ms / 1000)};
    int status = 0;
    pthread_mutex_lock(&l->mutex);
    while (!l->stop && status == 0) status = pthread_cond_timedwait(&l->stopping, &l->mutex, &until);
    bool go_on = !l->stop;
    pthread_mutex_unlock(&l->mutex);
    return go_on;
}

static void *run(void *argument)
{
    leftovers *l = argument;
    size_t left = l->count;
    bool first = true;
    do {
        for (size_t i = 0; i < l->count; i++) {
            if (!l->copies[i].name || !remove_one(l, &l->copies[i], first)) continue;
            free(l->copies[i].name);
            l->copies[i].name = NULL;
            left--;
        }
        first = false;
    } while (left && wait_for_round(l));
    return NULL;
}

static void release(leftovers *l)
{
    pthread_cond_destroy(&l->stopping);
    pthread_mutex_destroy(&l->mutex);
    queue_copies_free(l->copies, l->count);
    free(l);
}

bool leftovers_start(queue *q, const store_outputs *outputs, leftovers **made, error *e)
{
    leftovers *l = mem_alloc(sizeof *l);
    l->q = q;
    l->outputs = outputs;
    pthread_mutex_init(&l->mutex, NULL);
    pthread_cond_init(&l->stopping, NULL);
    bool ok = queue_list_copies(q, &l->copies, &l->count, e);
    if (ok && l->count) ok = background_start(&l->thread, run, l, "what copies have left behind", e);
    *made = ok && l->count ? l : NULL;
    if (!*made) release(l);
    return ok;
}

void leftovers_stop(leftovers *l)
{
    if (!l) return;
    pthread_mutex_lock(&l->mutex);
    l->stop = true;
    pthread_cond_signal(&l->stopping);
    pthread_mutex_unlock(&l->mutex);
    pthread_join(l->thread, NULL);
    release(l);
}

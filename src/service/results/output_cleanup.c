#include "service/results/output_cleanup.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/core/background.h"
#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"

/* Time between two rounds, in milliseconds. An unreachable directory becomes reachable when its disk is mounted. */
#define AGAIN_MS 60000

struct output_cleanup {
    queue *q;
    const store_outputs *outputs;
    queue_copy *copies; /* the thread's; the name is NULL after the file was removed */
    size_t count;
    pthread_t thread;
    pthread_mutex_t mutex;
    pthread_cond_t stopping;
    bool stop;
};

static bool remove_one(const output_cleanup *c, const queue_copy *copy, bool first)
{
    error e = {0};
    if (store_output_clear(c->outputs, copy->directory, copy->name, &e) &&
        queue_forget_copy(c->q, copy->name, &e)) {
        log_write(LOG_LEVEL_INFO, "temporary file of an interrupted copy removed directory=%s name=%s",
                  copy->directory, copy->name);
        return true;
    }
    log_write(first ? LOG_LEVEL_WARNING : LOG_LEVEL_DEBUG,
              "cannot remove the file %s of an interrupted copy from %s and tries again: %s", copy->name,
              copy->directory, e.message);
    return false;
}

/* Waits for the next round. False: the thread must end. */
static bool wait_for_round(output_cleanup *c)
{
    int64_t until_ms = clock_monotonic_ms() + AGAIN_MS;
    bool waiting = true;
    pthread_mutex_lock(&c->mutex);
    while (!c->stop && waiting) waiting = background_wait_until(&c->stopping, &c->mutex, until_ms);
    bool go_on = !c->stop;
    pthread_mutex_unlock(&c->mutex);
    return go_on;
}

static void *run(void *argument)
{
    output_cleanup *c = argument;
    size_t left = c->count;
    bool first = true;
    do {
        for (size_t i = 0; i < c->count; i++) {
            if (!c->copies[i].name || !remove_one(c, &c->copies[i], first)) continue;
            free(c->copies[i].name);
            c->copies[i].name = NULL;
            left--;
        }
        first = false;
    } while (left && wait_for_round(c));
    return NULL;
}

static void release(output_cleanup *c)
{
    pthread_cond_destroy(&c->stopping);
    pthread_mutex_destroy(&c->mutex);
    queue_copies_free(c->copies, c->count);
    free(c);
}

bool output_cleanup_start(queue *q, const store_outputs *outputs, output_cleanup **made, error *e)
{
    output_cleanup *c = mem_alloc(sizeof *c);
    c->q = q;
    c->outputs = outputs;
    pthread_mutex_init(&c->mutex, NULL);
    background_init_condition(&c->stopping);
    bool ok = queue_list_copies(q, &c->copies, &c->count, e);
    if (ok && c->count) ok = background_start(&c->thread, run, c, "files of interrupted copies", e);
    *made = ok && c->count ? c : NULL;
    if (!*made) release(c);
    return ok;
}

void output_cleanup_stop(output_cleanup *c)
{
    if (!c) return;
    pthread_mutex_lock(&c->mutex);
    c->stop = true;
    pthread_cond_signal(&c->stopping);
    pthread_mutex_unlock(&c->mutex);
    pthread_join(c->thread, NULL);
    release(c);
}

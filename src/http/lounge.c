#include "http/lounge.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <microhttpd.h>

#include "base/clock.h"
#include "base/memory.h"

#define TOPIC_SIZE 32
/* How late a guest may be let go whose time has come. */
#define TICK_MS 250

typedef struct guest {
    loop *served_by;
    struct MHD_Connection *connection;
    char topic[TOPIC_SIZE];
    int64_t until_ms;
    struct guest *next;
} guest;

struct lounge {
    pthread_t thread;
    pthread_mutex_t mutex;
    pthread_cond_t changed; /* monotonic clock */
    guest *first;
    uint64_t happened;
    bool dismissed;
};

static bool is_wanted(const guest *g, const char *const *topics, size_t count)
{
    if (!*g->topic) return count > 0;
    for (size_t i = 0; i < count; i++)
        if (strcmp(g->topic, topics[i]) == 0) return true;
    return false;
}

/* Held: the mutex. A guest is gone before its connection goes on, and may come again at once. */
static void let_go(lounge *l, const char *const *topics, size_t count)
{
    int64_t now = clock_monotonic_ms();
    for (guest **at = &l->first; *at;) {
        guest *g = *at;
        if (!l->dismissed && g->until_ms > now && !is_wanted(g, topics, count)) {
            at = &g->next;
            continue;
        }
        *at = g->next;
        loop_resume(g->served_by, g->connection);
        free(g);
    }
}

static void *watch(void *argument)
{
    lounge *l = argument;
    pthread_mutex_lock(&l->mutex);
    while (!l->dismissed) {
        struct timespec until;
        clock_gettime(CLOCK_MONOTONIC, &until);
        until.tv_nsec += TICK_MS * 1000000;
        until.tv_sec += until.tv_nsec / 1000000000;
        until.tv_nsec %= 1000000000;
        if (l->first)
            pthread_cond_timedwait(&l->changed, &l->mutex, &until);
        else
            pthread_cond_wait(&l->changed, &l->mutex);
        let_go(l, NULL, 0);
    }
    pthread_mutex_unlock(&l->mutex);
    return NULL;
}

lounge *lounge_open(error *e)
{
    lounge *l = mem_alloc(sizeof *l);
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&l->changed, &monotonic);
    pthread_condattr_destroy(&monotonic);
    pthread_mutex_init(&l->mutex, NULL);
    int why = pthread_create(&l->thread, NULL, watch, l);
    if (why == 0) return l;
    error_set(e, ERROR_INTERNAL, "no thread for the server: %s", strerror(why));
    pthread_cond_destroy(&l->changed);
    pthread_mutex_destroy(&l->mutex);
    free(l);
    return NULL;
}

void lounge_dismiss(lounge *l)
{
    pthread_mutex_lock(&l->mutex);
    l->dismissed = true;
    let_go(l, NULL, 0);
    pthread_cond_broadcast(&l->changed);
    pthread_mutex_unlock(&l->mutex);
}

void lounge_close(lounge *l)
{
    if (!l) return;
    lounge_dismiss(l);
    pthread_join(l->thread, NULL);
    pthread_cond_destroy(&l->changed);
    pthread_mutex_destroy(&l->mutex);
    free(l);
}

bool lounge_is_dismissed(lounge *l)
{
    pthread_mutex_lock(&l->mutex);
    bool dismissed = l->dismissed;
    pthread_mutex_unlock(&l->mutex);
    return dismissed;
}

uint64_t lounge_seen(lounge *l)
{
    pthread_mutex_lock(&l->mutex);
    uint64_t happened = l->happened;
    pthread_mutex_unlock(&l->mutex);
    return happened;
}

bool lounge_wait(lounge *l, loop *served_by, struct MHD_Connection *connection, uint64_t seen,
                 const char *topic, int64_t until_ms)
{
    pthread_mutex_lock(&l->mutex);
    bool stays = !l->dismissed && seen == l->happened;
    if (stays) {
        guest *g = mem_alloc(sizeof *g);
        g->served_by = served_by;
        g->connection = connection;
        g->until_ms = until_ms;
        strncpy(g->topic, topic, sizeof g->topic - 1);
        g->next = l->first;
        l->first = g;
        MHD_suspend_connection(connection);
        if (!g->next) pthread_cond_broadcast(&l->changed);
    }
    pthread_mutex_unlock(&l->mutex);
    return stays;
}

void lounge_wake(lounge *l, const char *const *topics, size_t count)
{
    pthread_mutex_lock(&l->mutex);
    l->happened++;
    let_go(l, topics, count);
    pthread_mutex_unlock(&l->mutex);
}

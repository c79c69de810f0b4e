#include "http/peers.h"

#include <netinet/in.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>

#include "base/clock.h"
#include "base/memory.h"

/* How late the watch may notice an overdue connection. */
#define WATCH_MS 250
/* For those over a limit: time enough to be told so. */
#define REFUSED_MS 2000
#define NEVER INT64_MAX

typedef struct client_key {
    sa_family_t family;
    uint64_t number; /* user or address */
} client_key;

struct peer {
    int fd;
    client_key key;
    peer_standing standing;
    access_peer access;
    int64_t since_ms; /* the client's time runs since; NEVER: it does not */
    peer *previous, *next;
};

struct peers {
    peers_settings settings;
    access_control *access;
    pthread_t watch;
    pthread_mutex_t mutex;
    pthread_cond_t changed; /* monotonic clock */
    peer *first;
    unsigned count;
    bool stopping;
};

unsigned peers_room(const peers_settings *settings)
{
    return settings->connection_limit + settings->connection_limit / 2 + 16;
}

static client_key key_of(int fd, const access_peer *access)
{
    union {
        struct sockaddr any;
        struct sockaddr_in v4;
        struct sockaddr_in6 v6;
    } address = {0};
    socklen_t size = sizeof address;
    client_key key = {.family = AF_UNIX, .number = access->uid};
    if (access->local || getpeername(fd, &address.any, &size) != 0) return key;
    key.family = address.any.sa_family;
    if (key.family == AF_INET6)
        memcpy(&key.number, &address.v6.sin6_addr, sizeof key.number);
    else
        key.number = address.v4.sin_addr.s_addr;
    return key;
}

static unsigned count_of_client(const peers *p, const client_key *key)
{
    unsigned count = 0;
    for (const peer *other = p->first; other; other = other->next)
        count += other->key.family == key->family && other->key.number == key->number;
    return count;
}

peer *peers_add(peers *p, int fd)
{
    peer *new = mem_alloc(sizeof *new);
    new->fd = fd;
    access_look(p->access, fd, &new->access);
    new->key = key_of(fd, &new->access);
    pthread_mutex_lock(&p->mutex);
    unsigned of_client = count_of_client(p, &new->key), limit = p->settings.client_limit;
    if (of_client >= limit)
        new->standing = PEER_TOO_MANY_OF_CLIENT;
    else if (p->count >= p->settings.connection_limit)
        new->standing = PEER_TOO_MANY;
    if (of_client > limit + limit / 4 + 4) shutdown(fd, SHUT_RDWR);
    new->since_ms = clock_monotonic_ms();
    new->next = p->first;
    if (new->next) new->next->previous = new;
    p->first = new;
    p->count++;
    pthread_cond_broadcast(&p->changed);
    pthread_mutex_unlock(&p->mutex);
    return new;
}

void peers_remove(peers *p, peer *which)
{
    pthread_mutex_lock(&p->mutex);
    if (which->previous)
        which->previous->next = which->next;
    else
        p->first = which->next;
    if (which->next) which->next->previous = which->previous;
    p->count--;
    pthread_mutex_unlock(&p->mutex);
    free(which);
}

static void mark(peers *p, peer *which, int64_t since_ms)
{
    pthread_mutex_lock(&p->mutex);
    which->since_ms = since_ms;
    pthread_mutex_unlock(&p->mutex);
}

void peers_begin_time(peers *p, peer *which)
{
    mark(p, which, clock_monotonic_ms());
}

void peers_end_time(peers *p, peer *which)
{
    mark(p, which, NEVER);
}

peer_standing peers_standing(const peer *which)
{
    return which->standing;
}

const access_peer *peers_access(const peer *which)
{
    return &which->access;
}

static void wait_at_most(peers *p, int64_t ms)
{
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    until.tv_sec += ms / 1000;
    until.tv_nsec += ms % 1000 * 1000000;
    if (until.tv_nsec >= 1000000000) {
        until.tv_nsec -= 1000000000;
        until.tv_sec++;
    }
    pthread_cond_timedwait(&p->changed, &p->mutex, &until);
}

static void *watch(void *argument)
{
    peers *p = argument;
    int64_t limit_ms = (int64_t)(p->settings.timeout_s * 1000);
    int64_t refused_ms = limit_ms < REFUSED_MS ? limit_ms : REFUSED_MS;
    pthread_mutex_lock(&p->mutex);
    while (!p->stopping) {
        int64_t now = clock_monotonic_ms();
        for (peer *one = p->first; one; one = one->next) {
            int64_t limit = one->standing == PEER_WELCOME ? limit_ms : refused_ms;
            if (one->since_ms == NEVER || now - one->since_ms < limit) continue;
            shutdown(one->fd, SHUT_RDWR); /* the serving thread sees the end and cleans up */
            one->since_ms = NEVER;
        }
        if (p->first)
            wait_at_most(p, limit_ms < 4 * WATCH_MS ? limit_ms / 4 + 1 : WATCH_MS);
        else
            pthread_cond_wait(&p->changed, &p->mutex);
    }
    pthread_mutex_unlock(&p->mutex);
    return NULL;
}

static void peers_free(peers *p)
{
    pthread_cond_destroy(&p->changed);
    pthread_mutex_destroy(&p->mutex);
    free(p);
}

peers *peers_start(const peers_settings *settings, access_control *access, error *e)
{
    peers *p = mem_alloc(sizeof *p);
    p->settings = *settings;
    p->access = access;
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&p->changed, &monotonic);
    pthread_condattr_destroy(&monotonic);
    pthread_mutex_init(&p->mutex, NULL);
    int why = pthread_create(&p->watch, NULL, watch, p);
    if (why == 0) return p;
    error_set(e, ERROR_INTERNAL, "no thread for the server: %s", strerror(why));
    peers_free(p);
    return NULL;
}

void peers_stop(peers *p)
{
    if (!p) return;
    pthread_mutex_lock(&p->mutex);
    p->stopping = true;
    pthread_cond_broadcast(&p->changed);
    pthread_mutex_unlock(&p->mutex);
    pthread_join(p->watch, NULL);
    peers_free(p);
}

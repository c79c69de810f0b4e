#include "service/http/connections.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#include "files/scope.h"
#include "base/core/clock.h"
#include "base/core/memory.h"
#include "base/core/runner.h"

/* Maximum delay, in ms, until the watcher notices an overdue connection. */
#define WATCH_MS 250
/* Maximum time, in ms, in which a connection over a limit must send its first request. */
#define REFUSED_MS 2000
#define NEVER INT64_MAX

/* Size of the hash table of owners: the default of connection_limit. */
#define CHAINS 2048

typedef enum owner_kind { OWNER_USER, OWNER_UID, OWNER_NETWORK } owner_kind;

typedef struct owner_key {
    owner_kind kind;
    char bytes[ACCESS_USER_SIZE]; /* padded with zeros */
} owner_key;

/* A user, or a client whose user is unknown. It exists as long as a connection refers to it. */
typedef struct owner {
    owner_key key;
    unsigned count; /* number of its connections that have a place */
    unsigned names; /* number of connections that refer to it */
    struct owner *next;
} owner;

/* A list of connections that may be closed in favour of others, oldest first. */
typedef struct connection_queue {
    client_connection *first, *last;
    unsigned count;
} connection_queue;

struct client_connection {
    int fd;
    access_peer access;
    address from;
    owner *client, *user; /* user NULL: unknown */
    bool admin;
    connection_decision decision;
    bool placed; /* it is counted for its owner and in total */
    /* the client is to send something, and the watcher has not yet checked whether it has closed its side */
    bool must_check;
    bool leaving;     /* its descriptor was shut down; the serving thread notices the end and cleans up */
    int64_t since_ms; /* start of the client's time; NEVER: it does not run */
    client_connection *previous, *next;
    connection_queue *waits_in;         /* NULL: must not be closed */
    client_connection *older, *younger; /* neighbours in that queue */
};

struct connections {
    connections_settings settings;
    unsigned reserve;
    access_control *access;
    runner *tasks; /* the watcher only */
    runner_task *watcher;
    pthread_mutex_t mutex;
    client_connection *first;
    owner *chain[CHAINS];
    unsigned admins, others;   /* numbers of connections that have a place */
    connection_queue idle;     /* with a place, without a user, without a complete request */
    connection_queue unplaced; /* without a place, before their first request */
};

/* Maximum number of connections without a place. */
static unsigned most_unplaced(const connections_settings *settings)
{
    return settings->connection_limit / 4 + 8;
}

unsigned connections_capacity(const connections_settings *settings)
{
    return settings->connection_limit + 2 * most_unplaced(settings);
}

size_t connections_descriptors(const connections_settings *settings)
{
    return (size_t)connections_capacity(settings) + settings->connection_limit;
}

/* ---- owners */

static owner **chain_of(connections *p, const owner_key *key)
{
    uint32_t hash = 2166136261U + (uint32_t)key->kind; /* FNV-1a */
    for (size_t i = 0; i < sizeof key->bytes; i++) hash = (hash ^ (uint8_t)key->bytes[i]) * 16777619U;
    return &p->chain[hash % CHAINS];
}

static bool is_key(const owner *o, const owner_key *key)
{
    return o->key.kind == key->kind && memcmp(o->key.bytes, key->bytes, sizeof key->bytes) == 0;
}

static owner *name_owner(connections *p, const owner_key *key)
{
    owner **chain = chain_of(p, key), *o = *chain;
    while (o && !is_key(o, key)) o = o->next;
    if (!o) {
        o = mem_alloc(sizeof *o);
        o->key = *key;
        o->next = *chain;
        *chain = o;
    }
    o->names++;
    return o;
}

static void forget_owner(connections *p, owner *o)
{
    if (!o || --o->names) return;
    owner **at = chain_of(p, &o->key);
    while (*at != o) at = &(*at)->next;
    *at = o->next;
    free(o);
}

static owner_key key_of_client(const client_connection *which, const address *client)
{
    owner_key key = {.kind = OWNER_UID};
    if (!client->version) {
        memcpy(key.bytes, &which->access.uid, sizeof which->access.uid);
        return key;
    }
    key.kind = OWNER_NETWORK;
    key.bytes[0] = (char)client->version;
    memcpy(key.bytes + 1, client->bytes, client->version == 4 ? 4 : 8);
    return key;
}

static owner_key key_of_user(const char *user)
{
    owner_key key = {.kind = OWNER_USER};
    memcpy(key.bytes, user, strlen(user));
    return key;
}

/* ---- queues of connections that may be closed */

static void leave_queue(client_connection *which)
{
    connection_queue *q = which->waits_in;
    if (!q) return;
    *(which->older ? &which->older->younger : &q->first) = which->younger;
    *(which->younger ? &which->younger->older : &q->last) = which->older;
    which->older = which->younger = NULL;
    which->waits_in = NULL;
    q->count--;
}

static void join_queue(connection_queue *q, client_connection *which)
{
    leave_queue(which);
    which->older = q->last;
    *(q->last ? &q->last->younger : &q->first) = which;
    q->last = which;
    which->waits_in = q;
    q->count++;
}

/* ---- places */

static void take_place(connections *p, client_connection *which)
{
    (which->user ? which->user : which->client)->count++;
    *(which->admin ? &p->admins : &p->others) += 1;
    which->placed = true;
}

static void give_place_back(connections *p, client_connection *which)
{
    if (!which->placed) return;
    (which->user ? which->user : which->client)->count--;
    *(which->admin ? &p->admins : &p->others) -= 1;
    which->placed = false;
}

static void end(connections *p, client_connection *which)
{
    leave_queue(which);
    give_place_back(p, which);
    which->leaving = true;
    which->since_ms = NEVER;
    shutdown(which->fd, SHUT_RDWR);
}

/* Closes the connection of the client (NULL: of any client) that has been idle longest. False: there is none. */
static bool end_idle(connections *p, const owner *client)
{
    client_connection *one = p->idle.first;
    while (one && client && one->client != client) one = one->younger;
    if (one) end(p, one);
    return one != NULL;
}

static bool has_place(const connections *p, bool admin)
{
    unsigned limit = p->settings.connection_limit;
    return p->admins + p->others < limit && (admin || p->others < limit - p->reserve);
}

/* Gives a connection a place if the limits permit it. */
static connection_decision place(connections *p, client_connection *which)
{
    if (which->user && which->user->count >= p->settings.user_limit) return CONNECTION_TOO_MANY_OF_USER;
    if (!which->user && which->client->count >= p->settings.client_limit && !end_idle(p, which->client))
        return CONNECTION_TOO_MANY_OF_CLIENT;
    if (!has_place(p, which->admin) && !end_idle(p, NULL)) return CONNECTION_TOO_MANY;
    take_place(p, which);
    return CONNECTION_ADMITTED;
}

/* Marks the connection as waiting for a request. */
static void await_request(connections *p, client_connection *which)
{
    which->since_ms = clock_monotonic_ms();
    which->must_check = true;
    if (which->leaving)
        which->since_ms = NEVER;
    else if (!which->placed)
        join_queue(&p->unplaced, which);
    else if (!which->user)
        join_queue(&p->idle, which);
}

client_connection *connections_add(connections *p, int fd)
{
    client_connection *new = mem_alloc(sizeof *new);
    new->fd = fd;
    access_look(p->access, fd, &new->access);
    if (!new->access.local) new->from = address_of_peer(fd);
    owner_key client = key_of_client(new, &new->from), user = key_of_user(new->access.user);
    pthread_mutex_lock(&p->mutex);
    new->client = name_owner(p, &client);
    if (new->access.local &&new->access.scopes) new->user = name_owner(p, &user);
    new->admin = new->user &&new->access.scopes &SCOPE_ADMIN;
    new->decision = place(p, new);
    await_request(p, new);
    if (p->unplaced.count > most_unplaced(&p->settings)) end(p, p->unplaced.first);
    new->next = p->first;
    if (new->next) new->next->previous = new;
    p->first = new;
    if (!new->next) runner_wake(p->watcher); /* otherwise it wakes in time */
    pthread_mutex_unlock(&p->mutex);
    return new;
}

void connections_remove(connections *p, client_connection *which)
{
    pthread_mutex_lock(&p->mutex);
    if (which->previous)
        which->previous->next = which->next;
    else
        p->first = which->next;
    if (which->next) which->next->previous = which->previous;
    leave_queue(which);
    give_place_back(p, which);
    forget_owner(p, which->client);
    forget_owner(p, which->user);
    pthread_mutex_unlock(&p->mutex);
    free(which);
}

/* Whether the connection still belongs to the same client and user. */
static bool is_owned_by(const client_connection *which, const owner_key *client, const owner_key *user,
                        bool admin)
{
    bool same_user = user ? which->user && is_key(which->user, user) : !which->user;
    return same_user && which->admin == admin && is_key(which->client, client);
}

connection_decision connections_begin_request(connections *p, client_connection *which, const address *client,
                                              const access_caller *caller)
{
    owner_key of_client = key_of_client(which, client), of_user = key_of_user(caller ? caller->user : "");
    bool admin = caller && caller->scopes & SCOPE_ADMIN;
    pthread_mutex_lock(&p->mutex);
    leave_queue(which);
    bool same = is_owned_by(which, &of_client, caller ? &of_user : NULL, admin);
    if (!same) {
        owner *old_client = which->client, *old_user = which->user;
        give_place_back(p, which);
        which->client = name_owner(p, &of_client);
        which->user = caller ? name_owner(p, &of_user) : NULL;
        which->admin = admin;
        forget_owner(p, old_client);
        forget_owner(p, old_user);
    }
    if (!which->placed && !which->leaving) which->decision = place(p, which);
    connection_decision decision = which->decision;
    pthread_mutex_unlock(&p->mutex);
    return decision;
}

void connections_end_request(connections *p, client_connection *which)
{
    pthread_mutex_lock(&p->mutex);
    await_request(p, which);
    pthread_mutex_unlock(&p->mutex);
}

void connections_await_body(connections *p, client_connection *which)
{
    pthread_mutex_lock(&p->mutex);
    if (which->placed && !which->user) join_queue(&p->idle, which);
    pthread_mutex_unlock(&p->mutex);
}

static void mark(connections *p, client_connection *which, int64_t since_ms)
{
    pthread_mutex_lock(&p->mutex);
    if (since_ms == NEVER) leave_queue(which);
    which->since_ms = which->leaving ? NEVER : since_ms;
    which->must_check = since_ms != NEVER;
    pthread_mutex_unlock(&p->mutex);
}

void connections_begin_time(connections *p, client_connection *which)
{
    mark(p, which, clock_monotonic_ms());
}

void connections_end_time(connections *p, client_connection *which)
{
    mark(p, which, NEVER);
}

const access_peer *connections_access(const client_connection *which)
{
    return &which->access;
}

const address *connections_address(const client_connection *which)
{
    return &which->from;
}

/* Whether the client has closed its side, after some time in which it was to send something. The library (0.9.75) may
 * miss an end that arrived with the last bytes. */
static bool has_ended(client_connection *which)
{
    char byte;
    bool must_check = which->must_check;
    which->must_check = false;
    return must_check && recv(which->fd, &byte, 1, MSG_PEEK | MSG_DONTWAIT) == 0;
}

static int64_t close_overdue(void *context)
{
    connections *p = context;
    int64_t limit_ms = (int64_t)(p->settings.timeout_s * 1000);
    int64_t refused_ms = limit_ms < REFUSED_MS ? limit_ms : REFUSED_MS;
    pthread_mutex_lock(&p->mutex);
    int64_t now = clock_monotonic_ms();
    for (client_connection *one = p->first; one; one = one->next) {
        int64_t passed_ms = one->since_ms == NEVER ? -1 : now - one->since_ms;
        if (passed_ms >= (one->placed ? limit_ms : refused_ms) || (passed_ms >= WATCH_MS && has_ended(one)))
            end(p, one);
    }
    const bool any = p->first;
    pthread_mutex_unlock(&p->mutex);
    if (!any) return RUNNER_WHEN_WOKEN;
    return now + (limit_ms < 4 * WATCH_MS ? limit_ms / 4 + 1 : WATCH_MS);
}

connections *connections_start(const connections_settings *settings, access_control *access, error *e)
{
    connections *p = mem_alloc(sizeof *p);
    p->settings = *settings;
    unsigned half = settings->connection_limit / 2;
    p->reserve = settings->admin_reserve < half ? settings->admin_reserve : half;
    p->access = access;
    pthread_mutex_init(&p->mutex, NULL);
    p->tasks = runner_new();
    p->watcher = runner_add(p->tasks, "connections", close_overdue, p);
    if (runner_start(p->tasks, e)) return p;
    connections_stop(p);
    return NULL;
}

void connections_stop(connections *p)
{
    if (!p) return;
    runner_stop(p->tasks);
    runner_free(p->tasks);
    pthread_mutex_destroy(&p->mutex);
    free(p);
}

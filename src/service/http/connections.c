// SPDX-License-Identifier: Apache-2.0
#include "service/http/connections.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/queue.h>
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

/* Connections that may be closed in favour of others, oldest first. */
typedef struct connection_queue {
    TAILQ_HEAD(, client_connection) list;
    unsigned count;
} connection_queue;

struct client_connection {
    int fd;
    access_peer access;
    address from;
    ledger_resource kind;           /* LEDGER_CONNECTIONS: it belongs to a user */
    char owner[LEDGER_HOLDER_SIZE]; /* the user or the client to which it belongs */
    bool admin;
    ledger_decision decision;
    bool placed; /* it is counted for its owner and in total */
    /* the client is to send something, and the watcher has not yet checked whether it has closed its side */
    bool must_check;
    bool leaving;     /* its descriptor was shut down; the serving thread notices the end and cleans up */
    int64_t since_ms; /* start of the client's time; NEVER: it does not run */
    LIST_ENTRY(client_connection) link;
    connection_queue *waits_in;           /* NULL: must not be closed */
    TAILQ_ENTRY(client_connection) place; /* in that queue */
};

struct connections {
    connections_settings settings;
    unsigned reserve;
    ledger *counts;
    access_control *access;
    runner *tasks; /* the watcher only */
    runner_task *watcher;
    pthread_mutex_t mutex;
    LIST_HEAD(, client_connection) all;
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

static bool has_user(const client_connection *which)
{
    return which->kind == LEDGER_CONNECTIONS;
}

void connections_name_client(const client_connection *which, const address *client,
                             char holder[LEDGER_HOLDER_SIZE])
{
    char text[ADDRESS_TEXT_SIZE];
    address network = *client;
    if (client->version == 6) memset(network.bytes + 8, 0, 8);
    if (client->version)
        snprintf(holder, LEDGER_HOLDER_SIZE, "client %s%s", address_print(&network, text),
                 client->version == 6 ? "/64" : "");
    else
        snprintf(holder, LEDGER_HOLDER_SIZE, "client %u", (unsigned)which->access.uid);
}

/* Sets the owner: the user (NULL: unknown), or the client. */
static void set_owner(client_connection *which, const address *client, const char *user, unsigned scopes)
{
    which->kind = user ? LEDGER_CONNECTIONS : LEDGER_CLIENT_CONNECTIONS;
    which->admin = user && scopes & SCOPE_ADMIN;
    if (user)
        snprintf(which->owner, sizeof which->owner, "%s", user);
    else
        connections_name_client(which, client, which->owner);
}

/* ---- queues of connections that may be closed */

static void leave_queue(client_connection *which)
{
    connection_queue *q = which->waits_in;
    if (!q) return;
    TAILQ_REMOVE(&q->list, which, place);
    which->waits_in = NULL;
    q->count--;
}

static void join_queue(connection_queue *q, client_connection *which)
{
    leave_queue(which);
    TAILQ_INSERT_TAIL(&q->list, which, place);
    which->waits_in = q;
    q->count++;
}

/* ---- places */

static void give_place_back(connections *p, client_connection *which)
{
    if (!which->placed) return;
    ledger_give_back(p->counts, which->kind, which->owner, 1);
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

/* Closes the connection of the client (NULL: of any client) that has been idle longest. False: there is
 * none. */
static bool end_idle(connections *p, const char *client)
{
    client_connection *one = TAILQ_FIRST(&p->idle.list);
    while (one && client && strcmp(one->owner, client) != 0) one = TAILQ_NEXT(one, place);
    if (one) end(p, one);
    return one != NULL;
}

static bool has_place(const connections *p, bool admin)
{
    unsigned limit = p->settings.connection_limit;
    return p->admins + p->others < limit && (admin || p->others < limit - p->reserve);
}

/* Gives a connection a place if the limits permit it. */
static ledger_decision place(connections *p, client_connection *which)
{
    ledger_decision decision = ledger_check(p->counts, which->kind, which->owner, 1);
    if (decision == LEDGER_HOLDER_FULL && (has_user(which) || !end_idle(p, which->owner))) return decision;
    if (!has_place(p, which->admin) && !end_idle(p, NULL)) return LEDGER_ALL_FULL;
    ledger_take(p->counts, which->kind, which->owner, 1);
    *(which->admin ? &p->admins : &p->others) += 1;
    which->placed = true;
    return LEDGER_FITS;
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
    else if (!has_user(which))
        join_queue(&p->idle, which);
}

client_connection *connections_add(connections *p, int fd)
{
    client_connection *added = mem_alloc(sizeof *added);
    added->fd = fd;
    access_look(p->access, fd, &added->access);
    if (!added->access.local) added->from = address_of_peer(fd);
    bool is_known = added->access.local && added->access.scopes;
    set_owner(added, &added->from, is_known ? added->access.user : NULL, added->access.scopes);
    pthread_mutex_lock(&p->mutex);
    added->decision = place(p, added);
    await_request(p, added);
    if (p->unplaced.count > most_unplaced(&p->settings)) end(p, TAILQ_FIRST(&p->unplaced.list));
    LIST_INSERT_HEAD(&p->all, added, link);
    if (!LIST_NEXT(added, link)) runner_wake(p->watcher); /* otherwise it wakes in time */
    pthread_mutex_unlock(&p->mutex);
    return added;
}

void connections_remove(connections *p, client_connection *which)
{
    pthread_mutex_lock(&p->mutex);
    LIST_REMOVE(which, link);
    leave_queue(which);
    give_place_back(p, which);
    pthread_mutex_unlock(&p->mutex);
    free(which);
}

bool connections_begin_request(connections *p, client_connection *which, const address *client,
                               const access_caller *caller, ledger_refusal *why)
{
    client_connection now = {.access = which->access};
    set_owner(&now, client, caller ? caller->user : NULL, caller ? caller->scopes : 0);
    pthread_mutex_lock(&p->mutex);
    leave_queue(which);
    if (now.kind != which->kind || now.admin != which->admin || strcmp(now.owner, which->owner) != 0) {
        give_place_back(p, which);
        which->kind = now.kind;
        which->admin = now.admin;
        memcpy(which->owner, now.owner, sizeof which->owner);
    }
    if (!which->placed && !which->leaving) which->decision = place(p, which);
    ledger_decision decision = which->decision;
    pthread_mutex_unlock(&p->mutex);
    if (decision != LEDGER_FITS)
        *why = ledger_explain(p->counts, decision == LEDGER_ALL_FULL ? LEDGER_CONNECTIONS : now.kind,
                              decision, now.owner);
    return decision == LEDGER_FITS;
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
    if (which->placed && !has_user(which)) join_queue(&p->idle, which);
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

/* Whether the client has closed its side, after some time in which it was to send something. The library
 * (0.9.75) may miss an end that arrived with the last bytes. */
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
    client_connection *one;
    LIST_FOREACH (one, &p->all, link) {
        int64_t passed_ms = one->since_ms == NEVER ? -1 : now - one->since_ms;
        if (passed_ms >= (one->placed ? limit_ms : refused_ms) || (passed_ms >= WATCH_MS && has_ended(one)))
            end(p, one);
    }
    const bool any = !LIST_EMPTY(&p->all);
    pthread_mutex_unlock(&p->mutex);
    if (!any) return RUNNER_WHEN_WOKEN;
    return now + (limit_ms < 4 * WATCH_MS ? limit_ms / 4 + 1 : WATCH_MS);
}

connections *connections_start(const connections_settings *settings, ledger *counts, access_control *access,
                               error *e)
{
    connections *p = mem_alloc(sizeof *p);
    TAILQ_INIT(&p->idle.list);
    TAILQ_INIT(&p->unplaced.list);
    p->counts = counts;
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

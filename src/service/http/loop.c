// SPDX-License-Identifier: Apache-2.0
#include "service/http/loop.h"

#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <microhttpd.h>

#include "base/core/background.h"
#include "base/core/clock.h"
#include "base/core/descriptor_wait.h"
#include "base/core/log.h"
#include "base/core/memory.h"

struct loop {
    struct MHD_Daemon *daemon;
    unsigned capacity; /* of the daemon, in connections */
    pthread_t thread;
    int signal;           /* an eventfd */
    atomic_bool signaled; /* the signal is set, and the loop has not read it yet */
    atomic_bool quiescing, stopping;
    atomic_uint_fast64_t turns;
    struct pollfd *on;         /* the library's set, the signal, then the listening sockets */
    size_t listening;          /* number of listening sockets */
    int64_t paused_until_ms;   /* no connections are accepted before this time; 0: no pause */
    unsigned paused_at;        /* number of connections when the pause began */
    int64_t shortage_ms;       /* time at which the last pause began; 0: there was none */
    int64_t shortage_noted_ms; /* time of the last log line about a shortage; 0: none */
};

/* Indices in loop.on. */
enum { ON_READY, ON_SIGNAL, ON_LISTENING };
enum {
    PAUSE_MS = 100,          /* longest pause after a connection that could not be accepted */
    TURN_MS = 1000,          /* maximum duration of a wait */
    ACCEPTED_A_TURN = 16,    /* maximum number of connections that a socket gets in a turn */
    SHORTAGE_MS = 10000,     /* after this time without a pause, a shortage has ended */
    SHORTAGE_NOTE_MS = 60000 /* minimum time between two log lines about a shortage */
};

void loop_wake(loop *l)
{
    if (!atomic_exchange(&l->signaled, true)) eventfd_write(l->signal, 1);
}

/* Called before the library runs, so that a later wake-up is a new signal. */
static void take_signal(loop *l)
{
    eventfd_t count;
    descriptor_take_event(l->signal, &count, sizeof count);
    atomic_store(&l->signaled, false);
}

/* Milliseconds until the library must run although no descriptor is ready, at most TURN_MS. 0 if the library
 * has more work for a connection that will not become ready again. */
static int wait_ms(const loop *l)
{
    MHD_UNSIGNED_LONG_LONG ms;
    return MHD_get_timeout(l->daemon, &ms) == MHD_YES && ms < TURN_MS ? (int)ms : TURN_MS;
}

static unsigned count_connections(const loop *l)
{
    return MHD_get_daemon_info(l->daemon, MHD_DAEMON_INFO_CURRENT_CONNECTIONS)->num_connections;
}

static bool may_accept(const loop *l)
{
    return !l->paused_until_ms && count_connections(l) < l->capacity;
}

/* Returns the duration of the rest of the pause in ms, 0 if there is none. It ends after its time, and when a
 * connection has ended, which gives back a descriptor. */
static int pause_ms(loop *l)
{
    const int64_t left_ms = l->paused_until_ms - clock_monotonic_ms();
    if (left_ms <= 0 || count_connections(l) < l->paused_at) l->paused_until_ms = 0;
    return l->paused_until_ms ? (int)left_ms : 0;
}

/* Waits until a descriptor is ready. */
static void wait_ready(loop *l)
{
    const int longest_ms = wait_ms(l), left_ms = pause_ms(l);
    const size_t count = ON_LISTENING + l->listening;
    for (size_t k = ON_LISTENING; k < count; k++) l->on[k].revents = 0;
    descriptor_wait(l->on, may_accept(l) ? count : ON_LISTENING,
                    left_ms && left_ms < longest_ms ? left_ms : longest_ms);
}

/* What was lacking, and what to do; the caller frees the text. */
static char *describe_shortage(int fault)
{
    struct rlimit files = {0};
    switch (fault) {
    case EMFILE:
        getrlimit(RLIMIT_NOFILE, &files);
        return mem_printf("the service has reached its limit of %llu open files (RLIMIT_NOFILE): raise "
                          "LimitNOFILE= of its unit or `ulimit -n`, or lower connection_limit",
                          (unsigned long long)files.rlim_cur);
    case ENFILE:
        return mem_strdup("the system has reached its limit of open files (fs.file-max): raise it with "
                          "sysctl, or end programs that have many files open");
    case ENOSPC:
        return mem_strdup("the user of the service has reached the limit of watched descriptors "
                          "(fs.epoll.max_user_watches): raise it with sysctl");
    default:
        return mem_printf(
            "the system has no memory for it (%s): free memory of the system, or of the control "
            "group of the service (MemoryMax=)",
            strerror(fault));
    }
}

static void note_shortage(loop *l, int fault)
{
    const int64_t now = clock_monotonic_ms();
    if (l->shortage_noted_ms && now - l->shortage_noted_ms < SHORTAGE_NOTE_MS) return;
    l->shortage_noted_ms = now;
    char *text = describe_shortage(fault);
    log_write(LOG_LEVEL_WARNING, "no further connection can be accepted: %s", text);
    free(text);
}

/* Stops watching the listening sockets for a moment; otherwise the loop would use a CPU. */
static void pause_accepting(loop *l, int fault)
{
    l->shortage_ms = clock_monotonic_ms();
    l->paused_until_ms = l->shortage_ms + PAUSE_MS;
    l->paused_at = count_connections(l);
    note_shortage(l, fault);
}

/* Whether the client has closed its side already. The library (0.9.75) misses an end that has arrived with
 * the last bytes, and would keep the connection. */
static bool has_left(int fd)
{
    struct pollfd one = {.fd = fd, .events = POLLRDHUP};
    return poll(&one, 1, 0) > 0;
}

/* Whether a connection could not be accepted a short time ago. */
static bool is_short(const loop *l)
{
    return l->shortage_ms && clock_monotonic_ms() - l->shortage_ms < SHORTAGE_MS;
}

/* Accepts a connection. After a shortage, many clients have left while they waited: their connections are
 * closed at once. False: there is no connection, or none can be accepted. */
static bool accept_one(loop *l, int listening)
{
    struct sockaddr_storage from;
    socklen_t size = sizeof from;
    int fd = accept4(listening, (struct sockaddr *)&from, &size, SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (fd < 0) {
        /* other errors are those of one connection, which has failed before it was accepted (accept(2)) */
        if (errno == EMFILE || errno == ENFILE || errno == ENOBUFS || errno == ENOMEM)
            pause_accepting(l, errno);
        return false;
    }
    if (is_short(l) && has_left(fd)) {
        close(fd);
        return true;
    }
    /* also closes it on failure */
    if (MHD_add_connection(l->daemon, fd, (struct sockaddr *)&from, size) == MHD_YES) return true;
    pause_accepting(l, errno);
    return false;
}

static void accept_ready(loop *l)
{
    for (size_t k = ON_LISTENING; k < ON_LISTENING + l->listening; k++)
        for (int i = 0; i < ACCEPTED_A_TURN && l->on[k].revents && may_accept(l); i++)
            if (!accept_one(l, l->on[k].fd)) break;
}

static void close_listening(loop *l)
{
    for (size_t k = ON_LISTENING; k < ON_LISTENING + l->listening; k++) close(l->on[k].fd);
    l->listening = 0;
}

static void *serve(void *argument)
{
    loop *l = argument;
    pthread_setname_np(pthread_self(), "serving"); /* helps to debug a process that hangs */
    while (!atomic_load(&l->stopping)) {
        wait_ready(l);
        atomic_fetch_add(&l->turns, 1);
        if (l->on[ON_SIGNAL].revents) take_signal(l);
        if (atomic_load(&l->quiescing)) close_listening(l);
        accept_ready(l);
        MHD_run_wait(l->daemon, 0);
    }
    return NULL;
}

bool loop_start(struct MHD_Daemon *daemon, const int *listening, size_t count, unsigned capacity, loop **made,
                error *e)
{
    loop *l = mem_alloc(sizeof *l);
    l->daemon = daemon;
    l->capacity = capacity;
    l->signal = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    l->on = mem_alloc((ON_LISTENING + count) * sizeof *l->on);
    l->on[ON_READY].fd = MHD_get_daemon_info(daemon, MHD_DAEMON_INFO_EPOLL_FD)->epoll_fd;
    l->on[ON_SIGNAL].fd = l->signal;
    for (size_t k = 0; k < count; k++) l->on[ON_LISTENING + k].fd = listening[k];
    for (size_t k = 0; k < ON_LISTENING + count; k++) l->on[k].events = POLLIN;
    l->listening = count;
    *made = l;
    if (l->signal < 0)
        error_set(e, ERROR_INTERNAL, "the server cannot make an eventfd: %s", strerror(errno));
    else if (background_start(&l->thread, serve, l, "the server", e))
        return true;
    *made = NULL;
    if (l->signal >= 0) close(l->signal);
    free(l->on);
    free(l);
    return false;
}

uint64_t loop_turns(const loop *l)
{
    return atomic_load(&l->turns);
}

void loop_resume(loop *l, struct MHD_Connection *connection)
{
    MHD_resume_connection(connection);
    loop_wake(l);
}

void loop_quiesce(loop *l)
{
    atomic_store(&l->quiescing, true);
    loop_wake(l);
}

void loop_end(loop *l)
{
    if (!l || atomic_exchange(&l->stopping, true)) return;
    loop_wake(l);
    pthread_join(l->thread, NULL);
}

void loop_stop(loop *l)
{
    if (!l) return;
    loop_end(l);
    MHD_stop_daemon(l->daemon);
    close_listening(l);
    close(l->signal);
    free(l->on);
    free(l);
}

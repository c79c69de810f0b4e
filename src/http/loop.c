#include "http/loop.h"

#include <errno.h>
#include <limits.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <microhttpd.h>

#include "base/background.h"
#include "base/descriptor_wait.h"
#include "base/memory.h"

struct loop {
    struct MHD_Daemon *daemon;
    pthread_t thread;
    int ready;            /* the library's epoll descriptor */
    int signal;           /* an eventfd */
    atomic_bool signaled; /* and the loop has not read it yet */
    atomic_bool quiescing, stopping;
    int listening; /* the listening socket after the library has released it; -1: before */
};

static void wake(loop *l)
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

/* Milliseconds until the library must run although no descriptor is ready; -1: unlimited. 0 if the library has more
 * work for a connection that will not become ready again. */
static int wait_ms(const loop *l)
{
    MHD_UNSIGNED_LONG_LONG ms;
    if (MHD_get_timeout(l->daemon, &ms) != MHD_YES) return -1;
    return ms < INT_MAX ? (int)ms : INT_MAX;
}

static void *serve(void *argument)
{
    loop *l = argument;
    struct pollfd on[] = {{.fd = l->ready, .events = POLLIN}, {.fd = l->signal, .events = POLLIN}};
    while (!atomic_load(&l->stopping)) {
        descriptor_wait(on, 2, wait_ms(l));
        if (on[1].revents) take_signal(l);
        if (l->listening < 0 && atomic_load(&l->quiescing)) l->listening = MHD_quiesce_daemon(l->daemon);
        MHD_run_wait(l->daemon, 0);
    }
    return NULL;
}

bool loop_start(struct MHD_Daemon *daemon, loop **made, error *e)
{
    loop *l = mem_alloc(sizeof *l);
    l->daemon = daemon;
    l->ready = MHD_get_daemon_info(daemon, MHD_DAEMON_INFO_EPOLL_FD)->epoll_fd;
    l->listening = -1;
    l->signal = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    *made = l;
    if (l->signal < 0)
        error_set(e, ERROR_INTERNAL, "the server cannot make an eventfd: %s", strerror(errno));
    else if (background_start(&l->thread, serve, l, "the server", e))
        return true;
    *made = NULL;
    if (l->signal >= 0) close(l->signal);
    free(l);
    return false;
}

void loop_resume(loop *l, struct MHD_Connection *connection)
{
    MHD_resume_connection(connection);
    wake(l);
}

void loop_quiesce(loop *l)
{
    atomic_store(&l->quiescing, true);
    wake(l);
}

void loop_end(loop *l)
{
    if (!l || atomic_exchange(&l->stopping, true)) return;
    wake(l);
    pthread_join(l->thread, NULL);
}

void loop_stop(loop *l)
{
    if (!l) return;
    loop_end(l);
    MHD_stop_daemon(l->daemon);
    if (l->listening >= 0) close(l->listening);
    close(l->signal);
    free(l);
}

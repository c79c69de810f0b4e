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
#include <sys/socket.h>
#include <unistd.h>

#include <microhttpd.h>

#include "base/background.h"
#include "base/descriptor_wait.h"
#include "base/memory.h"

struct loop {
    struct MHD_Daemon *daemon;
    pthread_t thread;
    int signal;           /* an eventfd */
    atomic_bool signaled; /* and the loop has not read it yet */
    atomic_bool quiescing, stopping;
    int listening;     /* the listening socket, after the library has given it up; -1: before */
    struct pollfd *on; /* the library's set, the signal, then the `more` other listening sockets */
    size_t more;
    bool exhausted; /* the process or the system has no more descriptors */
};

/* Indices in loop.on. */
enum { ON_READY, ON_SIGNAL, ON_MORE };
/* Milliseconds until connections are accepted again after descriptors have run out. */
enum { EXHAUSTED_MS = 100 };

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

/* Accepts a connection at each of the other sockets that is ready. */
static void accept_more(loop *l)
{
    for (size_t k = 0; k < l->more; k++) {
        struct sockaddr_storage from;
        socklen_t size = sizeof from;
        if (!l->on[ON_MORE + k].revents) continue;
        int fd =
            accept4(l->on[ON_MORE + k].fd, (struct sockaddr *)&from, &size, SOCK_CLOEXEC | SOCK_NONBLOCK);
        if (fd >= 0) /* also closes it on failure */
            MHD_add_connection(l->daemon, fd, (struct sockaddr *)&from, size);
        else if (errno == EMFILE || errno == ENFILE || errno == ENOBUFS || errno == ENOMEM)
            l->exhausted = true;
    }
}

/* Waits until a descriptor is ready. */
static void wait_ready(loop *l)
{
    const int ms = wait_ms(l);
    for (size_t k = 0; k < l->more; k++) l->on[ON_MORE + k].revents = 0;
    if (l->exhausted)
        descriptor_wait(l->on, ON_MORE, ms >= 0 && ms < EXHAUSTED_MS ? ms : EXHAUSTED_MS);
    else
        descriptor_wait(l->on, ON_MORE + l->more, ms);
    l->exhausted = false;
}

static void quiesce(loop *l)
{
    l->listening = MHD_quiesce_daemon(l->daemon);
    for (size_t k = 0; k < l->more; k++) close(l->on[ON_MORE + k].fd);
    l->more = 0;
}

static void *serve(void *argument)
{
    loop *l = argument;
    while (!atomic_load(&l->stopping)) {
        wait_ready(l);
        if (l->on[ON_SIGNAL].revents) take_signal(l);
        accept_more(l);
        if (l->listening < 0 && atomic_load(&l->quiescing)) quiesce(l);
        MHD_run_wait(l->daemon, 0);
    }
    return NULL;
}

bool loop_start(struct MHD_Daemon *daemon, const int *more, size_t count, loop **made, error *e)
{
    loop *l = mem_alloc(sizeof *l);
    l->daemon = daemon;
    l->listening = -1;
    l->signal = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    l->on = mem_alloc((ON_MORE + count) * sizeof *l->on);
    l->on[ON_READY].fd = MHD_get_daemon_info(daemon, MHD_DAEMON_INFO_EPOLL_FD)->epoll_fd;
    l->on[ON_SIGNAL].fd = l->signal;
    for (size_t k = 0; k < count; k++) l->on[ON_MORE + k].fd = more[k];
    for (size_t k = 0; k < ON_MORE + count; k++) l->on[k].events = POLLIN;
    l->more = count;
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
    for (size_t k = 0; k < l->more; k++) close(l->on[ON_MORE + k].fd);
    close(l->signal);
    free(l->on);
    free(l);
}

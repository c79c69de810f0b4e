// SPDX-License-Identifier: Apache-2.0
#include "service/slurm/node.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/descriptor_wait.h"
#include "base/core/memory.h"
#include "service/executor/host.h"
#include "service/executor/local.h"
#include "files/file.h"

/* Interval, in ms, between two checks for a cancellation, and between two writes of progress, which other
 * hosts read over the network. */
#define LOOK_MS 500
/* Number of tries, one per second, to write an ending. Without the ending the attempt is lost. */
#define ENDING_TRIES 30

typedef struct run {
    const char *directory;
    engine_attempt *attempt;
    int signals;
    bool stopped, cancelled; /* by a signal; by a signal or by the service */
    int64_t force_ms;        /* time at which the worker is killed */
    char *progress;          /* lines that are not written yet */
    size_t progress_length;
} run;

static void add_line(run *r, const char *line)
{
    size_t length = strlen(line);
    r->progress = mem_resize(r->progress, r->progress_length + length + 2);
    memcpy(r->progress + r->progress_length, line, length);
    r->progress_length += length;
    r->progress[r->progress_length++] = '\n';
    r->progress[r->progress_length] = '\0';
}

/* Lines that cannot be written are dropped: the ending contains all results. */
static void write_lines(run *r)
{
    if (r->progress_length) attempt_files_add_progress(r->directory, r->progress);
    r->progress_length = 0;
}

static void take_signals(run *r)
{
    struct signalfd_siginfo info;
    while (descriptor_take_event(r->signals, &info, sizeof info)) r->stopped = true;
}

static void stop_if_asked(run *r)
{
    int64_t now = clock_monotonic_ms();
    take_signals(r);
    bool asked = r->stopped || attempt_files_is_cancelled(r->directory);
    if (asked && !r->cancelled) {
        engine_local.cancel(r->attempt, false);
        r->cancelled = true;
        r->force_ms = now + NODE_GRACE_S * 1000;
    }
    if (r->cancelled && now >= r->force_ms) engine_local.cancel(r->attempt, true);
}

static void wait_for_end(run *r)
{
    const char *line;
    int64_t look_ms = 0;
    while (!engine_local.poll(r->attempt, &line)) {
        if (line) add_line(r, line);
        int64_t now = clock_monotonic_ms();
        if (now >= look_ms) {
            write_lines(r);
            stop_if_asked(r);
            look_ms = now + LOOK_MS;
        }
        struct pollfd fds[1 + ENGINE_MAX_FDS] = {{.fd = r->signals, .events = POLLIN}};
        size_t count = 1 + engine_local.watch(r->attempt, fds + 1);
        descriptor_wait(fds, count, (int)(look_ms - now));
        if (fds[0].revents) look_ms = 0;
    }
    if (line) add_line(r, line);
    write_lines(r);
    take_signals(r); /* Slurm signals the worker, too */
}

static bool tell_ending(const run *r, const engine_ending *ending, error *e)
{
    for (int i = 0; i < ENDING_TRIES; i++) {
        if (attempt_files_write_ending(r->directory, ending, e)) return true;
        if (!attempt_files_exist(r->directory)) return true; /* the service has abandoned it */
        poll(NULL, 0, 1000);
    }
    return false;
}

static bool run_attempt(const char *directory, int signals, bool *stopped, error *e)
{
    engine_request request = {0};
    engine_ending ending = {0};
    run r = {.directory = directory, .signals = signals};
    if (!attempt_files_read_request(directory, &request, e)) return false;
    int64_t began_ms = clock_monotonic_ms();
    r.attempt = engine_local.start(NULL, &request, e);
    attempt_files_clear_request(&request);
    if (!r.attempt) return false;
    add_line(&r, "{\"phase\":\"load\",\"fraction\":0}"); /* shows that the attempt has begun */
    wait_for_end(&r);
    engine_local.settle(r.attempt, &ending);
    ending.ran_ms = clock_monotonic_ms() - began_ms + 1;
    host_name(ending.host, sizeof ending.host);
    bool ok = tell_ending(&r, &ending, e);
    free(ending.last_words);
    free(r.progress);
    *stopped = r.stopped;
    return ok;
}

static bool is_restart(void)
{
    const char *count = getenv("SLURM_RESTART_COUNT");
    return count && atoi(count) > 0;
}

/* If Slurm has requeued this task and the task had claimed the attempt before, records it: the service may
 * not have seen the task wait. */
static bool note_restart(const char *directory, const attempt_files_batch *self, error *e)
{
    attempt_files_batch by;
    return !is_restart() || !attempt_files_read_claim(directory, &by) || by.task != self->task ||
           strcmp(by.name, self->name) != 0 || attempt_files_note_requeue(directory, e);
}

typedef struct node {
    const char *farm;
    attempt_files_batch self;
    int64_t end_ms; /* attempts of other tasks are taken until then */
    int signals;
    bool stopped;
} node;

static bool take_and_run(node *n, const char *name, error *e)
{
    char *directory = mem_printf("%s/%s", n->farm, name);
    attempt_files_claim claim = attempt_files_take(directory, &n->self);
    bool ok = true;
    if (claim == ATTEMPT_FILES_UNCLEAR || access(n->farm, F_OK) != 0) {
        ok = error_set(e, ERROR_INTERNAL, "this node cannot write %s: mount work_dir", directory);
    } else if (claim == ATTEMPT_FILES_WON) {
        ok = run_attempt(directory, n->signals, &n->stopped, e);
        n->self.number++;
    } else if (claim == ATTEMPT_FILES_TAKEN) {
        ok = note_restart(directory, &n->self, e);
    }
    free(directory);
    return ok;
}

static bool may_take_more(const node *n)
{
    return !n->stopped && clock_monotonic_ms() < n->end_ms;
}

/* Runs attempts of the list, beginning with index `first` and continuing cyclically. The first `own` attempts
 * are always tried; the others while the task may take more. */
static bool run_list(node *n, const attempt_files_names *names, size_t first, size_t own, error *e)
{
    for (size_t i = 0; i < names->count && !n->stopped && (i < own || may_take_more(n)); i++)
        if (!take_and_run(n, names->name[(first + i) % names->count], e)) return false;
    return true;
}

/* Runs attempts of the list until none can be claimed. */
static bool run_others(node *n, const char *list, error *e)
{
    int before = -1;
    bool ok = true;
    while (ok && before < n->self.number && may_take_more(n)) {
        attempt_files_names names = attempt_files_read_list(n->farm, list);
        before = n->self.number;
        ok = run_list(n, &names, 0, 0, e);
        attempt_files_clear_names(&names);
    }
    return ok;
}

bool node_run(const char *farm, const node_task *task, error *e)
{
    node n = {
        .farm = farm, .self = task->self, .end_ms = clock_monotonic_ms() + (int64_t)(task->more_s * 1000)};
    sigset_t wanted;
    sigemptyset(&wanted);
    sigaddset(&wanted, SIGTERM);
    sigaddset(&wanted, SIGINT);
    sigprocmask(SIG_BLOCK, &wanted, NULL);
    signal(SIGXFSZ, SIG_IGN);
    n.signals = signalfd(-1, &wanted, SFD_CLOEXEC | SFD_NONBLOCK);
    if (n.signals < 0) return error_set(e, ERROR_INTERNAL, "signals: %s", strerror(errno));
    bool ok = run_list(&n, &task->names, task->first, task->own, e) && run_others(&n, task->list, e);
    close(n.signals);
    return ok;
}

// SPDX-License-Identifier: Apache-2.0
#include "service/executor/local.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/pidfd.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/core/child_environment.h"
#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "base/core/sandbox.h"
#include "base/core/transfer.h"
#include "base/core/worker_contract.h"
#include "service/executor/host.h"
#include "service/results/result.h"
#include "files/file.h"

#define PROGRESS_FD 3
#define TRACE_VARIABLE "TRACEPARENT="
/* Descriptors for the child are opened above the numbers to which they will be copied. */
#define FIRST_SAFE_FD 10
#define OOM_SCORE_FILE "/proc/self/oom_score_adj"

struct engine_attempt {
    pid_t pid;
    int64_t began_ms;
    char name[24];                  /* pid as text */
    int pidfd, log_fd, progress_fd; /* -1: closed */
    char *directory;
    char *trace;          /* environment variable, also the first line of the log; NULL: none */
    control_group *group; /* NULL: none */
    char *log;            /* 2 * LOCAL_LOG_BYTES; the last half is kept */
    size_t log_used;
    bool log_fresh;              /* it has more text than its file */
    int64_t log_shown_ms;        /* monotonic */
    char line[LOCAL_LINE_BYTES]; /* an unfinished progress line */
    size_t line_used;
    bool line_skipped; /* the line was too long: skip to its end */
    char newest[LOCAL_LINE_BYTES];
};

/* Data for the child, prepared before it starts. */
typedef struct launch {
    char **arguments;
    int spec_fd, null_fd, log_fd, progress_fd;
    pid_t parent;
    rlim_t address_space; /* bytes; RLIM_INFINITY: no limit */
    rlim_t file_size;     /* likewise */
    rlim_t open_files;
    char oom_score_adj[24]; /* as text */
    int nice;
    char **environment;
    const control_group *group;
    volatile int why; /* errno when the child could not start the worker; 0: it has started */
} launch;

static int raise_fd(int fd)
{
    if (fd < 0) return -1;
    int raised = fcntl(fd, F_DUPFD_CLOEXEC, FIRST_SAFE_FD);
    int why = errno;
    close(fd);
    errno = why;
    return raised;
}

static int make_spec_fd(const char *spec)
{
    int fd = raise_fd(memfd_create("spec", MFD_CLOEXEC));
    if (fd < 0) return -1;
    if (transfer_write(fd, spec, strlen(spec))) {
        lseek(fd, 0, SEEK_SET);
        return fd;
    }
    close(fd);
    return -1;
}

/* Makes a pipe whose reading end does not block. */
static bool make_pipe(int *reading, int *writing)
{
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) return false;
    *reading = raise_fd(ends[0]);
    *writing = raise_fd(ends[1]);
    return *reading >= 0 && *writing >= 0 && fcntl(*reading, F_SETFL, O_NONBLOCK) == 0;
}

static void close_fd(int *fd)
{
    if (*fd >= 0) close(*fd);
    *fd = -1;
}

/* Keeps a limit that is already lower, because limits cannot be raised. */
static bool lower_limit(int which, rlim_t to)
{
    struct rlimit limit;
    if (getrlimit(which, &limit) != 0) return false;
    if (to < limit.rlim_max) limit.rlim_max = to;
    if (to < limit.rlim_cur) limit.rlim_cur = to;
    return setrlimit(which, &limit) == 0;
}

/* The daemon's value plus LOCAL_OOM_SCORE. The kernel accepts up to 1000. */
static void print_oom_score(char text[24])
{
    size_t length = 0;
    char *own = store_file_read(OOM_SCORE_FILE, 64, &length, NULL);
    long score = (own ? strtol(own, NULL, 10) : 0) + LOCAL_OOM_SCORE;
    snprintf(text, 24, "%ld", score < 1000 ? score : 1000);
    free(own);
}

/* A failure (no /proc, no permission) is ignored: then the kernel chooses by its own rules. */
static void set_oom_score(const char *text)
{
    int fd = open(OOM_SCORE_FILE, O_WRONLY | O_CLOEXEC);
    if (fd < 0) return;
    ssize_t written = write(fd, text, strlen(text));
    (void)written;
    close(fd);
}

/* Runs in the child, in the memory of the daemon; only async-signal-safe calls. */
static _Noreturn void run_child(launch *l)
{
    sigset_t none;
    sigemptyset(&none);
    for (int number = 1; number < NSIG; number++) signal(number, SIG_DFL);
    sigprocmask(SIG_SETMASK, &none, NULL);
    set_oom_score(l->oom_score_adj);
    setpriority(PRIO_PROCESS, 0, l->nice); /* a failure leaves the priority of the daemon */
    if ((!l->group || control_group_join(l->group)) && prctl(PR_SET_PDEATHSIG, SIGKILL) == 0 &&
        getppid() == l->parent && setpgid(0, 0) == 0 && prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 &&
        lower_limit(RLIMIT_CORE, 0) && lower_limit(RLIMIT_AS, l->address_space) &&
        lower_limit(RLIMIT_FSIZE, l->file_size) && lower_limit(RLIMIT_NOFILE, l->open_files) &&
        dup2(l->spec_fd, STDIN_FILENO) >= 0 && dup2(l->null_fd, STDOUT_FILENO) >= 0 &&
        dup2(l->log_fd, STDERR_FILENO) >= 0 && dup2(l->progress_fd, PROGRESS_FD) >= 0) {
        /* an older kernel does not support this flag; all descriptors are close-on-exec anyway */
        close_range(PROGRESS_FD + 1, ~0U, CLOSE_RANGE_CLOEXEC);
        execve(l->arguments[0], l->arguments, l->environment);
    }
    l->why = errno ? errno : ECHILD;
    _exit(127);
}

static char **make_arguments(const engine_request *request)
{
    size_t count = 0;
    char **a = mem_alloc((22 + 2 * request->input_root_count) * sizeof *a);
    a[count++] = mem_strdup(request->worker);
    a[count++] = mem_strdup(request->command);
    a[count++] = mem_strdup(WORKER_SPEC_ON_STDIN);
    a[count++] = mem_strdup("--" WORKER_OPTION_OUTPUT);
    a[count++] = mem_strdup(request->directory);
    a[count++] = mem_strdup("--" WORKER_OPTION_PROGRESS_FD);
    a[count++] = mem_printf("%d", PROGRESS_FD);
    a[count++] = mem_strdup("--" WORKER_OPTION_MEMORY_MB);
    a[count++] = mem_printf("%" PRId64, request->memory_mb);
    if (request->most_memory_mb > 0) {
        a[count++] = mem_strdup("--" WORKER_OPTION_MOST_MEMORY_MB);
        a[count++] = mem_printf("%" PRId64, request->most_memory_mb);
    }
    a[count++] = mem_strdup("--" WORKER_OPTION_SANDBOX);
    a[count++] = mem_strdup(sandbox_mode_name(request->sandbox));
    a[count++] = mem_strdup("--" WORKER_OPTION_THREADS);
    a[count++] = mem_printf("%d", request->threads);
    if (request->frame != QUEUE_NO_FRAME) {
        a[count++] = mem_strdup("--" WORKER_OPTION_FRAME);
        a[count++] = mem_printf("%d", request->frame);
    }
    if (request->previous) {
        a[count++] = mem_strdup("--" WORKER_OPTION_PREVIOUS);
        a[count++] = mem_strdup(request->previous);
    }
    for (size_t i = 0; i < request->input_root_count; i++) {
        a[count++] = mem_strdup("--" WORKER_OPTION_INPUT_ROOT);
        a[count++] = mem_strdup(request->input_roots[i]);
    }
    if (!request->input_root_count) {
        /* without a root the worker would open any path, so give it one that contains no input */
        a[count++] = mem_strdup("--" WORKER_OPTION_INPUT_ROOT);
        a[count++] = mem_strdup(request->directory);
    }
    return a;
}

static void free_arguments(char **arguments)
{
    for (char **a = arguments; *a; a++) free(*a);
    free(arguments);
}

#define TRACE_VARIABLE "TRACEPARENT="

static rlim_t address_space_of(int64_t memory_mb)
{
#ifdef __SANITIZE_ADDRESS__
    (void)memory_mb;
    return RLIM_INFINITY;
#else
    long cores = sysconf(_SC_NPROCESSORS_ONLN);
    rlim_t headroom_mb = LOCAL_HEADROOM_MB + LOCAL_HEADROOM_PER_CORE_MB * (rlim_t)(cores > 0 ? cores : 1);
    return ((rlim_t)memory_mb + headroom_mb) * 1024 * 1024;
#endif
}

/* Starts the child; returns when it executes the worker or has ended (l->why). Negative: there is no child.
 * fork would copy the page tables of the daemon and block memory allocations of other threads: 20 to 100
 * ms with 200 MB. */
static pid_t start_child(launch *l)
{
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before); /* no handler may run in the child */
    pid_t pid = vfork();
    if (pid == 0) run_child(l);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return pid;
}

static void attempt_free(engine_attempt *a)
{
    close_fd(&a->pidfd);
    close_fd(&a->log_fd);
    close_fd(&a->progress_fd);
    free(a->directory);
    free(a->trace);
    free(a->log);
    free(a);
}

/* The descriptors are opened later. */
static launch make_launch(const engine_request *request, const engine_attempt *a)
{
    launch l = {
        .arguments = make_arguments(request),
        .environment = child_environment_new(CHILD_ENVIRONMENT_OF_WORKER, a->trace),
        .spec_fd = -1,
        .null_fd = -1,
        .log_fd = -1,
        .progress_fd = -1,
        .parent = getpid(),
        .address_space = address_space_of(request->memory_mb),
        .file_size = request->file_mb ? (rlim_t)request->file_mb << 20 : RLIM_INFINITY,
        .open_files = LOCAL_OPEN_FILES + request->input_root_count,
        .nice = getpriority(PRIO_PROCESS, 0) + LOCAL_NICE,
        .group = a->group,
    };
    print_oom_score(l.oom_score_adj);
    return l;
}

static void launch_clear(launch *l)
{
    free_arguments(l->arguments);
    free(l->environment);
    close_fd(&l->spec_fd);
    close_fd(&l->null_fd);
    close_fd(&l->log_fd);
    close_fd(&l->progress_fd);
}

static engine_attempt *start(void *place, const engine_request *request, error *e)
{
    (void)place;
    engine_attempt *a = mem_alloc(sizeof *a);
    a->pidfd = a->log_fd = a->progress_fd = -1;
    a->directory = mem_strdup(request->directory);
    a->log = mem_alloc(2 * LOCAL_LOG_BYTES);
    a->log_fresh = true;
    a->log_shown_ms = clock_monotonic_ms(); /* a worker that ends soon needs no file but the final one */
    a->trace = request->trace ? mem_printf(TRACE_VARIABLE "%s", request->trace) : NULL;
    if (request->groups && !(a->group = control_group_new(request->groups, request->memory_mb << 20, e))) {
        attempt_free(a);
        return NULL;
    }
    launch l = make_launch(request, a);
    int why = 0;
    l.spec_fd = make_spec_fd(request->spec);
    l.null_fd = raise_fd(open("/dev/null", O_WRONLY | O_CLOEXEC));
    if (l.spec_fd < 0 || l.null_fd < 0 || !make_pipe(&a->log_fd, &l.log_fd) ||
        !make_pipe(&a->progress_fd, &l.progress_fd) || (a->pid = start_child(&l)) < 0) {
        why = errno;
    } else {
        why = l.why;
        a->pidfd = why ? -1 : pidfd_open(a->pid, 0);
        if (!why && a->pidfd < 0) why = errno;
        if (why) {
            kill(a->pid, SIGKILL);
            waitpid(a->pid, NULL, 0);
        }
    }
    launch_clear(&l);
    if (!why) {
        snprintf(a->name, sizeof a->name, "%d", (int)a->pid);
        a->began_ms = clock_monotonic_ms();
        return a;
    }
    error_set(e, ERROR_INTERNAL, "cannot start the worker %s: %s", request->worker, strerror(why));
    control_group_end(a->group);
    attempt_free(a);
    return NULL;
}

static int64_t began_ms(const engine_attempt *a)
{
    return a->began_ms;
}

static void find_host(const engine_attempt *a, char host[ENGINE_HOST_SIZE])
{
    (void)a;
    host_name(host, ENGINE_HOST_SIZE);
}

static const char *identify(const engine_attempt *a)
{
    return a->name;
}

static size_t watch(const engine_attempt *a, struct pollfd fds[ENGINE_MAX_FDS])
{
    fds[0] = (struct pollfd){.fd = a->pidfd, .events = POLLIN};
    fds[1] = (struct pollfd){.fd = a->log_fd, .events = POLLIN};
    fds[2] = (struct pollfd){.fd = a->progress_fd, .events = POLLIN};
    return 3;
}

/* Reads once. 0: no data, or the end, at which the descriptor is closed. */
static size_t read_some(int *fd, char *buffer, size_t size)
{
    if (*fd < 0) return 0;
    ssize_t got = read(*fd, buffer, size);
    if (got > 0) return (size_t)got;
    if (got == 0 || (errno != EAGAIN && errno != EINTR)) close_fd(fd);
    return 0;
}

static void keep_log(engine_attempt *a, const char *text, size_t length)
{
    if (a->log_used + length > 2 * LOCAL_LOG_BYTES) {
        memmove(a->log, a->log + a->log_used - LOCAL_LOG_BYTES, LOCAL_LOG_BYTES);
        a->log_used = LOCAL_LOG_BYTES;
    }
    memcpy(a->log + a->log_used, text, length);
    a->log_used += length;
    a->log_fresh = true;
}

/* True if a complete line was read; the newest is in a->newest. */
static bool keep_lines(engine_attempt *a, const char *text, size_t length)
{
    bool whole = false;
    for (size_t i = 0; i < length; i++) {
        if (text[i] != '\n') {
            if (a->line_used < sizeof a->line - 1)
                a->line[a->line_used++] = text[i];
            else
                a->line_skipped = true;
            continue;
        }
        if (!a->line_skipped) {
            memcpy(a->newest, a->line, a->line_used);
            a->newest[a->line_used] = '\0';
            whole = true;
        }
        a->line_used = 0;
        a->line_skipped = false;
    }
    return whole;
}

/* The contents of the log file; the caller frees it. */
static char *log_text(const engine_attempt *a, size_t *length)
{
    size_t kept = a->log_used < LOCAL_LOG_BYTES ? a->log_used : LOCAL_LOG_BYTES;
    size_t head = a->trace ? strlen(a->trace) + 1 : 0;
    char *text = mem_alloc(head + kept + 1);
    if (head) sprintf(text, "%s\n", a->trace);
    memcpy(text + head, a->log + a->log_used - kept, kept);
    *length = head + kept;
    return text;
}

/* Minimum interval between updates of the log file. */
#define LOG_FILE_MS 500

/* Updates the log file for readers while the worker runs. Errors are ignored: the final update reports
 * them. */
static void update_log_file(engine_attempt *a)
{
    int64_t now = clock_monotonic_ms();
    if (!a->log_fresh || now - a->log_shown_ms < LOG_FILE_MS) return;
    size_t length;
    char *text = log_text(a, &length), *path = mem_printf("%s/" RESULT_LOG_NAME, a->directory);
    int fd = open(path, O_WRONLY | O_CREAT | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC, 0644);
    if (fd >= 0 && write(fd, text, length) == (ssize_t)length && ftruncate(fd, (off_t)length) == 0)
        a->log_fresh = false;
    a->log_shown_ms = now;
    close_fd(&fd);
    free(text);
    free(path);
}

static void write_log(const engine_attempt *a)
{
    error e = {0};
    size_t length;
    char *text = log_text(a, &length), *path = mem_printf("%s/" RESULT_LOG_NAME, a->directory);
    if (!store_file_write(path, text, length, &e))
        log_write(LOG_LEVEL_WARNING, "cannot store the log of the worker: %s", e.message);
    free(text);
    free(path);
}

/* Reads per turn. A worker that writes without end must not block the supervisor. */
#define READS_A_TURN 16

static bool take_in(engine_attempt *a)
{
    char block[16384];
    bool whole = false;
    size_t got;
    for (int i = 0; i < READS_A_TURN && (got = read_some(&a->log_fd, block, sizeof block)); i++)
        keep_log(a, block, got);
    for (int i = 0; i < READS_A_TURN && (got = read_some(&a->progress_fd, block, sizeof block)); i++)
        whole |= keep_lines(a, block, got);
    return whole;
}

static bool poll_attempt(engine_attempt *a, const char **progress)
{
    /* test this first: then all output of the ended process is in the pipes */
    struct pollfd end = {.fd = a->pidfd, .events = POLLIN};
    bool ended = poll(&end, 1, 0) > 0;
    *progress = take_in(a) ? a->newest : NULL;
    if (!ended) update_log_file(a);
    return ended;
}

static void cancel(engine_attempt *a, bool force)
{
    /* the process is not reaped, so that its pid and group cannot belong to another one */
    if (kill(-a->pid, force ? SIGKILL : SIGTERM) != 0) kill(a->pid, force ? SIGKILL : SIGTERM);
}

static char *find_last_words(const engine_attempt *a)
{
    size_t last = a->log_used;
    while (last > 0 && (a->log[last - 1] == '\n' || a->log[last - 1] == '\r')) last--;
    size_t first = last;
    while (first > 0 && a->log[first - 1] != '\n' && a->log[first - 1]) first--;
    return mem_strndup(a->log + first, last - first);
}

static int64_t milliseconds(struct timeval t)
{
    return (int64_t)t.tv_sec * 1000 + t.tv_usec / 1000;
}

static void settle(engine_attempt *a, engine_ending *ending)
{
    int status = 0;
    struct rusage usage = {0};
    kill(-a->pid, SIGKILL); /* kills what the worker may have started */
    while (wait4(a->pid, &status, 0, &usage) < 0 && errno == EINTR) continue;
    /* a pipe holds 64 KiB, so this reads the rest of the worker's output */
    take_in(a);
    ending->exit_status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    ending->signal = WIFSIGNALED(status) ? WTERMSIG(status) : -1;
    control_group_use use = control_group_end(a->group);
    ending->peak_memory_bytes = use.peak_bytes ? use.peak_bytes : (int64_t)usage.ru_maxrss * 1024;
    ending->processor_ms = milliseconds(usage.ru_utime) + milliseconds(usage.ru_stime);
    ending->out_of_memory = use.exceeded;
    ending->last_words = find_last_words(a);
    write_log(a);
    attempt_free(a);
}

const engine engine_local = {"local",   start,    NULL,  NULL,         NULL,   NULL,  began_ms,
                             find_host, identify, watch, poll_attempt, cancel, settle};

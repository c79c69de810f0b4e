/* hexad: the daemon. A list of steps, each with what undoes it; the last thing started is the first
 * to stop. */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/signalfd.h>
#include <sys/stat.h>
#include <unistd.h>

#include "config.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/manager.h"
#include "base/memory.h"
#include "base/sandbox.h"
#include "config/config.h"
#include "executor/executor.h"
#include "http/server.h"
#include "queue/queue.h"
#include "store/file.h"
#include "store/root.h"

/* How often the service manager is told how many jobs there are, where it asks for no sign of life. */
static const int STATUS_MS = 10000;
/* After what drain_s and grace_s allow: to end what has been killed and to write it down. */
static const double LAST_WORDS_S = 10;

enum { EXIT_DRAINED = 0, EXIT_TROUBLE = 1, EXIT_SETTINGS = 2 };

typedef struct service {
    int argc;
    char **argv; /* where the settings come from */
    config settings;
    int signals;     /* signalfd */
    char *state_dir; /* absolute */
    queue *q;
    store_roots *roots;
    executor *x;
    listen_socket socket;
    jobs_context context;
    server *http;
    uint64_t turns; /* of the supervisor, when it was last looked at; UINT64_MAX: never */
    bool stuck;
} service;

static bool init_signals(service *s, error *e)
{
    sigset_t wanted;
    sigemptyset(&wanted);
    sigaddset(&wanted, SIGTERM);
    sigaddset(&wanted, SIGINT);
    sigaddset(&wanted, SIGHUP);
    signal(SIGPIPE, SIG_IGN);
    signal(SIGXFSZ, SIG_IGN); /* a file that may not grow is an error like a full disk */
    sigprocmask(SIG_BLOCK, &wanted, NULL); /* before any thread is there to inherit less */
    s->signals = signalfd(-1, &wanted, SFD_CLOEXEC | SFD_NONBLOCK);
    return s->signals >= 0 || error_set(e, ERROR_INTERNAL, "signals: %s", strerror(errno));
}

static void fini_signals(service *s)
{
    close(s->signals);
}

static bool init_state(service *s, error *e)
{
    if (!store_directory_create(s->settings.state_dir, e)) return false;
    s->state_dir = realpath(s->settings.state_dir, NULL);
    if (s->state_dir) return true;
    return error_set(e, ERROR_INTERNAL, "state_dir %s: %s", s->settings.state_dir, strerror(errno));
}

static void fini_state(service *s)
{
    free(s->state_dir);
}

static bool init_queue(service *s, error *e)
{
    s->q = queue_open(s->state_dir, e);
    return s->q != NULL;
}

static void fini_queue(service *s)
{
    queue_close(s->q);
}

static bool init_roots(service *s, error *e)
{
    s->roots = store_roots_open((const char *const *)s->settings.input_roots.item,
                                s->settings.input_roots.count, e);
    return s->roots != NULL;
}

static void fini_roots(service *s)
{
    store_roots_close(s->roots);
}

static bool init_socket(service *s, error *e)
{
    int fd;
    if (!manager_socket(&fd, e)) return false;
    return fd >= 0 ? listen_adopt(fd, &s->socket, e) : listen_open(s->settings.listen, &s->socket, e);
}

static void fini_socket(service *s)
{
    listen_close(&s->socket);
}

static executor_settings executor_settings_of(const service *s)
{
    const config *c = &s->settings;
    return (executor_settings){
        .state_dir = s->state_dir,
        .worker = c->worker,
        .input_roots = (const char *const *)c->input_roots.item,
        .input_root_count = c->input_roots.count,
        .workers = (int)c->workers,
        .memory_mb = c->memory_mb,
        .file_mb = c->file_mb,
        .sandbox = c->sandbox,
        .timeout_s = c->timeout_s,
        .stall_s = c->stall_s,
        .grace_s = c->grace_s,
    };
}

static bool init_executor(service *s, error *e)
{
    char text[SANDBOX_TEXT_SIZE];
    sandbox_mode mode = s->settings.sandbox;
    if (!config_find_worker(&s->settings, e) || !sandbox_check(mode, e)) return false;
    log_write(mode == SANDBOX_OFF ? LOG_LEVEL_WARNING : LOG_LEVEL_INFO, "workers have %s",
              sandbox_describe(mode, text));
    executor_settings settings = executor_settings_of(s);
    s->x = executor_start(&settings, s->q, e);
    return s->x != NULL;
}

static void fini_executor(service *s)
{
    executor_stop(s->x);
}

static bool init_http(service *s, error *e)
{
    const config *c = &s->settings;
    server_settings settings = {
        .body_limit_bytes = (size_t)c->body_limit_bytes,
        .connection_limit = (unsigned)c->connection_limit,
        .timeout_s = c->connection_timeout_s,
    };
    s->context = (jobs_context){
        .q = s->q,
        .x = s->x,
        .roots = s->roots,
        .state_dir = s->state_dir,
        .max_attempts = (int)c->max_attempts,
    };
    s->http = server_start(&settings, &s->socket, &s->context, e);
    return s->http != NULL;
}

static void fini_http(service *s)
{
    server_stop(s->http);
}

static bool init_port_file(service *s, error *e)
{
    log_write(LOG_LEVEL_INFO, "hexad: listening on %s", s->socket.address);
    if (!*s->settings.port_file) return true;
    char *line = mem_printf("%s\n", s->socket.address);
    bool ok = store_file_write(s->settings.port_file, line, strlen(line), e);
    free(line);
    return ok;
}

static void fini_port_file(service *s)
{
    if (*s->settings.port_file) unlink(s->settings.port_file);
}

static const struct step {
    const char *name;
    bool (*init)(service *s, error *e);
    void (*fini)(service *s);
} steps[] = {
    {"signals", init_signals, fini_signals}, {"state", init_state, fini_state},
    {"queue", init_queue, fini_queue},       {"roots", init_roots, fini_roots},
    {"socket", init_socket, fini_socket},    {"executor", init_executor, fini_executor},
    {"http", init_http, fini_http},          {"port_file", init_port_file, fini_port_file},
};

/* Signs of life. The supervisor was woken the last time; if it has not turned since, it is stuck, and the
 * service manager is left to do what it does about that. */
static void tell_manager(service *s)
{
    int64_t count[QUEUE_STATE_COUNT];
    uint64_t turns = executor_turns(s->x);
    bool stuck = turns == s->turns;
    s->turns = turns;
    executor_wake(s->x);
    if (stuck && !s->stuck)
        log_write(LOG_LEVEL_ERROR, "the supervisor is stuck: no sign of life to the service manager");
    s->stuck = stuck;
    if (stuck) {
        manager_tell_status("stuck");
        return;
    }
    manager_tell_alive();
    if (queue_count(s->q, count, NULL))
        manager_tell_status("%s%lld queued, %lld running", executor_is_draining(s->x) ? "draining: " : "",
                            (long long)count[QUEUE_QUEUED],
                            (long long)(count[QUEUE_RUNNING] + count[QUEUE_CANCELLING]));
}

/* Between two of them: twice within what the watchdog allows. */
static int sign_interval_ms(void)
{
    int64_t watchdog = manager_watchdog_ms();
    if (watchdog > 0) return watchdog / 2 < INT32_MAX ? (int)(watchdog / 2) : INT32_MAX;
    return manager_is_there() ? STATUS_MS : -1;
}

static void reload(service *s)
{
    config fresh = {0};
    config_action action;
    error e = {0};
    manager_tell_reloading();
    if (config_parse(s->argc, s->argv, &fresh, &action, &e) && config_find_worker(&fresh, &e)) {
        config_take_over(&s->settings, &fresh);
        log_set_level(s->settings.log_level);
        executor_settings settings = executor_settings_of(s);
        executor_change(s->x, &settings);
        log_write(LOG_LEVEL_INFO, "settings reloaded");
    } else {
        log_write(LOG_LEVEL_ERROR, "settings stay as they were: %s", e.message);
    }
    config_clear(&fresh);
    manager_tell_ready();
}

static void drain(service *s, bool *draining)
{
    const config *c = &s->settings;
    manager_tell_stopping((*draining ? 0 : c->drain_s) + c->grace_s + LAST_WORDS_S);
    if (*draining)
        executor_force(s->x);
    else
        executor_drain(s->x, c->drain_s);
    *draining = true;
}

/* Waits for a signal, then until the drain has ended; another signal kills what still runs. */
static void serve(service *s)
{
    bool draining = false;
    int interval_ms = sign_interval_ms();
    int64_t due_ms = clock_monotonic_ms();
    manager_tell_ready();
    for (;;) {
        struct pollfd fds[] = {{.fd = s->signals, .events = POLLIN},
                               {.fd = executor_drained_fd(s->x), .events = POLLIN}};
        int64_t wait_ms = due_ms - clock_monotonic_ms();
        if (poll(fds, 2, interval_ms < 0 ? -1 : wait_ms > 0 ? (int)wait_ms : 0) < 0 && errno != EINTR) return;
        struct signalfd_siginfo info;
        if (read(s->signals, &info, sizeof info) == sizeof info) {
            bool again = info.ssi_signo == SIGHUP;
            log_write(LOG_LEVEL_INFO, "%s signal=%u",
                      again      ? "reloading"
                      : draining ? "stopping at once"
                                 : "draining",
                      info.ssi_signo);
            if (again)
                reload(s);
            else
                drain(s, &draining);
        } else if (draining && fds[1].revents) {
            return;
        }
        if (interval_ms < 0 || clock_monotonic_ms() < due_ms) continue;
        tell_manager(s);
        due_ms = clock_monotonic_ms() + interval_ms;
    }
}

static int run(service *s)
{
    error e = {0};
    size_t started = 0, count = sizeof steps / sizeof *steps;
    while (started < count && steps[started].init(s, &e)) started++;
    bool ok = started == count;
    if (ok)
        serve(s);
    else
        log_write(LOG_LEVEL_ERROR, "hexad: %s", e.message);
    while (started > 0) steps[--started].fini(s);
    if (ok) log_write(LOG_LEVEL_INFO, "hexad: ended");
    return ok ? EXIT_DRAINED : e.code == ERROR_SPEC_INVALID ? EXIT_SETTINGS : EXIT_TROUBLE;
}

/* Without the three standard descriptors the next files opened would take their numbers, and what is
 * meant for the log would go into the queue. */
static void open_standard_descriptors(void)
{
    int fd;
    do {
        fd = open("/dev/null", O_RDWR);
    } while (fd >= 0 && fd <= STDERR_FILENO);
    if (fd >= 0) close(fd);
}

int main(int argc, char **argv)
{
    open_standard_descriptors();
    service s = {.argc = argc, .argv = argv, .signals = -1, .socket.fd = -1, .turns = UINT64_MAX};
    config_action action;
    error e = {0};
    if (!config_parse(argc, argv, &s.settings, &action, &e)) {
        fprintf(stderr, "hexad: %s\n", e.message);
        return EXIT_SETTINGS;
    }
    int status = EXIT_SUCCESS;
    log_set_level(s.settings.log_level);
    umask(0077); /* jobs and results are the service's own */
    switch (action) {
    case CONFIG_HELP:
        config_print_help(stdout);
        break;
    case CONFIG_VERSION:
        puts(PACKAGE_STRING);
        break;
    case CONFIG_SAMPLE:
        config_print_sample(stdout);
        break;
    case CONFIG_RUN:
        status = run(&s);
        break;
    }
    config_clear(&s.settings);
    return status;
}

// SPDX-License-Identifier: Apache-2.0
/* hexad: the daemon. A table of steps, each with a start and a stop function; they stop in reverse order.
 * The table alone determines the order of the end: first checks and requests, then jobs, then background
 * work, then the objects that these used. */
#include <errno.h>
#include <grp.h>
#include <limits.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/signalfd.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "config.h"

#include "service/api/context.h"
#include "service/api/notifier.h"
#include "service/api/openapi.h"
#include "service/api/web_page.h"
#include "service/api/routes.h"
#include "service/auth/access.h"
#include "base/core/clock.h"
#include "base/core/control_group.h"
#include "base/core/denial.h"
#include "base/core/descriptor_wait.h"
#include "base/core/log.h"
#include "base/core/manager.h"
#include "base/core/memory.h"
#include "base/core/runner.h"
#include "base/core/sandbox.h"
#include "base/core/stall.h"
#include "base/core/terminal_text.h"
#include "base/core/threads.h"
#include "service/config/config.h"
#include "service/database/checker.h"
#include "service/executor/estimator.h"
#include "service/executor/cache.h"
#include "service/executor/executor.h"
#include "service/executor/host.h"
#include "service/executor/local.h"
#include "service/http/server.h"
#include "programs/admission.h"
#include "programs/descriptors.h"
#include "programs/directory_check.h"
#include "programs/farm.h"
#include "programs/maintenance.h"
#include "programs/open_port.h"
#include "service/ledger/ledger.h"
#include "service/queue/queue.h"
#include "service/results/instance_check.h"
#include "service/results/output_place.h"
#include "files/file.h"
#include "service/uploads/upload_store.h"
#include "files/output.h"
#include "files/path_map.h"
#include "files/root.h"
#include "service/webhook/delivery.h"
#include "service/webhook/hosts.h"

/* In the runtime directory of systemd, otherwise in the state directory. */
#define LISTEN_SOCKET_NAME "hexad.sock"
/* The value of tcp_without_tokens that opens a loopback port without tokens. */
#define OPEN_TCP "anyone-on-this-machine-may-submit-and-cancel"
/* Fraction of the disk that results may occupy if results_mb is not set. */
static const double RESULTS_SHARE = 0.8;
/* Maximum interval, in ms, of the checks whether the loops advance, and of reports to a service manager. */
static const int CHECK_MS = 10000;
/* Time to settle killed workers, in addition to drain_s and grace_s. */
static const double LAST_WORDS_S = 10;

enum { EXIT_DRAINED = 0, EXIT_TROUBLE = 1, EXIT_SETTINGS = 2 };

typedef struct service {
    int argc;
    char **argv; /* to read the settings again */
    config settings;
    bool adopt;                 /* --adopt: take over the database of another instance */
    int signals;                /* signalfd */
    char *state_dir, *work_dir; /* absolute */
    char *allow_command;        /* permits the user whose name follows; NULL: no settings file */
    ledger *counts;
    runner *tasks;
    queue *q;
    checker *checker;
    store_inputs *inputs;
    char *inputs_dir;
    store_roots *roots;
    store_outputs output_roots;
    char **output_root; /* the setting, without %u */
    bool *output_root_of_user;
    output_place *outputs;
    path_map *mappings;
    user_numbers *weights, *priorities; /* of users */
    webhook_hosts *webhook_hosts;
    char host[HOST_NAME_MAX + 1];
    delivery *delivery; /* NULL: no webhooks */
    delivery_counters calls;
    control_groups *groups; /* NULL: none */
    struct slurm *farm;     /* NULL: attempts are processes of this host */
    executor *x;
    bool is_supervised; /* the executor was started */
    bool is_listed;     /* the port file was written */
    listen_socket *sockets;
    size_t socket_count;
    access_control *access;
    http_counters counters;
    pthread_mutex_t frame_checks;
    atomic_bool copying; /* a backup is being made */
    wait_list *waiting;
    notifier *notifier;
    http_context context;
    address_ranges proxies;
    pages *pages;
    page *page; /* NULL: none */
    openapi *openapi;
    server *http;
    stall supervising, serving;
} service;

static bool init_signals(service *s, error *e)
{
    sigset_t wanted;
    sigemptyset(&wanted);
    sigaddset(&wanted, SIGTERM);
    sigaddset(&wanted, SIGINT);
    sigaddset(&wanted, SIGHUP);
    signal(SIGPIPE, SIG_IGN);
    signal(SIGXFSZ, SIG_IGN); /* makes a write beyond the size limit an error, like a full disk */
    sigprocmask(SIG_BLOCK, &wanted, NULL); /* before other threads start, since they inherit the mask */
    s->signals = signalfd(-1, &wanted, SFD_CLOEXEC | SFD_NONBLOCK);
    return s->signals >= 0 || error_set(e, ERROR_INTERNAL, "signals: %s", strerror(errno));
}

static void log_warning(const char *setting, const char *message)
{
    log_write(LOG_LEVEL_WARNING, "%s: %s", setting, message);
}

/* Passes the settings whose directories other users can write to a function, with a description. */
static void visit_open_directories(const config *c, void (*tell)(const char *setting, const char *message))
{
    const struct {
        const char *setting, *path;
    } directories[] = {{"state_dir", c->state_dir}, {"work_dir", c->work_dir}};
    for (size_t i = 0; i < sizeof directories / sizeof *directories; i++) {
        char *message = *directories[i].path ? directory_check_describe_writers(directories[i].path) : NULL;
        if (message) tell(directories[i].setting, message);
        free(message);
    }
}

/* Whether the directories of the settings can be used, or created. */
static bool place_state(service *s, error *e)
{
    const config *c = &s->settings;
    return directory_check_usable("state_dir", c->state_dir, e) &&
           (!*c->work_dir || directory_check_usable("work_dir", c->work_dir, e));
}

static bool init_state(service *s, error *e)
{
    if (!store_directory_create(s->settings.state_dir, e)) return error_prefix(e, "state_dir");
    s->state_dir = realpath(s->settings.state_dir, NULL);
    if (!s->state_dir)
        return error_set(e, ERROR_INTERNAL, "cannot resolve state_dir %s: %s", s->settings.state_dir,
                         strerror(errno));
    s->work_dir = farm_work_directory(&s->settings, s->state_dir, e);
    if (s->work_dir) visit_open_directories(&s->settings, log_warning);
    return s->work_dir != NULL;
}

/* Default limits of memory for bodies, as numbers of bodies of the maximum length. */
enum { BODIES_IN_ALL = 16, BODIES_OF_USER = 4 };

/* A limit of the memory for bodies, in bytes; at least the maximum length of one body. */
static int64_t bytes_of_bodies(const config *c, int64_t given, int otherwise)
{
    int64_t longest = c->body_limit_bytes + 1, bytes = given ? given : otherwise * longest;
    return bytes > longest ? bytes : longest;
}

static bool init_ledger(service *s, error *e)
{
    (void)e;
    const config *c = &s->settings;
    const struct {
        ledger_resource what;
        int64_t holder, all;
    } limits[] = {
        {LEDGER_CLIENT_CONNECTIONS, c->client_connection_limit, 0},
        {LEDGER_BODIES, bytes_of_bodies(c, c->user_body_bytes, BODIES_OF_USER),
         bytes_of_bodies(c, c->body_total_bytes, BODIES_IN_ALL)},
        {LEDGER_ANSWERS, c->user_answer_bytes, c->answer_total_bytes},
        {LEDGER_UPLOADS, c->user_uploads, 0},
        {LEDGER_UPLOAD_BYTES, c->user_upload_bytes ? c->user_upload_bytes : c->upload_total_bytes / 4, 0},
        {LEDGER_SUBMISSIONS, c->user_submissions, 0},
        {LEDGER_JOBS, c->user_queued, 0},
        {LEDGER_TASKS, c->user_tasks, 0},
        {LEDGER_ATTEMPTS, c->user_running, 0},
    };
    s->counts = ledger_new();
    for (size_t k = 0; k < sizeof limits / sizeof *limits; k++)
        ledger_limit(s->counts, limits[k].what, (ledger_limits){limits[k].holder, limits[k].all});
    return true;
}

static int64_t bound_of(int64_t setting, int64_t unit)
{
    return setting ? setting * unit : INT64_MAX;
}

static void bound_results(service *s)
{
    const config *c = &s->settings;
    struct statvfs disk;
    queue_bounds bounds = {
        .all = {bound_of(c->results_mb, 1 << 20), bound_of(c->results_count, 1)},
        .user = {bound_of(c->user_results_mb, 1 << 20), bound_of(c->user_results_count, 1)},
        .undelivered = c->delete_undelivered != 0,
    };
    if (!c->results_mb && statvfs(s->work_dir, &disk) == 0 && disk.f_blocks)
        bounds.all.bytes = (int64_t)(RESULTS_SHARE * (double)disk.f_blocks * (double)disk.f_frsize);
    queue_bound(s->q, &bounds);
}

static bool init_queue(service *s, error *e)
{
    s->q = instance_check_open_queue(s->state_dir, s->work_dir, s->adopt, e);
    if (!s->q) return false;
    queue_reserve(s->q, s->settings.reserve_mb << 20);
    bound_results(s);
    return true;
}

static bool init_checker(service *s, error *e)
{
    s->checker =
        checker_start(queue_database(s->q), s->settings.check_interval_s, s->settings.free_space_mb << 20, e);
    return s->checker != NULL;
}

static bool init_inputs(service *s, error *e)
{
    s->inputs_dir = mem_printf("%s/inputs", s->work_dir);
    s->inputs = store_inputs_open(s->inputs_dir, s->settings.upload_limit_bytes,
                                  s->settings.upload_total_bytes, s->q, s->counts, e);
    return s->inputs != NULL;
}

/* Logs roots that this process cannot list; paths below them can still be open to it. */
static void warn_of_unreadable_inputs(const config_list *given)
{
    for (size_t i = 0; i < given->count; i++) {
        if (access(given->item[i], R_OK) == 0 || errno != EACCES) continue;
        char *why = denial_describe(given->item[i], DENIAL_READ);
        log_write(LOG_LEVEL_WARNING, "input_roots: cannot read %s: Permission denied: %s", given->item[i],
                  why);
        free(why);
    }
}

static bool values_roots(service *s, error *e)
{
    const config_list *given = &s->settings.input_roots;
    for (size_t i = 0; i < given->count; i++)
        if (given->item[i][0] != '/')
            return error_set(e, ERROR_SPEC_INVALID, "input_roots: must be absolute paths (given %s)",
                             given->item[i]);
    return true;
}

/* The error names each root that cannot be opened. */
static bool place_roots(service *s, error *e)
{
    const config_list *given = &s->settings.input_roots;
    char *faults = NULL;
    for (size_t i = 0; i < given->count; i++) {
        error why = {0};
        store_roots *opened = store_roots_open(NULL, (const char *const *)given->item + i, 1, &why);
        store_roots_close(opened);
        if (opened) continue;
        char *longer = faults ? mem_printf("%s. %s", faults, why.message) : mem_strdup(why.message);
        free(faults);
        faults = longer;
        error_set(e, why.code, "%s", faults);
    }
    free(faults);
    return !faults;
}

static bool init_roots(service *s, error *e)
{
    const config_list *given = &s->settings.input_roots;
    warn_of_unreadable_inputs(given);
    s->roots = store_roots_open(s->inputs_dir, (const char *const *)given->item, given->count, e);
    return s->roots != NULL;
}

/* An address of the setting `listen`; "unix:" is the default socket. The caller frees it. */
static char *address_of(const char *given, const char *state_dir)
{
    const char *runtime = getenv("RUNTIME_DIRECTORY"); /* of systemd */
    return strcmp(given, "unix:") != 0
               ? mem_strdup(given)
               : mem_printf("unix:%s/" LISTEN_SOCKET_NAME, runtime ? runtime : state_dir);
}

static bool open_socket(service *s, const char *given, error *e)
{
    char *where = address_of(given, s->state_dir);
    bool ok = listen_open(where, config_shares_socket(&s->settings), &s->sockets[s->socket_count], e);
    s->socket_count += ok;
    free(where);
    return ok;
}

static bool values_sockets(service *s, error *e)
{
    const config *c = &s->settings;
    bool ok = true;
    for (size_t k = 0; ok && k < c->listen.count; k++) {
        listen_reach reach;
        char *where = address_of(c->listen.item[k], c->state_dir);
        ok = listen_find_reach(where, &reach, e);
        free(where);
    }
    return ok;
}

/* Whether sockets can be created at their paths. In the state directory, which may not exist yet, they can. */
static bool place_sockets(service *s, error *e)
{
    const config *c = &s->settings;
    int first;
    bool ok = true;
    if (manager_sockets(&first)) return true;
    for (size_t k = 0; ok && k < c->listen.count; k++) {
        char *where = address_of(c->listen.item[k], c->state_dir);
        ok = directory_check_contains(c->state_dir, where + strcspn(where, "/")) ||
             listen_check_place(where, e);
        free(where);
    }
    return ok;
}

static void append_name(char **list, const char *name)
{
    char *longer = mem_printf("%s%s%s", *list, **list ? ", " : "", name);
    free(*list);
    *list = longer;
}

/* With sockets of systemd, the setting listen has no effect. */
static void warn_of_ignored_addresses(const service *s)
{
    const config_list *given = &s->settings.listen;
    char *ignored = mem_strdup(""), *served = mem_strdup("");
    for (size_t k = 0; k < given->count; k++) append_name(&ignored, given->item[k]);
    for (size_t k = 0; k < s->socket_count; k++) append_name(&served, s->sockets[k].address);
    log_write(LOG_LEVEL_WARNING,
              "listen = %s is ignored: systemd opens the sockets, %s. Remove this setting. For a port, run "
              "`hexad --open-port USER`, or set ListenStream= and IPAddressAllow= in "
              "/etc/systemd/system/hexad.socket.d/tcp.conf (\"The web page\" in doc/operations.md)",
              ignored, served);
    free(ignored);
    free(served);
}

static bool init_sockets(service *s, error *e)
{
    const config_list *given = &s->settings.listen;
    int first;
    const size_t passed = manager_sockets(&first), count = passed ? passed : given->count;
    bool ok = true;
    s->sockets = mem_alloc((count + 1) * sizeof *s->sockets);
    for (size_t k = 0; ok && k < passed; k++) {
        ok = listen_adopt(first + (int)k, &s->sockets[k], e);
        s->socket_count += ok;
    }
    if (ok && passed && given->count) warn_of_ignored_addresses(s);
    if (!passed && !given->count) ok = open_socket(s, "unix:", e);
    for (size_t k = 0; ok && !passed && k < given->count; k++) ok = open_socket(s, given->item[k], e);
    return ok;
}

/* The widest reach of all sockets. */
static listen_reach reach_of(const service *s)
{
    listen_reach widest = LISTEN_UNIX;
    for (size_t k = 0; k < s->socket_count; k++)
        if (s->sockets[k].reach > widest) widest = s->sockets[k].reach;
    return widest;
}

static bool check_open_tcp(const config *c, error *e)
{
    return !*c->tcp_without_tokens || strcmp(c->tcp_without_tokens, OPEN_TCP) == 0 ||
           error_set(e, ERROR_SPEC_INVALID, "tcp_without_tokens: must be empty or " OPEN_TCP);
}

/* Refuses an address whose callers could not be identified. */
static bool check_reach(const config *c, listen_reach reach, const char *where, access_control *a,
                        const char *token_file, error *e)
{
    if (reach == LISTEN_UNIX || access_has_tokens(a)) return true;
    if (reach == LISTEN_NETWORK)
        return error_set(e, ERROR_SPEC_INVALID,
                         "listen %s: other machines can reach this address and the token file %s has no "
                         "tokens (setting token_file): run `hexadctl token add USER --file %s`, or listen on "
                         "unix:/path",
                         where, token_file, token_file);
    return *c->tcp_without_tokens ||
           error_set(e, ERROR_SPEC_INVALID,
                     "listen %s: every user of this machine can reach this address and the token file %s "
                     "has no tokens (setting token_file): run `hexadctl token add USER --file %s`, listen "
                     "on unix:/path, or set tcp_without_tokens = " OPEN_TCP,
                     where, token_file, token_file);
}

/* The first socket of the widest reach. */
static bool check_sockets(const service *s, const char *token_file, error *e)
{
    const listen_reach reach = reach_of(s);
    size_t k = 0;
    while (s->sockets[k].reach != reach) k++;
    return check_reach(&s->settings, reach, s->sockets[k].where, s->access, token_file, e);
}

/* The path of the token file, which the caller frees: the setting, otherwise a file in the configuration
 * directory of the unit, otherwise in the state directory. */
static char *token_file_of(const config *c, const char *state_dir)
{
    const char *directory =
        getenv("CONFIGURATION_DIRECTORY"); /* set by the unit; a drop-in may have added directories */
    if (*c->token_file) return mem_strdup(c->token_file);
    if (!directory || !*directory) return mem_printf("%s/tokens", state_dir);
    return mem_printf("%.*s/tokens", (int)strcspn(directory, ":"), directory);
}

static bool values_access(service *s, error *e)
{
    return check_open_tcp(&s->settings, e);
}

/* Whether the addresses of `listen` may be served with the tokens that there are. */
static bool place_access(service *s, error *e)
{
    const config *c = &s->settings;
    int first;
    char *file = token_file_of(c, c->state_dir);
    const access_settings settings = {.token_file = file};
    access_control *tokens = access_open(&settings, e);
    bool ok = tokens != NULL;
    for (size_t k = 0; ok && k < c->listen.count && !manager_sockets(&first); k++) {
        char *where = address_of(c->listen.item[k], c->state_dir);
        listen_reach reach;
        ok = listen_find_reach(where, &reach, e) && check_reach(c, reach, where, tokens, file, e);
        free(where);
    }
    access_close(tokens);
    free(file);
    return ok;
}

static bool init_access(service *s, error *e)
{
    const config *c = &s->settings;
    char *file = token_file_of(c, s->state_dir);
    char *key_file = c->page ? mem_printf("%s/session.key", s->state_dir) : NULL;
    access_settings settings = {
        .users = admission_names(&c->unix_users),
        .groups = admission_names(&c->unix_groups),
        .admins = admission_names(&c->unix_admins),
        .token_file = file,
        .session_key_file = key_file,
        .session_s = c->session_s,
        .running = queue_running(s->q),
        .open_tcp = reach_of(s) == LISTEN_LOOPBACK && *c->tcp_without_tokens,
    };
    s->access = access_open(&settings, e);
    bool ok = s->access && check_sockets(s, file, e);
    free(file);
    free(key_file);
    return ok;
}

/* Splits the roots of users, DIRECTORY/%u. */
static bool read_output_roots(service *s, error *e)
{
    static const char of_user[] = "/%u";
    const config_list *given = &s->settings.output_roots;
    for (size_t i = 0; i < given->count; i++) {
        const char *mark = strstr(given->item[i], "%u");
        if (given->item[i][0] != '/')
            return error_set(e, ERROR_SPEC_INVALID, "output_roots: must be absolute paths (given %s)",
                             given->item[i]);
        if (mark && (mark[-1] != '/' || mark[2]))
            return error_set(e, ERROR_SPEC_INVALID,
                             "output_roots: %%u must be the last name of a path (given %s)", given->item[i]);
    }
    s->output_root = mem_alloc((given->count + 1) * sizeof *s->output_root);
    s->output_root_of_user = mem_alloc((given->count + 1) * sizeof *s->output_root_of_user);
    for (size_t i = 0; i < given->count; i++) {
        const char *mark = strstr(given->item[i], of_user);
        s->output_root_of_user[i] = mark != NULL;
        s->output_root[i] = mark == given->item[i] ? mem_strdup("/")
                            : mark ? mem_strndup(given->item[i], (size_t)(mark - given->item[i]))
                                   : mem_strdup(given->item[i]);
    }
    return true;
}

static bool init_output_roots(service *s, error *e)
{
    const config *c = &s->settings;
    char *end;
    unsigned long mode = strtoul(c->output_mode, &end, 8);
    if (end == c->output_mode || *end || (mode & ~0777ul) || (mode & 0600) != 0600)
        return error_set(e, ERROR_SPEC_INVALID,
                         "output_mode: must be an octal mode of at least 600, which lets the owner read and "
                         "write (given %s)",
                         c->output_mode);
    const struct group *group = *c->output_group ? getgrnam(c->output_group) : NULL;
    if (*c->output_group && !group)
        return error_set(e, ERROR_SPEC_INVALID,
                         "output_group: the group %s does not exist: run `getent group` for the groups",
                         c->output_group);
    if (!read_output_roots(s, e)) return false;
    s->output_roots = (store_outputs){
        .roots = (const char *const *)s->output_root,
        .root_count = c->output_roots.count,
        .of_user = s->output_root_of_user,
        .mode = (mode_t)mode,
        .group = group ? group->gr_gid : (gid_t)-1,
    };
    return true;
}

static bool init_outputs(service *s, error *e)
{
    (void)e;
    s->outputs = output_place_new(s->q, &s->output_roots, s->settings.share_outputs != 0);
    output_place_check_roots(s->outputs);
    return true;
}

static bool init_mappings(service *s, error *e)
{
    const config_list *given = &s->settings.path_mappings;
    s->mappings = path_map_read((const char *const *)given->item, given->count, e);
    return s->mappings != NULL;
}

static user_numbers *read_users(const config_list *given, const char *name, double low, double high, error *e)
{
    user_numbers *n = user_numbers_read((const char *const *)given->item, given->count, low, high, e);
    if (!n) error_prefix(e, "%s", name);
    return n;
}

static bool read_weights_and_priorities(const config *c, user_numbers **weights, user_numbers **priorities,
                                        error *e)
{
    *weights = read_users(&c->user_weights, "user_weights", 0.01, 100, e);
    *priorities = *weights ? read_users(&c->user_priorities, "user_priorities", -1000, 1000, e) : NULL;
    return *priorities != NULL;
}

static bool init_users(service *s, error *e)
{
    return read_weights_and_priorities(&s->settings, &s->weights, &s->priorities, e);
}

static executor_settings executor_settings_of(const service *s)
{
    const config *c = &s->settings;
    return (executor_settings){
        .state_dir = s->state_dir,
        .work_dir = s->work_dir,
        .engine = farm_engine(s->farm),
        .engine_place = s->farm,
        .worker = c->worker,
        .input_roots = (const char *const *)c->input_roots.item,
        .input_root_count = c->input_roots.count,
        .inputs = s->inputs,
        .inputs_keep_s = c->inputs_keep_s,
        .outputs = s->outputs,
        .workers = (int)(s->farm ? c->slurm_job_limit : c->workers),
        .threads = (int)c->threads,
        .host_memory_mb = c->host_memory_mb,
        .memory_mb = c->memory_mb,
        .cache = c->cache != 0,
        .file_mb = c->file_mb,
        .sandbox = c->sandbox,
        .groups = s->groups,
        .counts = s->counts,
        .weights = s->weights,
        .timeout_s = c->timeout_s,
        .stall_s = c->stall_s,
        .grace_s = c->grace_s,
        .retry_s = c->retry_s,
        .retry_most_s = c->retry_most_s,
        .free_space_mb = c->free_space_mb,
        .storage_retries = (int)c->storage_retries,
        .max_interruptions = (int)c->max_interruptions,
        .adopt = s->adopt,
    };
}

static bool values_executor(service *s, error *e)
{
    return config_find_worker(&s->settings, e) && farm_check(&s->settings, e);
}

static bool place_executor(service *s, error *e)
{
    return sandbox_check(s->settings.sandbox, e);
}

static bool init_executor(service *s, error *e)
{
    char text[SANDBOX_TEXT_SIZE];
    sandbox_mode mode = s->settings.sandbox;
    if (!farm_open(&s->settings, s->work_dir, s->tasks, &s->farm, e)) return false;
    log_write(mode == SANDBOX_OFF ? LOG_LEVEL_WARNING : LOG_LEVEL_INFO, "worker sandbox: %s",
              sandbox_describe(mode, text));
    executor_settings settings = executor_settings_of(s);
    if (settings.cache && !cache_identifies_build())
        log_write(LOG_LEVEL_INFO, "this build of " PACKAGE_VERSION
                                  " has no commit: results of other builds of this version are "
                                  "reused. Build a clone or a release tarball, or set cache = 0");
    s->x = executor_open(&settings, s->q, s->tasks, e);
    return s->x != NULL;
}

static bool init_tasks(service *s, error *e)
{
    (void)e;
    s->tasks = runner_new();
    return true;
}

/* Starts the runner, after the steps that add tasks to it. */
static bool init_background(service *s, error *e)
{
    return runner_start(s->tasks, e);
}

static bool init_supervisor(service *s, error *e)
{
    return s->is_supervised = executor_start(s->x, e);
}

static bool init_groups(service *s, error *e)
{
    if (!control_groups_open(&s->groups, e)) return false;
    log_write(LOG_LEVEL_INFO, "memory limits: %s",
              s->groups ? "enforced by the kernel, with a control group for each attempt"
                        : "checked by each worker; no control group is delegated to this service");
    return true;
}

static bool init_wait_list(service *s, error *e)
{
    (void)e;
    s->waiting = wait_list_new(s->tasks);
    return true;
}

static bool init_notifier(service *s, error *e)
{
    s->notifier = notifier_add(s->tasks, s->q, s->x, s->waiting, e);
    return s->notifier != NULL;
}

static bool init_webhook_hosts(service *s, error *e)
{
    const config_list *given = &s->settings.webhook_hosts;
    s->webhook_hosts = webhook_hosts_read((const char *const *)given->item, given->count, e);
    return s->webhook_hosts != NULL;
}

static bool values_webhooks(service *s, error *e)
{
    const config *c = &s->settings;
    return !c->webhook_hosts.count || *c->webhook_secret_file ||
           error_set(e, ERROR_SPEC_INVALID, "webhook_hosts requires webhook_secret_file: set it");
}

static bool place_webhooks(service *s, error *e)
{
    const config *c = &s->settings;
    return !c->webhook_hosts.count || delivery_check_secret(c->webhook_secret_file, e);
}

static bool init_webhooks(service *s, error *e)
{
    const config *c = &s->settings;
    if (!c->webhook_hosts.count) return true;
    host_name(s->host, sizeof s->host);
    delivery_settings settings = {
        .hosts = s->webhook_hosts,
        .host = s->host,
        .secret_file = c->webhook_secret_file,
        .calls = (int)c->webhook_calls,
        .tries = (int)c->webhook_tries,
        .timeout_s = c->webhook_timeout_s,
        .retry_s = c->webhook_retry_s,
        .retry_most_s = c->webhook_retry_most_s,
        .retry_after_s = c->webhook_retry_after_s,
        .counters = &s->calls,
    };
    s->delivery = delivery_add(s->tasks, &settings, s->q, e);
    return s->delivery != NULL;
}

/* Reads the trusted proxies and the permitted web pages. */
static bool init_network(service *s, error *e)
{
    const config *c = &s->settings;
    if (!address_ranges_read((const char *const *)c->trusted_proxies.item, c->trusted_proxies.count,
                             &s->proxies, e))
        return error_prefix(e, "trusted_proxies");
    s->pages = pages_new((const char *const *)c->page_origins.item, c->page_origins.count, e);
    for (size_t k = 0; s->pages && k < s->socket_count; k++)
        pages_add(s->pages, s->sockets[k].where, s->sockets[k].address);
    return s->pages != NULL;
}

/* Opens the web page. A service without its page still has all other functions. */
static bool init_page(service *s, error *e)
{
    (void)e;
    error why = {0};
    if (!s->settings.page) return true;
    if (!(s->page = web_page_open(&why)))
        log_write(LOG_LEVEL_INFO, "the web page is not served: %s", why.message);
    return true;
}

static bool init_openapi(service *s, error *e)
{
    (void)e;
    s->openapi = openapi_new();
    return true;
}

/* The command that permits a user, without the name; NULL: there is no settings file to change. */
static char *find_allow_command(const char *settings_file)
{
    if (settings_file && strcmp(settings_file, CONFIG_FILE) == 0) return mem_strdup("hexad --allow");
    char *file = settings_file ? realpath(settings_file, NULL) : NULL;
    char *command = file ? mem_printf("hexad --config %s --allow", file) : NULL;
    free(file);
    return command;
}

/* Maximum numbers of descriptors that are open at the same time. */
enum {
    DESCRIPTORS_OF_ESTIMATE = 9, /* for the estimate's worker while it starts */
    DESCRIPTORS_OF_HANDLER = 4,  /* a reader of the database, a directory and a file in it */
    DESCRIPTORS_OF_CALL = 4,     /* for a webhook: the connection, and descriptors of libcurl */
    DESCRIPTORS_OF_OTHERS = 32   /* checks, clean-up, copies of results, backups, the start of a worker */
};

/* The number of descriptors that the service may open besides those of connections. */
static size_t other_descriptors(const config *c)
{
    const size_t attempts = c->workers ? (size_t)c->workers : (size_t)threads_available();
    const size_t calls = c->webhook_hosts.count ? (size_t)c->webhook_calls : 0;
    return attempts * ENGINE_MAX_FDS + (size_t)c->estimates * DESCRIPTORS_OF_ESTIMATE +
           server_threads((unsigned)c->estimates) * (size_t)DESCRIPTORS_OF_HANDLER +
           calls * DESCRIPTORS_OF_CALL + DESCRIPTORS_OF_OTHERS;
}

/* Lowers the limit of connections to the number for which descriptors remain. The other parts of the service
 * get at most half of those that remain, since they rarely need all at once. */
static void limit_connections(const config *c, connections_settings *limits)
{
    const size_t limit = descriptors_limit(), open = descriptors_open(), others = other_descriptors(c);
    const size_t all = open + others + connections_descriptors(limits),
                 left = limit > open ? limit - open : 0;
    const unsigned wanted = limits->connection_limit;
    if (all <= limit || wanted == 1) return;
    while (limits->connection_limit > 1 &&
           connections_descriptors(limits) + (others < left / 2 ? others : left / 2) > left)
        limits->connection_limit--;
    log_write(
        LOG_LEVEL_WARNING,
        "connection_limit is lowered from %u to %u: the service may open %zu files (RLIMIT_NOFILE), and "
        "%zu are needed: raise LimitNOFILE= of its unit or `ulimit -Hn` to this number, or set a lower "
        "connection_limit",
        wanted, limits->connection_limit, limit, all);
}

static bool init_http(service *s, error *e)
{
    const config *c = &s->settings;
    s->allow_command = find_allow_command(c->file);
    server_settings settings = {
        .routes = &api_routes,
        .context = &s->context,
        .counters = &s->counters,
        .waiting = s->waiting,
        .counts = s->counts,
        .connections = {.connection_limit = (unsigned)c->connection_limit,
                        .admin_reserve = (unsigned)c->admin_connections,
                        .timeout_s = c->connection_timeout_s},
        .body_limit_bytes = (size_t)c->body_limit_bytes,
        .header_limit_bytes = (size_t)c->header_limit_bytes,
        .estimates = (unsigned)c->estimates,
        .thread_wait_s = c->thread_wait_s,
        .proxies = &s->proxies,
        .pages = s->pages,
        .allow_command = s->allow_command,
    };
    limit_connections(c, &settings.connections);
    ledger_limit(s->counts, LEDGER_CONNECTIONS,
                 (ledger_limits){c->user_connection_limit, settings.connections.connection_limit});
    executor_settings workers = executor_settings_of(s);
    estimator *m = NULL;
    if (c->estimates && !(m = estimator_open(&workers, (int)c->estimates, c->estimate_timeout_s, e)))
        return false;
    s->context = (http_context){
        .access = s->access,
        .counts = s->counts,
        .q = s->q,
        .x = s->x,
        .estimator = m,
        .roots = s->roots,
        .inputs = s->inputs,
        .share_inputs = s->settings.share_inputs != 0,
        .outputs = s->outputs,
        .mappings = s->mappings,
        .webhooks = s->webhook_hosts,
        .slurm_allow = (const char *const *)c->slurm_allow.item,
        .slurm_allow_count = c->slurm_allow.count,
        .work_dir = s->work_dir,
        .worker = c->worker,
        .waiting = s->waiting,
        .max_attempts = (int)c->max_attempts,
        .max_files = (size_t)c->max_files,
        .priorities = s->priorities,
        .retention_s = (int64_t)c->retention_s,
        .wait_s = c->wait_limit_s,
        .thumbnail_timeout_s = c->thumbnail_timeout_s,
        .started_ms = clock_wall_ms(),
        .counters = &s->counters,
        .calls = &s->calls,
        .frame_checks = &s->frame_checks,
        .copying = &s->copying,
        .documents = document_cache_new((size_t)c->kept_documents),
        .page = s->page,
        .openapi = s->openapi,
        .session_s = c->session_s,
    };
    s->http = server_start(&settings, s->sockets, s->socket_count, s->access, e);
    return s->http != NULL;
}

static bool place_port_file(service *s, error *e)
{
    const config *c = &s->settings;
    return !*c->port_file || directory_check_contains(c->state_dir, c->port_file) ||
           directory_check_file("port_file", c->port_file, e);
}

static bool init_port_file(service *s, error *e)
{
    char *lines = mem_strdup("");
    for (size_t k = 0; k < s->socket_count; k++) {
        log_write(LOG_LEVEL_INFO, "hexad: listening on %s", s->sockets[k].address);
        char *all = mem_printf("%s%s\n", lines, s->sockets[k].address);
        free(lines);
        lines = all;
    }
    const char *file = s->settings.port_file;
    if (*file) store_file_clear(file); /* left by a killed process */
    bool ok = !*file || store_file_write(file, lines, strlen(lines), e);
    if (!ok) error_prefix(e, "port_file");
    free(lines);
    return s->is_listed = ok;
}

/* A step of the start. Before its start function, its checks refuse what would make the service useless. The
 * checks of all steps are also those of --check-settings. They change nothing. */
static const struct step {
    const char *name;
    bool (*init)(service *s, error *e);
    bool (*values)(service *s, error *e); /* checks settings that are wrong on any host; NULL: none */
    bool (*place)(service *s, error *e);  /* checks files and directories of this host; NULL: none */
    bool only_values;                     /* init is the check of values */
} steps[] = {
    {"signals", init_signals, NULL, NULL, false},
    {"state", init_state, NULL, place_state, false},
    {"ledger", init_ledger, NULL, NULL, false},
    {"tasks", init_tasks, NULL, NULL, false},
    {"queue", init_queue, NULL, NULL, false},
    {"inputs", init_inputs, NULL, NULL, false},
    {"roots", init_roots, values_roots, place_roots, false},
    {"output_roots", init_output_roots, NULL, NULL, true},
    {"outputs", init_outputs, NULL, NULL, false},
    {"mappings", init_mappings, NULL, NULL, true},
    {"users", init_users, NULL, NULL, true},
    {"socket", init_sockets, values_sockets, place_sockets, false},
    {"access", init_access, values_access, place_access, false},
    {"groups", init_groups, NULL, NULL, false},
    {"executor", init_executor, values_executor, place_executor, false},
    {"wait_list", init_wait_list, NULL, NULL, false},
    {"notifier", init_notifier, NULL, NULL, false},
    {"webhook_hosts", init_webhook_hosts, NULL, NULL, true},
    {"webhooks", init_webhooks, values_webhooks, place_webhooks, false},
    {"background", init_background, NULL, NULL, false},
    {"supervisor", init_supervisor, NULL, NULL, false},
    {"network", init_network, NULL, NULL, true},
    {"page", init_page, NULL, NULL, false},
    {"openapi", init_openapi, NULL, NULL, false},
    {"http", init_http, NULL, NULL, false},
    {"checker", init_checker, NULL, NULL, false},
    {"port_file", init_port_file, NULL, place_port_file, false},
};

static const size_t step_count = sizeof steps / sizeof *steps;

/* Ends what the steps have started, in reverse order. */
static void end(service *s)
{
    if (s->is_listed && *s->settings.port_file) unlink(s->settings.port_file);
    checker_stop(s->checker);
    if (s->context.estimator) estimator_dismiss(s->context.estimator);
    server_stop(s->http);
    estimator_close(s->context.estimator);
    document_cache_free(s->context.documents);
    free(s->allow_command);
    openapi_free(s->openapi);
    web_page_close(s->page);
    pages_free(s->pages);
    address_ranges_clear(&s->proxies);
    if (s->is_supervised) executor_stop(s->x);
    if (s->tasks) runner_stop(s->tasks);
    delivery_free(s->delivery);
    webhook_hosts_free(s->webhook_hosts);
    notifier_free(s->notifier);
    wait_list_free(s->waiting);
    executor_free(s->x);
    farm_close(s->farm);
    control_groups_close(s->groups);
    access_close(s->access);
    for (size_t k = 0; k < s->socket_count; k++) listen_close(&s->sockets[k]);
    free(s->sockets);
    user_numbers_free(s->weights);
    user_numbers_free(s->priorities);
    path_map_free(s->mappings);
    output_place_free(s->outputs);
    mem_free_texts(s->output_root, s->output_roots.root_count);
    free(s->output_root_of_user);
    store_roots_close(s->roots);
    store_inputs_close(s->inputs);
    free(s->inputs_dir);
    queue_close(s->q);
    runner_free(s->tasks);
    ledger_free(s->counts);
    free(s->state_dir);
    free(s->work_dir);
    if (s->signals >= 0) close(s->signals);
}

static bool begin_step(const struct step *p, service *s, error *e)
{
    return (!p->values || p->values(s, e)) && (!p->place || p->place(s, e)) && p->init(s, e);
}

/* Whether the supervisor and the serving thread have advanced since the last call, which woke them. */
static bool loops_advance(service *s)
{
    const int64_t now = clock_monotonic_ms();
    const bool supervising = stall_check(&s->supervising, executor_turns(s->x), now);
    const bool serving = stall_check(&s->serving, server_turns(s->http), now);
    executor_wake(s->x);
    server_wake(s->http);
    return supervising && serving;
}

/* Pings the watchdog of the service manager, unless a loop is stuck. The missing ping makes the service
 * manager act.
 */
static void tell_manager(service *s)
{
    int64_t count[QUEUE_STATE_COUNT];
    const bool advances = loops_advance(s);
    if (!manager_is_present()) return;
    if (!advances) {
        manager_report_status("stuck");
        return;
    }
    manager_report_alive();
    if (queue_count(s->q, count, NULL))
        manager_report_status("%s%lld queued, %lld running", executor_is_draining(s->x) ? "draining: " : "",
                              (long long)count[QUEUE_QUEUED],
                              (long long)(count[QUEUE_RUNNING] + count[QUEUE_CANCELLING]));
}

/* The interval of the checks, in ms: at most half of the watchdog's time. */
static int check_interval_ms(void)
{
    const int64_t half = manager_watchdog_ms() / 2;
    return half > 0 && half < CHECK_MS ? (int)half : CHECK_MS;
}

/* Applies the settings about users, all or none. */
static bool change_users(service *s, const config *fresh, error *e)
{
    access_names users = admission_names(&fresh->unix_users), groups = admission_names(&fresh->unix_groups),
                 admins = admission_names(&fresh->unix_admins);
    user_numbers *weights, *priorities;
    if (!read_weights_and_priorities(fresh, &weights, &priorities, e)) {
        user_numbers_free(weights);
        return false;
    }
    access_change_users(s->access, &users, &groups, &admins);
    user_numbers_change(s->weights, weights);
    user_numbers_change(s->priorities, priorities);
    return true;
}

static void reload(service *s)
{
    config fresh = {0};
    config_action action;
    error e = {0};
    manager_report_reloading();
    if (config_parse(s->argc, s->argv, &fresh, &action, &e) && config_find_worker(&fresh, &e) &&
        change_users(s, &fresh, &e)) {
        bool shared = config_shares_socket(&s->settings);
        config_take_over(&s->settings, &fresh);
        store_roots_note_change(s->roots, config_lists_differ(&s->settings.input_roots, &fresh.input_roots));
        output_place_note_change(s->outputs,
                                 config_lists_differ(&s->settings.output_roots, &fresh.output_roots));
        for (size_t k = 0; config_shares_socket(&s->settings) != shared && k < s->socket_count; k++)
            listen_share(&s->sockets[k], !shared);
        log_set_level(s->settings.log_level);
        bound_results(s);
        executor_settings settings = executor_settings_of(s);
        executor_change(s->x, &settings);
        output_place_check_roots(s->outputs);
        log_write(LOG_LEVEL_INFO, "settings reloaded");
    } else {
        if (fresh.place) config_locate_error(&fresh, &e);
        log_write(LOG_LEVEL_ERROR, "cannot reload the settings, which are unchanged: %s", e.message);
    }
    config_clear(&fresh);
    manager_report_ready();
}

static void drain(service *s, bool *draining)
{
    const config *c = &s->settings;
    manager_report_stopping((*draining ? 0 : c->drain_s) + c->grace_s + LAST_WORDS_S);
    if (*draining)
        executor_force(s->x);
    else
        executor_drain(s->x, c->drain_s);
    *draining = true;
}

/* Waits for a signal and then for the end of the drain. A second signal kills the running workers. */
static void serve(service *s)
{
    bool draining = false;
    const int interval_ms = check_interval_ms();
    int64_t due_ms = clock_monotonic_ms();
    manager_report_ready();
    for (;;) {
        struct pollfd fds[] = {{.fd = s->signals, .events = POLLIN},
                               {.fd = executor_drained_fd(s->x), .events = POLLIN}};
        int64_t wait_ms = due_ms - clock_monotonic_ms();
        descriptor_wait(fds, 2, wait_ms > 0 ? (int)wait_ms : 0);
        struct signalfd_siginfo info;
        if (descriptor_take_event(s->signals, &info, sizeof info)) {
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
        if (clock_monotonic_ms() < due_ms) continue;
        tell_manager(s);
        due_ms = clock_monotonic_ms() + interval_ms;
    }
}

static int run(service *s)
{
    error e = {0};
    size_t started = 0;
    while (started < step_count && begin_step(&steps[started], s, &e)) started++;
    bool ok = started == step_count;
    if (ok) {
        serve(s);
    } else {
        config_locate_error(&s->settings, &e);
        log_write(LOG_LEVEL_ERROR, "hexad: %s", e.message);
    }
    end(s);
    if (ok) log_write(LOG_LEVEL_INFO, "hexad: ended");
    return ok ? EXIT_DRAINED : e.code == ERROR_SPEC_INVALID ? EXIT_SETTINGS : EXIT_TROUBLE;
}

/* ---- --check-settings */

static int warnings; /* of the check */

static void warn(const char *setting, const char *message)
{
    warnings++;
    terminal_text_print(stderr, "hexad: warning: %s: %s\n", setting, message);
}

static void warn_of_unknown_users(const config_list *numbers, const char *setting)
{
    for (size_t i = 0; i < numbers->count; i++) {
        char *name = mem_strndup(numbers->item[i], strcspn(numbers->item[i], ":"));
        char *message =
            mem_printf("this machine has no user %s: the number applies to tokens of this name only", name);
        if (strcmp(name, "*") != 0 && !access_check_name(name, false, NULL)) warn(setting, message);
        free(message);
        free(name);
    }
}

static void warn_of_unknown_names(const config_list *names, bool group, const char *setting)
{
    error e = {0};
    for (size_t i = 0; i < names->count; i++) {
        if (access_check_name(names->item[i], group, &e)) continue;
        char *message = mem_printf(
            "%s%s", e.message, strchr(names->item[i], ' ') ? "; separate names by a colon or a comma" : "");
        warn(setting, message);
        free(message);
    }
}

static void warn_of_roots(const service *s)
{
    const config_list *inputs = &s->settings.input_roots;
    error e = {0};
    warn_of_unreadable_inputs(inputs);
    for (size_t i = 0; i < s->output_roots.root_count; i++) {
        const char *root = s->output_root[i];
        int fd = store_output_open_root(root, &e);
        if (fd < 0 || !store_output_try_root(s->output_root_of_user[i], fd, root, &e))
            warn("output_roots", e.message);
        if (fd >= 0) close(fd);
    }
}

static bool check_values(service *s, error *e)
{
    for (size_t k = 0; k < step_count; k++) {
        const struct step *p = &steps[k];
        if (p->values && !p->values(s, e)) return false;
        if (p->only_values && !p->init(s, e)) return false;
    }
    return true;
}

/* Prints why hexad would not start on this host. */
static bool check_places(service *s)
{
    bool ok = true;
    for (size_t k = 0; k < step_count; k++) {
        error e = {0};
        if (!steps[k].place || steps[k].place(s, &e)) continue;
        config_locate_error(&s->settings, &e);
        terminal_text_print(stdout, "hexad would not start: %s\n", e.message);
        ok = false;
    }
    return ok;
}

static void warn_of_settings(service *s)
{
    const config *c = &s->settings;
    warn_of_unknown_users(&c->user_weights, "user_weights");
    warn_of_unknown_users(&c->user_priorities, "user_priorities");
    warn_of_unknown_names(&c->unix_users, false, "unix_users");
    warn_of_unknown_names(&c->unix_groups, true, "unix_groups");
    warn_of_unknown_names(&c->unix_admins, false, "unix_admins");
    visit_open_directories(c, warn);
    warn_of_roots(s);
}

/* Checks the settings as a start does, without starting, and warns of users and directories that do not exist.
 * Returns the exit status. */
static int check_settings(service *s)
{
    const config *c = &s->settings;
    error e = {0};
    if (!check_values(s, &e)) {
        config_locate_error(c, &e);
        terminal_text_print(stderr, "hexad: %s\n", e.message);
        return EXIT_SETTINGS;
    }
    warn_of_settings(s);
    fflush(stderr);
    if (!check_places(s)) return c->strict ? EXIT_TROUBLE : EXIT_SUCCESS;
    char *count =
        warnings ? mem_printf("; %d warning%s", warnings, warnings == 1 ? "" : "s") : mem_strdup("");
    if (c->file)
        terminal_text_print(stdout, "no faults in the settings of %s%s\n", c->file, count);
    else
        terminal_text_print(
            stdout, "no settings file was read; no faults in the options and the defaults%s\n", count);
    free(count);
    return EXIT_SUCCESS;
}

int main(int argc, char **argv)
{
    descriptors_prepare();
    mem_begin_threads();
    service s = {
        .argc = argc,
        .argv = argv,
        .signals = -1,
        .frame_checks = PTHREAD_MUTEX_INITIALIZER,
        .supervising = {.loop = "the supervisor", .effect = "jobs neither start nor end"},
        .serving = {.loop = "the serving thread", .effect = "requests are not answered"},
    };
    config_action action;
    error e = {0};
    const bool journal = manager_has_journal();
    if (journal) log_set_journal(manager_journal);
    if (!config_parse(argc, argv, &s.settings, &action, &e)) {
        if (journal)
            log_write(LOG_LEVEL_ERROR, "hexad: %s", e.message);
        else
            terminal_text_print(stderr, "hexad: %s\n", e.message);
        return EXIT_SETTINGS;
    }
    int status = EXIT_SUCCESS;
    log_set_level(s.settings.log_level);
    umask(0077); /* jobs and results are private to the service */
    switch (action) {
    case CONFIG_HELP:
        config_print_help(stdout, s.settings.help_all);
        break;
    case CONFIG_VERSION:
        puts(PACKAGE_STRING);
        break;
    case CONFIG_SAMPLE:
        config_print_sample(stdout);
        break;
    case CONFIG_ADOPT:
        s.adopt = true;
        status = run(&s);
        break;
    case CONFIG_RUN:
        status = run(&s);
        break;
    case CONFIG_BACKUP:
        status = maintenance_back_up(&s.settings);
        break;
    case CONFIG_ALLOW:
    case CONFIG_DENY:
        status = admission_change(&s.settings, action);
        break;
    case CONFIG_OPEN_PORT:
        status = open_port(&s.settings);
        break;
    case CONFIG_CHECK_SETTINGS:
        status = check_settings(&s);
        end(&s);
        break;
    case CONFIG_CHECK:
        status = maintenance_check(&s.settings);
        break;
    }
    config_clear(&s.settings);
    return status;
}

// SPDX-License-Identifier: Apache-2.0
#include "service/slurm/slurm.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "base/json/json.h"
#include "service/slurm/engine_data.h"
#include "files/file.h"

/* Interval, in ms, between two inspections of the files of the attempts. */
#define LOOK_MS 500
/* A larger nice value means a lower priority in Slurm. Priorities of hexad rise from -1000 to 1000. */
#define HIGHEST_PRIORITY 1000
/* Added to the remaining time of an attempt, so that the worker ends by itself before Slurm ends it. */
#define MORE_TIME_S 60

static const char *find_account(const slurm_settings *settings, const char *owner)
{
    const char *otherwise = NULL;
    for (size_t i = 0; i < settings->account_count; i++) {
        const char *row = settings->accounts[i], *equals = strchr(row, '=');
        size_t length = (size_t)(equals - row);
        if (owner && strlen(owner) == length && strncmp(owner, row, length) == 0) return equals + 1;
        if (length == 1 && *row == '*') otherwise = equals + 1;
    }
    return otherwise;
}

static char *add_need(char *needs, const char *option)
{
    char *more = mem_printf("%s\n%s", needs, option);
    free(needs);
    return more;
}

/* The options of the Slurm job. sbatch uses the last of repeated options, so those of the spec take
 * precedence. `root`: the root of the spec. */
static char *describe_needs(const slurm_settings *settings, const engine_request *r, const json_at *root)
{
    const char *account = find_account(settings, r->owner);
    char *needs =
        mem_printf("--cpus-per-task=%d\n--mem=%lld\n--nice=%d%s%s", r->threads, (long long)r->memory_mb,
                   HIGHEST_PRIORITY - r->priority, account ? "\n--account=" : "", account ? account : "");
    for (size_t i = 0; i < settings->option_count; i++) needs = add_need(needs, settings->options[i]);
    json_at part = json_member(root, "queue"), own = json_member(&part, "slurm");
    for (json_at option = json_first(&own); option.node; option = json_next(&option))
        needs = add_need(needs, json_string(option, ""));
    return needs;
}

static bool is_small(const slurm_settings *settings, const json_at *root)
{
    json_at sampling = json_member(root, "sampling");
    double count = json_number(json_member(&sampling, "count"), 0);
    return count > 0 && count <= (double)settings->small_count;
}

static engine_attempt *make(slurm *s, const engine_request *r)
{
    engine_attempt *a = mem_alloc(sizeof *a);
    json *document = json_parse(r->spec, strlen(r->spec), NULL);
    json_at root = json_root(document);
    a->place = s;
    a->name = mem_strdup(strrchr(r->directory, '/') + 1);
    a->directory = mem_printf("%s/%s", s->farm, a->name);
    a->out = mem_strdup(r->directory);
    a->needs = describe_needs(&s->settings, r, &root);
    a->timeout_s = r->timeout_s > 0 ? r->timeout_s + MORE_TIME_S : 0;
    a->chunk = r->chunk;
    a->small = r->chunk < 0 && is_small(&s->settings, &root);
    a->began_ms = INT64_MAX;
    a->ending = (engine_ending){.exit_status = -1, .signal = -1};
    json_free(document);
    return a;
}

static void attempt_free(engine_attempt *a)
{
    free(a->name);
    free(a->directory);
    free(a->out);
    free(a->needs);
    free(a->fresh);
    free(a->newest);
    free(a->ending.last_words);
    free(a);
}

/* Passes the attempt to the tasks. `batch`: it may have been submitted already; NULL: it has not. */
static void take_up(slurm *s, engine_attempt *a, const engine_request *r, const attempt_files_batch *batch)
{
    pthread_mutex_lock(&s->mutex);
    if (!s->prefix) s->prefix = mem_printf("hexad-%s-", r->instance);
    s->wake_fd = r->wake_fd;
    if (batch) {
        slurm_batch *b = slurm_batch_find(s, batch->name);
        if (!b) b = slurm_batch_new(s, batch->name, batch->number);
        slurm_enter(a, b, (size_t)batch->task);
    }
    TAILQ_INSERT_TAIL(&s->attempts, a, link);
    s->attempt_count++;
    a->since_ms = s->newest_ms = clock_monotonic_ms();
    s->more = r->more;
    runner_wake(s->commands);
    pthread_mutex_unlock(&s->mutex);
}

static engine_attempt *start(void *place, const engine_request *request, error *e)
{
    slurm *s = place;
    engine_attempt *a = make(s, request);
    /* files of an attempt with this number that is missing in a restored database */
    store_remove(a->directory, NULL);
    if (attempt_files_begin(a->directory, request, e)) {
        take_up(s, a, request, NULL);
        return a;
    }
    attempt_free(a);
    return NULL;
}

static bool runs_on(void *place, const char *directory)
{
    slurm *s = place;
    char *files = mem_printf("%s/%s", s->farm, strrchr(directory, '/') + 1);
    bool found = attempt_files_exist(files);
    free(files);
    return found;
}

/* Submits an attempt that had not been submitted. Searches Slurm's queue for an attempt that may have
 * been. */
static engine_attempt *resume(void *place, const engine_request *request, error *e)
{
    (void)e;
    attempt_files_batch batch = {0};
    engine_attempt *a = make(place, request);
    a->resumed = true;
    take_up(place, a, request, attempt_files_read_batch(a->directory, &batch) ? &batch : NULL);
    return a;
}

/* Does not free the attempt, since the task of the files may use it. slurm_close frees it. */
static void leave(engine_attempt *a)
{
    slurm *s = a->place;
    pthread_mutex_lock(&s->mutex);
    a->left = true;
    pthread_mutex_unlock(&s->mutex);
}

/* Takes over `directory`. The caller holds the mutex. */
static void put_trash(slurm *s, char *directory)
{
    s->trash = mem_resize(s->trash, (s->trash_count + 1) * sizeof *s->trash);
    s->trash[s->trash_count++] = directory;
}

/* The caller holds the mutex. */
static bool has_attempt(const slurm *s, const char *name)
{
    const engine_attempt *a;
    TAILQ_FOREACH (a, &s->attempts, link)
        if (strcmp(a->name, name) == 0) return true;
    return false;
}

static void sweep(void *place)
{
    slurm *s = place;
    DIR *farm = opendir(s->farm);
    if (!farm) return;
    pthread_mutex_lock(&s->mutex);
    for (const struct dirent *d; (d = readdir(farm));)
        if (strcmp(d->d_name, ".") != 0 && strcmp(d->d_name, "..") != 0 && !has_attempt(s, d->d_name))
            put_trash(s, mem_printf("%s/%s", s->farm, d->d_name));
    pthread_mutex_unlock(&s->mutex);
    closedir(farm);
}

static int64_t began_ms(const engine_attempt *a)
{
    pthread_mutex_lock(&a->place->mutex);
    int64_t began = a->began_ms;
    pthread_mutex_unlock(&a->place->mutex);
    return began;
}

static void find_host(const engine_attempt *a, char host[ENGINE_HOST_SIZE])
{
    pthread_mutex_lock(&a->place->mutex);
    memcpy(host, a->host, sizeof a->host);
    pthread_mutex_unlock(&a->place->mutex);
}

static const char *identify(const engine_attempt *a)
{
    return a->name;
}

static size_t watch(const engine_attempt *a, struct pollfd fds[ENGINE_MAX_FDS])
{
    (void)a;
    (void)fds;
    return 0;
}

static bool poll_attempt(engine_attempt *a, const char **progress)
{
    pthread_mutex_lock(&a->place->mutex);
    bool ended = a->ended;
    *progress = a->fresh;
    if (a->fresh) {
        free(a->newest);
        a->newest = a->fresh;
        a->fresh = NULL;
    }
    pthread_mutex_unlock(&a->place->mutex);
    return ended;
}

static void cancel(engine_attempt *a, bool force)
{
    slurm *s = a->place;
    pthread_mutex_lock(&s->mutex);
    slurm_forsake(a);
    a->forced |= force;
    slurm_list_soon(s);
    runner_wake(s->files);
    pthread_mutex_unlock(&s->mutex);
}

static void settle(engine_attempt *a, engine_ending *ending)
{
    slurm *s = a->place;
    error e = {0};
    *ending = a->ending;
    a->ending.last_words = NULL;
    if (a->began_ms != INT64_MAX && !a->resumed) ending->waited_ms = a->began_ms - a->since_ms;
    if (!ending->last_words) ending->last_words = mem_strdup("");
    if (!ending->loss && !attempt_files_deliver(a->directory, a->out, &e)) {
        ending->loss = ENGINE_INTERRUPTED;
        snprintf(ending->why, sizeof ending->why, "%.250s", e.message);
    }
    pthread_mutex_lock(&s->mutex);
    TAILQ_REMOVE(&s->attempts, a, link);
    s->attempt_count--;
    s->quiet = 0;
    put_trash(s, mem_strdup(a->directory));
    pthread_mutex_unlock(&s->mutex);
    attempt_free(a);
}

const engine engine_slurm = {"slurm",   start,    resume, runs_on,      leave,  sweep, began_ms,
                             find_host, identify, watch,  poll_attempt, cancel, settle};

/* ---- the tasks */

/* The time of the next listing. */
static int64_t next_listing(slurm *s)
{
    pthread_mutex_lock(&s->mutex);
    int64_t due_ms = s->prefix && s->quiet < 3 ? s->list_due_ms : RUNNER_WHEN_WOKEN;
    pthread_mutex_unlock(&s->mutex);
    return due_ms;
}

static int64_t run_commands(void *context)
{
    slurm *s = context;
    int64_t submit_ms = slurm_submit(s);
    if (clock_monotonic_ms() >= next_listing(s)) slurm_list(s);
    int64_t list_ms = next_listing(s);
    return list_ms < submit_ms ? list_ms : submit_ms;
}

/* Removes the files of an attempt after renaming their directory. Nodes find attempts by their names; if the
 * claim were removed first, a node could claim the attempt again. */
static bool remove_files(const slurm *s, const char *directory, error *e)
{
    char *aside = mem_printf("%s/.old-%s", s->farm, strrchr(directory, '/') + 1);
    bool moved = rename(directory, aside) == 0;
    bool ok = store_remove(moved ? aside : directory, e);
    free(aside);
    return ok;
}

static void empty_trash(slurm *s)
{
    pthread_mutex_lock(&s->mutex);
    char **trash = s->trash;
    size_t count = s->trash_count;
    s->trash = NULL;
    s->trash_count = 0;
    pthread_mutex_unlock(&s->mutex);
    for (size_t i = 0; i < count; i++) {
        error e = {0};
        /* an orphaned worker may write there; the next start of hexad removes the rest */
        if (!remove_files(s, trash[i], &e))
            log_write(LOG_LEVEL_WARNING, "cannot remove the files of an attempt: %s", e.message);
        free(trash[i]);
    }
    free(trash);
}

static int64_t run_files(void *context)
{
    slurm *s = context;
    slurm_inspect(s);
    empty_trash(s);
    return clock_monotonic_ms() + LOOK_MS;
}

static void place_free(slurm *s)
{
    pthread_mutex_destroy(&s->mutex);
    for (engine_attempt *a; (a = TAILQ_FIRST(&s->attempts));) { /* attempts that were left */
        TAILQ_REMOVE(&s->attempts, a, link);
        slurm_leave(a);
        attempt_free(a);
    }
    attempt_files_clear_names(&s->strays);
    free(s->farm);
    free(s->prefix);
    free(s);
}

slurm *slurm_open(const slurm_settings *settings, runner *to, error *e)
{
    slurm *s = mem_alloc(sizeof *s);
    s->settings = *settings;
    s->farm = mem_printf("%s/" ATTEMPT_FILES_FARM, settings->work_dir);
    TAILQ_INIT(&s->attempts);
    s->wake_fd = -1;
    s->serial = (uint64_t)clock_wall_ms();
    pthread_mutex_init(&s->mutex, NULL);
    if (!store_directory_create(s->farm, e)) {
        place_free(s);
        return NULL;
    }
    s->commands = runner_add(to, "slurm", run_commands, s);
    s->files = runner_add(to, "slurm-files", run_files, s);
    return s;
}

void slurm_close(slurm *s)
{
    if (!s) return;
    empty_trash(s);
    place_free(s);
}

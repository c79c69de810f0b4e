// SPDX-License-Identifier: Apache-2.0
#include "service/executor/executor.h"

#include <assert.h>
#include <errno.h>
#include <inttypes.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "base/core/background.h"
#include "base/core/clock.h"
#include "base/core/descriptor_wait.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "base/core/threads.h"
#include "service/executor/host.h"
#include "service/executor/progress_ring.h"
#include "service/executor/settlement.h"
#include "service/executor/slot.h"
#include "service/executor/storage.h"
#include "service/results/instance_check.h"
#include "service/results/inventory.h"
#include "service/results/kept_result.h"
#include "service/results/output_cleanup.h"
#include "service/results/own_report.h"
#include "service/results/redelivery.h"
#include "service/results/result.h"
#include "service/results/retention.h"
#include "files/file.h"

/* Maximum delay between two tries while no worker can be started, because the program is being replaced or
 * memory is exhausted. */
#define START_WAIT_MOST_MS 30000
/* Interval, in ms, between checks of the state directory while it is lost, full or cannot be written. */
#define SPACE_WAIT_MS 1000
/* The same while it is in order and no job starts. */
#define STORAGE_WATCH_MS 10000

/* Claims between two polls of running attempts: thousands may be claimed, and ended attempts have to be
 * settled meanwhile. */
#define CLAIMS_A_TURN 16

/* Fraction of the machine's memory for attempts if host_memory_mb is not set. */
#define HOST_MEMORY_SHARE 0.9

/* Default limits of an attempt on another host; the engine manages the resources of its hosts. */
#define NODE_THREADS 256
#define NODE_MEMORY_MB (4 << 20)

/* Maximum number of jobs that wait for the results of equal jobs, which takes milliseconds each; others are
 * claimed as usual. */
#define REPEATS_MOST 256

struct executor {
    executor_settings settings;
    char *state_dir, *work_dir, *worker, **input_roots;
    char instance[ULID_SIZE];
    char host[HOST_NAME_MAX + 1];
    settlement_place place;
    runner_task *pieces; /* NULL: not added */
    meter meter;
    slot_context context;
    store_roots *roots; /* the input roots, open */
    int threads;        /* maximum of an attempt; for processes of this host, of all attempts together */
    int64_t memory_mb;  /* maximum of an attempt; for processes of this host, of all attempts together */
    int64_t times;      /* number of hosts with these resources: 1 with processes of this host */
    queue *q;
    progress_ring *progress;
    retention *retention;
    output_cleanup *cleanup;
    redelivery *redelivery;
    storage storage;
    pthread_t thread;
    int wake_fd, drained_fd;
    atomic_bool closed, draining, forcing, stopping;
    atomic_uint_fast64_t turns;
    _Atomic int64_t drain_ms; /* time at which a drain stops running attempts, monotonic */

    pthread_mutex_t order;     /* held over a claim until a slot has it, and over a command */
    pthread_mutex_t mutex;     /* guards the next two members */
    executor_settings changed; /* the settings of executor_change, until the supervisor takes them */
    bool has_changed;
    char repeat[REPEATS_MOST][ULID_SIZE]; /* jobs of executor_offer; guarded by the mutex */
    size_t repeat_count;
    size_t workers; /* slots that may start workers */
    size_t resumed; /* number of slots that started with attempts of an earlier daemon */
    /* one more than workers: the last slot is for jobs that get the result of an equal job */
    size_t slot_count;
    slot **slots;

    /* supervisor: a task whose chunk has more to claim, for an engine that runs the tasks of a chunk; id
     * "": none */
    struct {
        char id[ULID_SIZE];
        int number;
    } chunk;
    bool may_claim;        /* supervisor: something may have become claimable */
    clock_watch watch;     /* supervisor */
    int64_t due_ms;        /* supervisor: time at which the next delayed task is due, wall clock */
    int64_t claim_ms;      /* supervisor: no claim before this time, after a failure; 0: at once */
    int64_t start_wait_ms; /* supervisor: doubles while no worker starts */
    int64_t storage_ms;    /* supervisor: time of the next check of the state directory, monotonic */
};

static int64_t least(int64_t a, int64_t b)
{
    return a < b ? a : b;
}

static void signal_fd(int fd)
{
    ssize_t written = write(fd, &(uint64_t){1}, sizeof(uint64_t));
    (void)written; /* a full counter is readable, which is enough */
}

void executor_wake(executor *x)
{
    signal_fd(x->wake_fd);
    retention_wake(x->retention);
}

bool executor_delete(executor *x, const char *id, bool *found, bool *deleted, error *e)
{
    return retention_delete(x->retention, id, found, deleted, e);
}

void executor_note_sent(executor *x, const fetches_result *of, size_t index, size_t count)
{
    retention_note_sent(x->retention, of, index, count);
}

uint64_t executor_count_evicted(const executor *x)
{
    return retention_count_evicted(x->retention);
}

/* Steps a slot and handles the consequences for other slots. */
static void serve(executor *x, slot *s)
{
    unsigned news = slot_step(s);
    if (news & SLOT_NOT_WRITTEN) executor_note_failed_write(x);
    if (news & SLOT_STARTED) x->start_wait_ms = 0;
    if (news & SLOT_NOT_STARTED) {
        /* the next worker probably fails to start for the same reason */
        x->start_wait_ms =
            x->start_wait_ms ? least(2 * x->start_wait_ms, START_WAIT_MOST_MS) : RUNNER_RETRY_MS;
        x->claim_ms = clock_monotonic_ms() + x->start_wait_ms;
    }
    if (news & SLOT_FREED) {
        x->may_claim = true;
        retention_wake(x->retention); /* the job may be kept for a short time only */
    }
}

/* Resources that running attempts leave free. */
static queue_resources find_free(const executor *x)
{
    queue_resources free_now = {
        .threads = (int)(x->threads * x->times),
        .all_threads = x->threads,
        .memory_mb = x->memory_mb * x->times,
        .all_memory_mb = x->memory_mb,
        .most_of_owner = (int)ledger_get_limits(x->settings.counts, LEDGER_ATTEMPTS).holder,
        .weights = x->settings.weights,
    };
    for (size_t i = 0; i < x->slot_count; i++) {
        slot_usage usage = slot_get_usage(x->slots[i]);
        free_now.threads -= usage.threads;
        free_now.memory_mb -= usage.memory_mb;
    }
    return free_now;
}

/* Claims the next task of the chunk that was begun, otherwise the next task in turn. */
static bool claim_next(executor *x, const queue_resources *free_now, queue_claimed *claimed, bool *found,
                       error *e)
{
    bool ok = !*x->chunk.id ||
              queue_claim_in_chunk(x->q, free_now, x->chunk.id, x->chunk.number, claimed, found, e);
    if (ok && !*found) ok = queue_claim(x->q, free_now, claimed, found, e);
    *x->chunk.id = '\0';
    if (ok && *found && claimed->more && x->settings.engine->resume) {
        memcpy(x->chunk.id, claimed->job.id, sizeof x->chunk.id);
        x->chunk.number = claimed->task.number;
    }
    return ok;
}

/* Claims a task for a free slot. `order` is held over the claim and slot_take, so that a cancellation finds
 * either a queued task or its slot. */
static bool claim(executor *x, slot *s, queue_resources *free_now)
{
    error e = {0};
    bool found = false;
    queue_claimed claimed = {0};
    pthread_mutex_lock(&x->order);
    if (claim_next(x, free_now, &claimed, &found, &e)) {
        if (found) {
            int width = claimed.job.threads;
            int64_t memory_mb = claimed.job.memory_mb;
            executor_size(x, &width, &memory_mb, NULL); /* the slot fails a task that can never fit */
            meter_note_claim(&x->meter, &claimed);
            slot_take(s, &claimed, width, memory_mb);
            free_now->threads -= width;
            free_now->memory_mb -= memory_mb;
        }
    } else {
        log_write(LOG_LEVEL_DEBUG, "cannot claim a job: %s", e.message); /* the queue has logged it */
        x->claim_ms = runner_retry_time();
    }
    pthread_mutex_unlock(&x->order);
    return found;
}

/* Called when no task can be claimed: reads the time at which the next delayed task is due. */
static void note_due(executor *x)
{
    x->may_claim = false;
    if (!queue_next_due(x->q, &x->due_ms, NULL)) x->due_ms = clock_wall_ms() + RUNNER_RETRY_MS;
}

/* Whether attempts may start: the state directory is at its path, has space and can be written. */
static bool may_start(executor *x)
{
    return queue_has_place(x->q, NULL) && storage_may_start(&x->storage);
}

/* Checks the state directory, also while no job starts: what is wrong is logged, and readiness follows. */
static void watch_storage(executor *x)
{
    int64_t now = clock_monotonic_ms();
    if (now < x->storage_ms && !atomic_load(&x->storage.suspect)) return;
    bool ok = may_start(x) && storage_can_write(&x->storage, NULL);
    x->storage_ms = now + (ok ? STORAGE_WATCH_MS : SPACE_WAIT_MS);
}

static void fill_slots(executor *x)
{
    if (clock_was_set_back(&x->watch)) {
        x->may_claim = true;
        if (!queue_shorten_waits(x->q, NULL)) x->watch = CLOCK_WATCH; /* tried again later */
    }
    if (x->due_ms <= clock_wall_ms()) x->may_claim = true;
    if (!x->may_claim) return;
    queue_resources free_now = find_free(x);
    int claims = 0;
    for (size_t i = 0; x->may_claim && i < x->workers && claims < CLAIMS_A_TURN; i++) {
        slot *s = x->slots[i];
        if (!slot_is_free(s)) continue;
        if (!executor_takes_jobs(x) || clock_monotonic_ms() < x->claim_ms) break;
        if (!may_start(x)) {
            x->claim_ms = clock_monotonic_ms() + SPACE_WAIT_MS;
            break;
        }
        if (!claim(x, s, &free_now)) {
            if (!x->claim_ms) note_due(x); /* otherwise the claim failed and is tried again at claim_ms */
            break;
        }
        claims++;
        serve(x, s);
        if (slot_is_free(s)) free_now = find_free(x);
    }
    /* the tasks of a chunk that are claimed later run when these have ended */
    if (claims < CLAIMS_A_TURN) *x->chunk.id = '\0';
}

/* Takes the next offered job. False: there is none. */
static bool next_repeat(executor *x, char id[ULID_SIZE])
{
    pthread_mutex_lock(&x->mutex);
    bool any = x->repeat_count > 0;
    if (any) {
        memcpy(id, x->repeat[0], ULID_SIZE);
        memmove(x->repeat, x->repeat + 1, --x->repeat_count * sizeof *x->repeat);
    }
    pthread_mutex_unlock(&x->mutex);
    return any;
}

/* Gives jobs the results of equal ones while all other slots are busy. Jobs that are not claimed here are
 * claimed later. The next turn continues, so that a user who offers jobs without end delays no other. */
static void answer_repeats(executor *x)
{
    char id[ULID_SIZE];
    slot *s = x->slots[x->workers];
    bool held = false;
    int taken = 0;
    while (slot_is_free(s) && taken < CLAIMS_A_TURN && next_repeat(x, id)) {
        if (++taken == CLAIMS_A_TURN) executor_wake(x);
        error e = {0};
        bool found = false;
        queue_claimed claimed = {0};
        if (!executor_takes_jobs(x) || !may_start(x) || !queue_is_held(x->q, &held, &e) || held) continue;
        pthread_mutex_lock(&x->order);
        if (queue_claim_job(x->q, id, &claimed, &found, &e) && found) slot_take_repeat(s, &claimed);
        pthread_mutex_unlock(&x->order);
        if (found) serve(x, s);
    }
}

/* Waits until a slot or a claim has something to do. */
static void wait_for_news(executor *x, struct pollfd *fds)
{
    size_t count = 0;
    int64_t due = x->storage_ms;
    bool has_free_slot = false;
    fds[count++] = (struct pollfd){.fd = x->wake_fd, .events = POLLIN};
    for (size_t i = 0; i < x->slot_count; i++) {
        slot *s = x->slots[i];
        has_free_slot |= i < x->workers && slot_is_free(s);
        due = least(due, slot_due(s));
        count += slot_watch(s, &fds[count]);
    }
    if (has_free_slot && executor_takes_jobs(x)) {
        if (x->may_claim) due = least(due, x->claim_ms); /* 0: at once */
        if (x->due_ms < INT64_MAX) due = least(due, clock_monotonic_ms() + x->due_ms - clock_wall_ms());
    }
    int64_t wait = due - clock_monotonic_ms();
    /* one millisecond more: due is rounded, and waking early would be useless */
    descriptor_wait(fds, count, wait < 0 ? 1 : (int)wait + 1);
    uint64_t times;
    if (fds[0].revents && descriptor_take_event(x->wake_fd, &times, sizeof times)) x->may_claim = true;
    if (x->claim_ms && clock_monotonic_ms() >= x->claim_ms) x->claim_ms = 0;
}

static bool is_idle(const executor *x)
{
    for (size_t i = 0; i < x->slot_count; i++)
        if (!slot_is_free(x->slots[i])) return false;
    return true;
}

static void set_limits(slot_context *context, const executor_settings *settings)
{
    context->file_mb = settings->file_mb;
    context->timeout_s = settings->timeout_s;
    context->stall_s = settings->stall_s;
    context->grace_s = settings->grace_s;
}

/* Applies requests of other threads, which wake the supervisor after a request. */
static void take_changes(executor *x)
{
    pthread_mutex_lock(&x->mutex);
    if (x->has_changed) set_limits(&x->context, &x->changed);
    x->has_changed = false;
    pthread_mutex_unlock(&x->mutex);
    x->context.forcing = atomic_load(&x->forcing);
    x->context.draining = atomic_load(&x->draining);
    x->context.drain_ms = atomic_load(&x->drain_ms);
}

static void *supervise(void *argument)
{
    executor *x = argument;
    struct pollfd *fds = mem_alloc((1 + ENGINE_MAX_FDS * x->slot_count) * sizeof *fds);
    pthread_setname_np(pthread_self(), "supervisor"); /* helps to debug a process that hangs */
    for (bool first = true;; first = false) {
        bool was_idle;
        atomic_fetch_add(&x->turns, 1);
        take_changes(x);
        for (size_t i = 0; i < x->slot_count; i++) serve(x, x->slots[i]);
        if (first && x->settings.engine->sweep) x->settings.engine->sweep(x->settings.engine_place);
        watch_storage(x);
        fill_slots(x);
        answer_repeats(x);
        was_idle = is_idle(x);
        if (was_idle && atomic_load(&x->draining)) signal_fd(x->drained_fd);
        if (was_idle && atomic_load(&x->stopping)) break;
        wait_for_news(x, fds);
    }
    free(fds);
    return NULL;
}

static bool make_places(const executor *x, error *e)
{
    char *attempts = mem_printf("%s/attempts", x->work_dir);
    char *results = mem_printf("%s/results", x->work_dir);
    bool ok = store_directory_create(attempts, e) && store_directory_create(results, e);
    free(attempts);
    free(results);
    return ok;
}

void executor_free(executor *x)
{
    if (!x) return;
    if (x->pieces) queue_wake_no_more(x->place.q, x->pieces);
    if (x->wake_fd >= 0) close(x->wake_fd);
    if (x->drained_fd >= 0) close(x->drained_fd);
    mem_free_texts(x->input_roots, x->settings.input_root_count);
    free(x->state_dir);
    free(x->work_dir);
    free(x->worker);
    for (size_t i = 0; i < x->slot_count; i++) slot_free(x->slots[i]);
    free(x->slots);
    retention_free(x->retention);
    redelivery_free(x->redelivery);
    output_cleanup_free(x->cleanup);
    store_roots_close(x->roots);
    progress_ring_free(x->progress);
    pthread_mutex_destroy(&x->order);
    pthread_mutex_destroy(&x->mutex);
    free(x);
}

int64_t executor_most_memory_mb(const executor_settings *settings)
{
    if (settings->host_memory_mb > 0) return settings->host_memory_mb;
    return settings->engine->resume ? NODE_MEMORY_MB
                                    : (int64_t)((double)host_memory_mb() * HOST_MEMORY_SHARE);
}

/* For an engine whose attempts run elsewhere: their number is the only limit here. */
static void set_resources_of_nodes(executor *x, const executor_settings *settings)
{
    x->threads = settings->threads > 0 ? settings->threads : NODE_THREADS;
    x->times = settings->workers;
}

static void copy_settings(executor *x, const executor_settings *settings)
{
    x->settings = *settings;
    x->state_dir = mem_strdup(settings->state_dir);
    x->work_dir = mem_strdup(settings->work_dir);
    x->worker = mem_strdup(settings->worker);
    x->input_roots = mem_alloc(settings->input_root_count * sizeof *x->input_roots);
    for (size_t i = 0; i < settings->input_root_count; i++)
        x->input_roots[i] = mem_strdup(settings->input_roots[i]);
    x->threads = settings->threads > 0 ? settings->threads : threads_available();
    x->memory_mb = executor_most_memory_mb(settings);
    if (settings->host_memory_mb > 0 && settings->memory_mb > x->memory_mb)
        log_write(LOG_LEVEL_WARNING,
                  "memory_mb (%" PRId64 ") is more than host_memory_mb (%" PRId64
                  "): jobs without limits.memory_mb get %" PRId64 " MiB, and one of them runs at a time",
                  settings->memory_mb, x->memory_mb, x->memory_mb);
    x->workers = (size_t)(settings->workers > 0 ? settings->workers : x->threads);
    x->times = 1;
    if (settings->engine->resume) set_resources_of_nodes(x, settings);
    x->slot_count = x->workers + 1;
    x->slots = mem_alloc(x->slot_count * sizeof *x->slots);
    for (size_t i = 0; i < x->slot_count; i++) x->slots[i] = slot_new(&x->context);
    host_name(x->host, sizeof x->host);
    x->storage = (storage){
        .state_dir = x->state_dir, .work_dir = x->work_dir, .floor_bytes = settings->free_space_mb << 20};
    x->place = (settlement_place){
        .q = x->q,
        .work_dir = x->work_dir,
        .host = x->host,
        .meter = &x->meter,
        .backoff = {settings->retry_s, settings->retry_most_s},
        .storage_retries = settings->storage_retries,
        .max_interruptions = settings->max_interruptions,
    };
}

/* Call it after all members to which the context refers are set. */
static void set_context(executor *x)
{
    const executor_settings *settings = &x->settings;
    x->context = (slot_context){
        .place = &x->place,
        .engine = settings->engine,
        .engine_place = settings->engine_place,
        .instance = x->instance,
        .worker = x->worker,
        .input_roots = (const char *const *)x->input_roots,
        .input_root_count = settings->input_root_count,
        .roots = x->roots,
        .inputs = settings->inputs,
        .outputs = settings->outputs,
        .progress = x->progress,
        .sandbox = settings->sandbox,
        .groups = settings->groups,
        .cache = settings->cache,
        .memory_mb = x->memory_mb,
        .wake_fd = x->wake_fd,
    };
    set_limits(&x->context, settings);
}

/* A settlement_keep: a slot takes over the attempt if the engine can resume it. */
static bool keep_running(void *keeper, const queue_claimed *c)
{
    executor *x = keeper;
    const engine *runs = x->settings.engine;
    slot *s = x->resumed < x->workers ? x->slots[x->resumed] : NULL;
    if (!s) return false;
    char *directory = result_attempt_directory(x->work_dir, c->job.id, c->task.frame, c->task.attempt);
    char *results = result_directory(x->work_dir, c->job.id, c->task.frame);
    bool on = access(results, F_OK) != 0 && runs->runs_on(x->settings.engine_place, directory);
    free(directory);
    free(results);
    int width = c->job.threads;
    int64_t memory_mb = c->job.memory_mb;
    executor_size(x, &width, &memory_mb, NULL);
    if (on) slot_take_resumed(s, c, width, memory_mb);
    x->resumed += on;
    return on;
}

/* Makes the queue and the directories consistent, before anything runs. */
static bool recover(executor *x, error *e)
{
    char boot_id[HOST_BOOT_ID_SIZE];
    queue_instance last = {0};
    bool found = false;
    host_boot_id(boot_id);
    if (!queue_get_instance(x->q, &last, &found, e)) return false;
    bool restarted = *last.boot_id && *boot_id && strcmp(last.boot_id, boot_id) != 0;
    if (!settlement_recover(&x->place, restarted, x->settings.engine->resume ? keep_running : NULL, x, e) ||
        !own_report_correct_all(x->q, x->work_dir, e) ||
        !inventory_take(x->q, x->work_dir, x->settings.adopt, e) ||
        !instance_check_join(x->q, x->work_dir, boot_id, e) || !queue_get_instance(x->q, &last, &found, e))
        return false;
    snprintf(x->instance, sizeof x->instance, "%s", last.id);
    return true;
}

/* Continues changes of many tasks. Tasks may be ready afterwards. */
static int64_t do_piece(void *context)
{
    executor *x = context;
    bool more = false;
    if (!queue_do_piece(x->q, &more, NULL)) return runner_retry_time();
    if (more) executor_wake(x);
    return more ? 0 : RUNNER_WHEN_WOKEN;
}

executor *executor_open(const executor_settings *settings, queue *q, runner *to, error *e)
{
    assert(settings->engine && settings->worker);
    executor *x = mem_alloc(sizeof *x);
    x->q = q;
    copy_settings(x, settings);
    x->progress = progress_ring_new();
    x->may_claim = true;
    x->due_ms = INT64_MAX;
    x->watch = CLOCK_WATCH;
    pthread_mutex_init(&x->order, NULL);
    pthread_mutex_init(&x->mutex, NULL);
    x->wake_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    x->drained_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    bool ok = true;
    if (x->wake_fd < 0 || x->drained_fd < 0)
        ok = error_set(e, ERROR_INTERNAL, "cannot create an event descriptor: %s", strerror(errno));
    const char *sent = settings->inputs ? store_inputs_directory(settings->inputs) : NULL;
    x->roots = ok ? store_roots_open(sent, settings->input_roots, settings->input_root_count, e) : NULL;
    set_context(x);
    ok = x->roots && make_places(x, e);
    if (ok) storage_check(&x->storage); /* removes what a kill has left of a probe, before the inventory */
    ok = ok && recover(x, e) &&
         output_cleanup_add(to, q, output_place_roots(settings->outputs), &x->cleanup, e);
    if (!ok) {
        executor_free(x);
        return NULL;
    }
    if (settings->outputs)
        x->redelivery = redelivery_add(to, q, settings->counts, settings->outputs, x->work_dir);
    x->pieces = runner_add(to, "pieces", do_piece, x);
    queue_wake_on_change(q, x->pieces);
    x->retention = retention_add(to, q, x->work_dir, settings->inputs, settings->inputs_keep_s, x->wake_fd);
    return x;
}

bool executor_start(executor *x, error *e)
{
    return background_start(&x->thread, supervise, x, "the supervisor", e);
}

void executor_stop(executor *x)
{
    atomic_store(&x->stopping, true);
    executor_force(x);
    pthread_join(x->thread, NULL);
}

void executor_drain(executor *x, double seconds)
{
    atomic_store(&x->drain_ms, clock_monotonic_ms() + (int64_t)(seconds * 1000));
    atomic_store(&x->draining, true);
    executor_wake(x);
}

void executor_close(executor *x, bool on)
{
    atomic_store(&x->closed, on);
    executor_wake(x);
}

bool executor_takes_jobs(const executor *x)
{
    return !atomic_load(&x->closed) && !atomic_load(&x->draining);
}

void executor_force(executor *x)
{
    atomic_store(&x->forcing, true);
    executor_drain(x, 0);
}

bool executor_is_draining(const executor *x)
{
    return atomic_load(&x->draining);
}

void executor_change(executor *x, const executor_settings *settings)
{
    pthread_mutex_lock(&x->mutex);
    x->changed = *settings;
    x->has_changed = true;
    pthread_mutex_unlock(&x->mutex);
    executor_wake(x);
}

uint64_t executor_turns(const executor *x)
{
    return atomic_load(&x->turns);
}

int executor_drained_fd(const executor *x)
{
    return x->drained_fd;
}

bool executor_size(const executor *x, int *width, int64_t *memory_mb, error *e)
{
    int share = x->settings.engine->resume ? 1 : x->threads / (int)x->workers;
    if (*width <= 0) *width = share > 0 ? share : 1;
    if (*width > x->threads) *width = x->threads;
    if (*memory_mb <= 0) *memory_mb = least(x->settings.memory_mb, x->memory_mb);
    return *memory_mb <= x->memory_mb ||
           error_set(e, ERROR_LIMIT_MEMORY,
                     "limits.memory_mb: %" PRId64 " MiB exceed the %" PRId64
                     " MiB that this service has for all jobs (setting host_memory_mb): lower it",
                     *memory_mb, x->memory_mb);
}

bool executor_apply_command(executor *x, const char *id, queue_command command, bool *found, bool *changed,
                            queue_state *now, error *e)
{
    pthread_mutex_lock(&x->order);
    bool ok = queue_begin_command(x->q, id, command, found, changed, now, e);
    if (ok && *found && *now == QUEUE_CANCELLING)
        for (size_t i = 0; i < x->slot_count; i++) slot_cancel(x->slots[i], id);
    if (ok && *found && (command == QUEUE_PAUSE || command == QUEUE_RESUME))
        for (size_t i = 0; i < x->slot_count; i++) slot_pause(x->slots[i], id, command == QUEUE_PAUSE);
    pthread_mutex_unlock(&x->order);
    if (ok && *changed) queue_complete(x->q, id, now, NULL); /* otherwise its task does it */
    if (ok && *changed && command == QUEUE_DELIVER && x->redelivery) redelivery_wake(x->redelivery);
    if (ok && *changed && command == QUEUE_CANCEL) kept_result_remove(x->q, x->work_dir, id);
    executor_wake(x);
    return ok;
}

void executor_move(executor *x, const char *id, int priority)
{
    pthread_mutex_lock(&x->order);
    for (size_t i = 0; i < x->slot_count; i++) slot_move(x->slots[i], id, priority);
    pthread_mutex_unlock(&x->order);
    executor_wake(x);
}

void executor_offer(executor *x, const char *id)
{
    if (!x->settings.cache) return;
    pthread_mutex_lock(&x->mutex);
    if (x->repeat_count < REPEATS_MOST) snprintf(x->repeat[x->repeat_count++], ULID_SIZE, "%s", id);
    pthread_mutex_unlock(&x->mutex);
    executor_wake(x);
}

char *executor_progress(executor *x, const char *id)
{
    char *progress = NULL;
    for (size_t i = 0; !progress && i < x->slot_count; i++) progress = slot_progress(x->slots[i], id);
    return progress;
}

bool executor_find_host(executor *x, const char *id, int task, char host[ENGINE_HOST_SIZE])
{
    bool found = false;
    for (size_t i = 0; !found && i < x->slot_count; i++) found = slot_host(x->slots[i], id, task, host);
    return found && *host;
}

progress_ring *executor_progress_ring(executor *x)
{
    return x->progress;
}

const meter *executor_get_meter(const executor *x)
{
    return &x->meter;
}

executor_space executor_get_space(const executor *x)
{
    executor_space space = {.floor_bytes = x->storage.floor_bytes};
    space.free_bytes = storage_free_bytes(&x->storage, &space.size_bytes, &space.directory);
    return space;
}

bool executor_can_write(const executor *x, error *e)
{
    return storage_can_write(&x->storage, e);
}

void executor_note_failed_write(executor *x)
{
    storage_suspect(&x->storage);
    signal_fd(x->wake_fd);
}

executor_load executor_get_load(executor *x)
{
    executor_load load = {.workers = (int)x->workers,
                          .all_threads = (int)(x->threads * x->times),
                          .all_memory_mb = x->memory_mb * x->times,
                          .most_of_owner =
                              (int)ledger_get_limits(x->settings.counts, LEDGER_ATTEMPTS).holder};
    for (size_t i = 0; i < x->slot_count; i++) {
        slot_usage usage = slot_get_usage(x->slots[i]);
        load.attempts += usage.attempts;
        load.threads += usage.threads;
        load.memory_mb += usage.memory_mb;
    }
    return load;
}

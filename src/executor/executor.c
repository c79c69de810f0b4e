#include "executor/executor.h"

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

#include "base/clock.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/threads.h"
#include "executor/cache.h"
#include "executor/engine.h"
#include "executor/host.h"
#include "executor/kept_result.h"
#include "executor/output_cleanup.h"
#include "executor/instance.h"
#include "executor/inventory.h"
#include "executor/local.h"
#include "executor/publication.h"
#include "executor/result.h"
#include "executor/retention.h"
#include "executor/input_permissions.h"
#include "executor/settlement.h"
#include "executor/storage.h"
#include "json/json.h"
#include "executor/progress_ring.h"
#include "store/file.h"

/* After trouble with the database (a full disk): long enough not to spin, short enough to recover.
 */
#define RETRY_MS 1000
/* While no worker can be started (the program is being replaced, no memory is left): the longest
 * time between two tries. */
#define START_WAIT_MOST_MS 30000
/* Between two looks whether a full disk has room again. */
#define ROOM_WAIT_MS 1000

/* The part of the machine's memory that is lent to attempts when the settings do not say. */
#define HOST_MEMORY_SHARE 0.9

typedef struct limits {
    double timeout_s, stall_s; /* 0: none */
} limits;

/* A task that this executor has claimed. What stands first is guarded by the executor's mutex for
 * writing and for reading by others; the rest is the supervisor's own.
 */
typedef struct slot {
    bool used;
    queue_claimed claimed;
    int threads; /* what it takes of the host */
    int64_t memory_mb;
    char *progress;
    bool cancel_wanted;

    engine_attempt *attempt; /* NULL: not started, or ended */
    char *directory;
    limits limit;
    int64_t started_ms, moved_ms; /* monotonic: of the start, of the last progress */
    int64_t started_wall_ms;
    int64_t ran_ms; /* once it has ended */
    settlement_stop stop;
    bool asked, forced;
    int64_t force_ms;         /* when to end what was asked to end */
    publication *publication; /* NULL: none is on its way */
    char *copied;             /* the temporary file of one that was */
    char cache_key[STORE_HASH_SIZE], cached_from[ULID_SIZE], *cache_inputs;
    bool decided;
    settlement verdict;
    engine_ending ending;
    int64_t retry_ms; /* when to try the settlement again */
} slot;

struct executor {
    executor_settings settings;
    char *state_dir, *worker, **input_roots;
    char host[HOST_NAME_MAX + 1];
    settlement_place place;
    store_roots *roots; /* the input roots, open */
    int threads;        /* of all attempts */
    int64_t memory_mb;
    queue *q;
    const engine *engine;
    progress_ring *progress;
    retention *retention;
    output_cleanup *cleanup;
    storage storage;
    pthread_t thread;
    int wake_fd, drained_fd;
    atomic_bool held, draining, forcing, stopping;
    atomic_uint_fast64_t turns;
    _Atomic int64_t drain_ms; /* monotonic: when a drain stops what still runs */

    pthread_mutex_t order;     /* over a claim until it has its slot, and over commands */
    pthread_mutex_t mutex;     /* of the slots; never held over the queue's work */
    executor_settings changed; /* guarded; what executor_change brought, for the supervisor to take */
    bool has_changed;
    size_t slot_count;
    slot *slots;

    bool look;             /* supervisor: something may be claimed that could not before */
    int64_t due_ms;        /* supervisor: when a task may be tried again, wall clock */
    int64_t claim_ms;      /* supervisor: no claim before; after trouble */
    int64_t start_wait_ms; /* supervisor: doubles while no attempt starts */
};

static int64_t least(int64_t a, int64_t b)
{
    return a < b ? a : b;
}

static void signal_fd(int fd)
{
    ssize_t written = write(fd, &(uint64_t){1}, sizeof(uint64_t));
    (void)written; /* a full counter is readable, which is all that is wanted */
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

static double limit_or(json_at limits_at, const char *key, double otherwise)
{
    double value = json_number(json_member(&limits_at, key), 0);
    return value > 0 ? value : otherwise;
}

static limits read_limits(const executor *x, const char *spec)
{
    json *document = json_parse(spec, strlen(spec), NULL);
    json_at root = json_root(document);
    json_at at = json_member(&root, "limits");
    limits l = {
        .timeout_s = limit_or(at, "timeout_s", x->settings.timeout_s),
        .stall_s = limit_or(at, "stall_s", x->settings.stall_s),
    };
    json_free(document);
    return l;
}

/* Empties a slot; the mutex is not held. */
static void slot_clear(executor *x, slot *s)
{
    free(s->directory);
    free(s->ending.last_words);
    free(s->cache_inputs);
    free(s->copied);
    pthread_mutex_lock(&x->mutex);
    queue_claimed_clear(&s->claimed);
    free(s->progress);
    *s = (slot){0};
    pthread_mutex_unlock(&x->mutex);
    x->look = true;
}

static void slot_settle(executor *x, slot *s)
{
    error e = {0};
    if (settlement_apply(&x->place, &s->claimed, &s->verdict, s->ending.last_words ? &s->ending : NULL, &e)) {
        slot_clear(x, s);
        retention_wake(x->retention); /* it may be kept for a short time only */
        return;
    }
    /* once an attempt: it is tried until it works */
    log_write(s->retry_ms ? LOG_LEVEL_DEBUG : LOG_LEVEL_ERROR, "attempt not settled job=%s attempt=%d: %s",
              s->claimed.job.id, s->claimed.task.attempt, e.message);
    s->retry_ms = clock_monotonic_ms() + RETRY_MS;
    /* when the daemon ends, the next start settles it as after a crash */
    if (atomic_load(&x->draining)) slot_clear(x, s);
}

/* A result may be given to others if what it was made of is known. */
static void slot_describe(executor *x, slot *s)
{
    const queue_claimed *c = &s->claimed;
    if (!x->settings.cache || !s->verdict.deliver || c->task.frame != QUEUE_NO_FRAME ||
        !cache_key(c->job.spec, s->cache_key))
        return;
    s->cache_inputs = cache_describe_inputs(x->roots, s->directory, s->started_wall_ms);
    if (!s->cache_inputs) return;
    s->verdict.cache_key = s->cache_key;
    s->verdict.cache_inputs = s->cache_inputs;
}

/* A result is copied first to where its job wants it, if it does. False: there is nothing to wait for. */
static bool slot_publish(executor *x, slot *s)
{
    char *path = s->verdict.deliver ? publication_path(s->claimed.job.spec, s->claimed.task.frame) : NULL;
    if (path) s->publication = publication_start(x->q, &x->settings.outputs, s->directory, path, x->wake_fd);
    free(path);
    return s->publication != NULL;
}

static void slot_end_publication(executor *x, slot *s)
{
    error e = {0};
    if (!publication_end(s->publication, &e)) settlement_decide_unpublished(&e, &s->verdict);
    s->publication = NULL;
    s->verdict.copied = s->copied = publication_temporary(s->directory);
    s->decided = true;
    slot_settle(x, s);
}

/* What becomes of an attempt that ended, and then that. */
static void slot_decide(executor *x, slot *s)
{
    settlement_decide(&s->claimed, s->stop,
                      s->stop == SETTLEMENT_STALLED ? s->limit.stall_s : s->limit.timeout_s, &s->ending,
                      s->directory, &s->verdict);
    s->verdict.ran_ms = s->ran_ms;
    if (s->verdict.undecided) {
        log_write(s->retry_ms ? LOG_LEVEL_DEBUG : LOG_LEVEL_ERROR,
                  "attempt not settled job=%s attempt=%d: %s", s->claimed.job.id, s->claimed.task.attempt,
                  s->verdict.message);
        s->retry_ms = clock_monotonic_ms() + RETRY_MS;
        if (atomic_load(&x->draining)) slot_clear(x, s);
        return;
    }
    slot_describe(x, s);
    if (slot_publish(x, s)) return;
    s->decided = true;
    slot_settle(x, s);
}

/* No worker is started: what was decided about the task is done at once. */
static void slot_skip(executor *x, slot *s)
{
    s->decided = true;
    slot_settle(x, s);
}

/* Gives the task the result of a job that asked for the same, when there is one and all inputs still are what
 * they were. False: it has to be run. */
static bool slot_recall(executor *x, slot *s)
{
    error e = {0};
    char *inputs = NULL;
    bool found = false;
    if (!x->settings.cache || s->claimed.task.frame != QUEUE_NO_FRAME ||
        !cache_key(s->claimed.job.spec, s->cache_key) ||
        !queue_recall(x->q, s->cache_key, s->cached_from, &inputs, &found, NULL) || !found)
        return false;
    char *from = result_directory(x->state_dir, s->cached_from, QUEUE_NO_FRAME);
    found = cache_is_fresh(x->roots, inputs);
    if (found && (!cache_link_result(from, s->directory, &e) ||
                  !settlement_decide_cached(s->directory, s->cached_from, &s->verdict, &e))) {
        log_write(LOG_LEVEL_WARNING, "no use of a result job=%s from=%s: %s", s->claimed.job.id,
                  s->cached_from, e.message);
        store_remove(s->directory, NULL);
        found = false;
    }
    free(from);
    free(inputs);
    return found;
}

static void slot_start(executor *x, slot *s)
{
    error e = {0};
    const queue_job *job = &s->claimed.job;
    const queue_task *task = &s->claimed.task;
    s->directory = result_attempt_directory(x->state_dir, job->id, task->frame, task->attempt);
    s->limit = read_limits(x, job->spec);
    if (s->memory_mb > x->memory_mb) {
        settlement_decide_too_large(&s->claimed, x->memory_mb, &s->verdict);
        slot_skip(x, s);
        return;
    }
    if (s->limit.timeout_s > 0 && (double)task->ran_ms >= 1000 * s->limit.timeout_s) {
        settlement_decide_late(s->limit.timeout_s, &s->verdict);
        slot_skip(x, s);
        return;
    }
    if ((kept_result_take(x->state_dir, &s->claimed, s->directory) &&
         settlement_decide_kept(s->directory, &s->verdict, NULL)) ||
        slot_recall(x, s)) {
        if (!slot_publish(x, s)) slot_skip(x, s);
        return;
    }
    int before = s->claimed.previous;
    size_t root_count = 0;
    char **roots = input_permissions_list(job->spec, x->settings.inputs, (const char *const *)x->input_roots,
                                          x->settings.input_root_count, &root_count);
    char *previous = before == QUEUE_NO_FRAME ? NULL : result_directory(x->state_dir, job->id, before);
    engine_request request = {
        .worker = x->worker,
        .command = "run",
        .directory = s->directory,
        .spec = job->spec,
        .input_roots = (const char *const *)roots,
        .input_root_count = root_count,
        .memory_mb = s->memory_mb,
        .threads = s->threads,
        .frame = task->frame,
        .previous = previous,
        .file_mb = x->settings.file_mb,
        .sandbox = x->settings.sandbox,
    };
    s->started_ms = s->moved_ms = clock_monotonic_ms();
    s->started_wall_ms = clock_wall_ms();
    if (store_directory_create(s->directory, &e)) s->attempt = x->engine->start(&request, &e);
    free(previous);
    input_permissions_free(roots, root_count);
    if (s->attempt) {
        x->start_wait_ms = 0;
        log_write(LOG_LEVEL_INFO, "attempt started job=%s task=%d attempt=%d worker=%s", job->id,
                  task->number, task->attempt, x->engine->identify(s->attempt));
        return;
    }
    log_write(LOG_LEVEL_ERROR, "attempt not started job=%s task=%d attempt=%d: %s", job->id, task->number,
              task->attempt, e.message);
    settlement_decide_unstarted(&e, &s->verdict);
    /* whatever keeps this one from starting would keep the next one, too */
    x->start_wait_ms = x->start_wait_ms ? least(2 * x->start_wait_ms, START_WAIT_MOST_MS) : RETRY_MS;
    x->claim_ms = clock_monotonic_ms() + x->start_wait_ms;
    slot_skip(x, s);
}

/* What the attempts that run leave. */
static queue_room find_room(const executor *x)
{
    queue_room room = {
        .threads = x->threads,
        .all_threads = x->threads,
        .memory_mb = x->memory_mb,
        .all_memory_mb = x->memory_mb,
        .most_of_owner = x->settings.most_of_owner,
    };
    for (size_t i = 0; i < x->slot_count; i++) {
        room.threads -= x->slots[i].threads;
        room.memory_mb -= x->slots[i].memory_mb;
    }
    return room;
}

/* Claims into a free slot. The order is held over both, so that a cancellation finds either a
 * queued task or its slot. */
static bool claim(executor *x, slot *s)
{
    error e = {0};
    bool found = false;
    queue_room room = find_room(x);
    queue_claimed claimed = {0};
    pthread_mutex_lock(&x->order);
    if (queue_claim(x->q, &room, &claimed, &found, &e)) {
        if (found) {
            pthread_mutex_lock(&x->mutex);
            s->claimed = claimed;
            s->threads = claimed.job.threads;
            s->memory_mb = claimed.job.memory_mb;
            /* what does not fit is found out, and told, when it is started */
            executor_size(x, &s->threads, &s->memory_mb, NULL);
            s->used = true;
            pthread_mutex_unlock(&x->mutex);
        }
    } else {
        log_write(LOG_LEVEL_DEBUG, "no job can be claimed: %s", e.message); /* the queue said it */
        x->claim_ms = clock_monotonic_ms() + RETRY_MS;
    }
    pthread_mutex_unlock(&x->order);
    return found;
}

/* Nothing can be claimed now: what would change that by itself is a task whose time comes. */
static void note_due(executor *x)
{
    x->look = false;
    if (!queue_next_due(x->q, &x->due_ms, NULL)) x->due_ms = clock_wall_ms() + RETRY_MS;
}

static void fill_slots(executor *x)
{
    if (x->due_ms <= clock_wall_ms()) x->look = true;
    for (size_t i = 0; x->look && i < x->slot_count; i++) {
        slot *s = &x->slots[i];
        if (s->used) continue;
        if (!executor_takes_jobs(x) || clock_monotonic_ms() < x->claim_ms) return;
        if (!storage_has_room(&x->storage)) {
            x->claim_ms = clock_monotonic_ms() + ROOM_WAIT_MS;
            return;
        }
        if (claim(x, s)) {
            slot_start(x, s);
        } else {
            if (!x->claim_ms) note_due(x); /* else it could not be tried, and is again then */
            return;
        }
    }
}

static void keep_progress(executor *x, slot *s, const char *line)
{
    json *document = json_parse(line, strlen(line), NULL);
    bool valid = json_type_of(json_root(document)) == JSON_OBJECT;
    json_free(document);
    if (!valid) return;
    s->moved_ms = clock_monotonic_ms();
    char *copy = mem_strdup(line);
    pthread_mutex_lock(&x->mutex);
    char *old = s->progress;
    s->progress = copy;
    pthread_mutex_unlock(&x->mutex);
    free(old);
    progress_ring_add(x->progress, s->claimed.job.id, s->claimed.task.frame, s->claimed.task.attempt, line);
    queue_signal(x->q);
}

static int64_t after(int64_t from_ms, double seconds)
{
    return seconds > 0 && seconds < 1e12 ? from_ms + (int64_t)(seconds * 1000) : INT64_MAX;
}

/* When the time of the task is over, what attempts before took of it included. */
static int64_t timeout_ms(const slot *s)
{
    return after(s->started_ms - s->claimed.task.ran_ms, s->limit.timeout_s);
}

/* Why the attempt has to be stopped now, if it has to. */
static settlement_stop find_reason(executor *x, slot *s, int64_t now)
{
    pthread_mutex_lock(&x->mutex);
    bool cancelled = s->cancel_wanted;
    pthread_mutex_unlock(&x->mutex);
    if (cancelled) return SETTLEMENT_CANCELLED;
    if (now >= timeout_ms(s)) return SETTLEMENT_TIMED_OUT;
    if (now >= after(s->moved_ms, s->limit.stall_s)) return SETTLEMENT_STALLED;
    if (atomic_load(&x->draining) && now >= atomic_load(&x->drain_ms)) return SETTLEMENT_DRAINED;
    return SETTLEMENT_NOT_STOPPED;
}

static void stop_if_due(executor *x, slot *s)
{
    int64_t now = clock_monotonic_ms();
    settlement_stop why = find_reason(x, s, now);
    if (s->stop == SETTLEMENT_NOT_STOPPED || why == SETTLEMENT_CANCELLED) s->stop = why;
    if (s->stop == SETTLEMENT_NOT_STOPPED) return;
    if (!s->asked) {
        log_write(LOG_LEVEL_INFO, "attempt is asked to end job=%s attempt=%d", s->claimed.job.id,
                  s->claimed.task.attempt);
        x->engine->cancel(s->attempt, false);
        s->asked = true;
        s->force_ms = now + (int64_t)(x->settings.grace_s * 1000);
    }
    if (!s->forced && (now >= s->force_ms || atomic_load(&x->forcing))) {
        x->engine->cancel(s->attempt, true);
        s->forced = true;
    }
}

static void slot_serve(executor *x, slot *s)
{
    if (s->publication) {
        if (publication_has_ended(s->publication)) slot_end_publication(x, s);
        return;
    }
    if (s->decided || !s->attempt) {
        if (clock_monotonic_ms() < s->retry_ms) return;
        if (s->decided)
            slot_settle(x, s);
        else
            slot_decide(x, s);
        return;
    }
    const char *progress;
    bool ended = x->engine->poll(s->attempt, &progress);
    if (progress) keep_progress(x, s, progress);
    if (!ended) {
        stop_if_due(x, s);
        return;
    }
    s->ran_ms = clock_monotonic_ms() - s->started_ms;
    x->engine->settle(s->attempt, &s->ending);
    s->attempt = NULL;
    slot_decide(x, s);
}

/* When the slot wants to be looked at again although none of its descriptors is ready. */
static int64_t slot_due(executor *x, const slot *s)
{
    if (s->publication) return INT64_MAX;
    if (s->decided || !s->attempt) return s->retry_ms;
    if (s->forced) return INT64_MAX;
    if (s->asked) return s->force_ms;
    int64_t due = least(timeout_ms(s), after(s->moved_ms, s->limit.stall_s));
    return atomic_load(&x->draining) ? least(due, atomic_load(&x->drain_ms)) : due;
}

/* Waits until something has to be done. */
static void wait_for_news(executor *x, struct pollfd *fds)
{
    size_t count = 0;
    int64_t due = INT64_MAX;
    bool room = false;
    fds[count++] = (struct pollfd){.fd = x->wake_fd, .events = POLLIN};
    for (size_t i = 0; i < x->slot_count; i++) {
        slot *s = &x->slots[i];
        room |= !s->used;
        if (!s->used) continue;
        due = least(due, slot_due(x, s));
        if (s->attempt) count += x->engine->watch(s->attempt, &fds[count]);
    }
    if (room && executor_takes_jobs(x)) {
        if (x->look) due = least(due, x->claim_ms); /* 0: at once */
        if (x->due_ms < INT64_MAX) due = least(due, clock_monotonic_ms() + x->due_ms - clock_wall_ms());
    }
    int64_t wait = due == INT64_MAX ? -1 : due - clock_monotonic_ms();
    if (due != INT64_MAX && wait < 0) wait = 0;
    /* one millisecond more: due is a rounded time, and waking too early would turn in vain */
    poll(fds, count, wait < 0 ? -1 : wait >= INT32_MAX ? INT32_MAX : (int)wait + 1);
    if (fds[0].revents) {
        uint64_t times;
        ssize_t got = read(x->wake_fd, &times, sizeof times);
        (void)got;
        x->look = true;
    }
    if (x->claim_ms && clock_monotonic_ms() >= x->claim_ms) x->claim_ms = 0;
}

static bool is_idle(const executor *x)
{
    for (size_t i = 0; i < x->slot_count; i++)
        if (x->slots[i].used) return false;
    return true;
}

static void take_changes(executor *x)
{
    pthread_mutex_lock(&x->mutex);
    if (x->has_changed) {
        x->settings.file_mb = x->changed.file_mb;
        x->settings.timeout_s = x->changed.timeout_s;
        x->settings.stall_s = x->changed.stall_s;
        x->settings.grace_s = x->changed.grace_s;
        x->has_changed = false;
    }
    pthread_mutex_unlock(&x->mutex);
}

static void *supervise(void *argument)
{
    executor *x = argument;
    struct pollfd *fds = mem_alloc((1 + ENGINE_MAX_FDS * x->slot_count) * sizeof *fds);
    pthread_setname_np(pthread_self(), "supervisor"); /* for who looks at a process that is stuck */
    for (;;) {
        bool was_idle;
        atomic_fetch_add(&x->turns, 1);
        take_changes(x);
        for (size_t i = 0; i < x->slot_count; i++)
            if (x->slots[i].used) slot_serve(x, &x->slots[i]);
        fill_slots(x);
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
    char *attempts = mem_printf("%s/attempts", x->state_dir);
    char *results = mem_printf("%s/results", x->state_dir);
    bool ok = store_directory_create(attempts, e) && store_directory_create(results, e);
    free(attempts);
    free(results);
    return ok;
}

static void executor_free(executor *x)
{
    if (x->wake_fd >= 0) close(x->wake_fd);
    if (x->drained_fd >= 0) close(x->drained_fd);
    for (size_t i = 0; i < x->settings.input_root_count; i++) free(x->input_roots[i]);
    free(x->input_roots);
    free(x->state_dir);
    free(x->worker);
    free(x->slots);
    retention_stop(x->retention);
    output_cleanup_stop(x->cleanup);
    store_roots_close(x->roots);
    progress_ring_free(x->progress);
    pthread_mutex_destroy(&x->order);
    pthread_mutex_destroy(&x->mutex);
    free(x);
}

static void copy_settings(executor *x, const executor_settings *settings)
{
    x->settings = *settings;
    x->state_dir = mem_strdup(settings->state_dir);
    x->worker = mem_strdup(settings->worker);
    x->input_roots = mem_alloc(settings->input_root_count * sizeof *x->input_roots);
    for (size_t i = 0; i < settings->input_root_count; i++)
        x->input_roots[i] = mem_strdup(settings->input_roots[i]);
    x->threads = settings->threads > 0 ? settings->threads : threads_available();
    x->memory_mb = settings->host_memory_mb > 0 ? settings->host_memory_mb
                                                : (int64_t)((double)host_memory_mb() * HOST_MEMORY_SHARE);
    x->slot_count = (size_t)(settings->workers > 0 ? settings->workers : x->threads);
    x->slots = mem_alloc(x->slot_count * sizeof *x->slots);
    host_name(x->host, sizeof x->host);
    x->storage = (storage){.state_dir = x->state_dir, .floor_bytes = settings->free_space_mb << 20};
    x->place = (settlement_place){
        .q = x->q,
        .state_dir = x->state_dir,
        .host = x->host,
        .backoff = {settings->retry_s, settings->retry_most_s},
        .storage_retries = settings->storage_retries,
        .max_interruptions = settings->max_interruptions,
    };
}

/* Brings the queue and the state directory in line, before anything runs. */
static bool recover(const executor *x, error *e)
{
    char boot_id[HOST_BOOT_ID_SIZE];
    queue_instance last = {0};
    bool found = false;
    host_boot_id(boot_id);
    if (!queue_get_instance(x->q, &last, &found, e)) return false;
    bool restarted = *last.boot_id && *boot_id && strcmp(last.boot_id, boot_id) != 0;
    return settlement_recover(&x->place, restarted, e) &&
           inventory_take(x->q, x->state_dir, x->settings.adopt, e) &&
           instance_join(x->q, x->state_dir, boot_id, e);
}

/* Those of the settings, and before them that of files that were sent. */
static store_roots *open_roots(const executor_settings *settings, error *e)
{
    size_t count = 0;
    const char **paths = mem_alloc((settings->input_root_count + 1) * sizeof *paths);
    if (settings->inputs) paths[count++] = store_inputs_directory(settings->inputs);
    for (size_t i = 0; i < settings->input_root_count; i++) paths[count++] = settings->input_roots[i];
    store_roots *roots = store_roots_open(paths, count, e);
    free(paths);
    return roots;
}

executor *executor_start(const executor_settings *settings, queue *q, error *e)
{
    executor *x = mem_alloc(sizeof *x);
    x->q = q;
    x->engine = &engine_local;
    copy_settings(x, settings);
    x->progress = progress_ring_new();
    x->look = true;
    x->due_ms = INT64_MAX;
    pthread_mutex_init(&x->order, NULL);
    pthread_mutex_init(&x->mutex, NULL);
    x->wake_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    x->drained_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    int why = 0;
    bool ok = true;
    if (x->wake_fd < 0 || x->drained_fd < 0)
        ok = error_set(e, ERROR_INTERNAL, "no event descriptor: %s", strerror(errno));
    x->roots = ok ? open_roots(settings, e) : NULL;
    ok = x->roots && make_places(x, e) && recover(x, e) &&
         output_cleanup_start(q, &x->settings.outputs, &x->cleanup, e) &&
         (x->retention = retention_start(q, x->state_dir, settings->inputs, settings->inputs_keep_s, e));
    if (ok && (why = pthread_create(&x->thread, NULL, supervise, x)) != 0)
        ok = error_set(e, ERROR_INTERNAL, "no thread for the supervisor: %s", strerror(why));
    if (ok) return x;
    executor_free(x);
    return NULL;
}

void executor_stop(executor *x)
{
    if (!x) return;
    atomic_store(&x->stopping, true);
    executor_force(x);
    pthread_join(x->thread, NULL);
    executor_free(x);
}

void executor_drain(executor *x, double seconds)
{
    atomic_store(&x->drain_ms, clock_monotonic_ms() + (int64_t)(seconds * 1000));
    atomic_store(&x->draining, true);
    executor_wake(x);
}

void executor_hold(executor *x, bool on)
{
    atomic_store(&x->held, on);
    executor_wake(x);
}

bool executor_takes_jobs(const executor *x)
{
    return !atomic_load(&x->held) && !atomic_load(&x->draining);
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
    int share = x->threads / (int)x->slot_count;
    if (*width <= 0) *width = share > 0 ? share : 1;
    if (*width > x->threads) *width = x->threads;
    if (*memory_mb <= 0) *memory_mb = least(x->settings.memory_mb, x->memory_mb);
    return *memory_mb <= x->memory_mb ||
           error_set(e, ERROR_LIMIT_MEMORY,
                     "limits.memory_mb: %" PRId64 " MiB are more than the %" PRId64
                     " MiB that this service has for all jobs: ask for less",
                     *memory_mb, x->memory_mb);
}

bool executor_tell(executor *x, const char *id, queue_command command, bool *found, bool *changed,
                   queue_state *now, error *e)
{
    pthread_mutex_lock(&x->order);
    bool ok = queue_tell(x->q, id, command, found, changed, now, e);
    if (ok && *found && *now == QUEUE_CANCELLING) {
        pthread_mutex_lock(&x->mutex);
        for (size_t i = 0; i < x->slot_count; i++)
            if (x->slots[i].used && strcmp(x->slots[i].claimed.job.id, id) == 0)
                x->slots[i].cancel_wanted = true;
        pthread_mutex_unlock(&x->mutex);
    }
    pthread_mutex_unlock(&x->order);
    if (ok && *changed && command == QUEUE_CANCEL) kept_result_remove(x->q, x->state_dir, id);
    executor_wake(x);
    return ok;
}

char *executor_progress(executor *x, const char *id)
{
    char *progress = NULL;
    pthread_mutex_lock(&x->mutex);
    for (size_t i = 0; !progress && i < x->slot_count; i++) {
        const slot *s = &x->slots[i];
        if (s->used && s->progress && strcmp(s->claimed.job.id, id) == 0) progress = mem_strdup(s->progress);
    }
    pthread_mutex_unlock(&x->mutex);
    return progress;
}

progress_ring *executor_progress_ring(executor *x)
{
    return x->progress;
}

executor_space executor_get_space(const executor *x)
{
    return (executor_space){storage_free_bytes(&x->storage), x->storage.floor_bytes};
}

executor_load executor_get_load(executor *x)
{
    executor_load load = {
        .workers = (int)x->slot_count, .all_threads = x->threads, .all_memory_mb = x->memory_mb};
    pthread_mutex_lock(&x->mutex);
    for (size_t i = 0; i < x->slot_count; i++) {
        load.attempts += x->slots[i].used;
        load.threads += x->slots[i].threads;
        load.memory_mb += x->slots[i].memory_mb;
    }
    pthread_mutex_unlock(&x->mutex);
    return load;
}

#include "executor/executor.h"

#include <errno.h>
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
#include "executor/engine.h"
#include "executor/local.h"
#include "executor/result.h"
#include "executor/settlement.h"
#include "json/json.h"
#include "store/file.h"

/* After trouble with the database (a full disk): long enough not to spin, short enough to recover.
 */
#define RETRY_MS 1000
/* While no worker can be started (the program is being replaced, no memory is left): the longest
 * time between two tries. */
#define START_WAIT_MOST_MS 30000

typedef struct limits {
    int64_t memory_mb;
    double timeout_s, stall_s; /* 0: none */
} limits;

/* A job that this executor has claimed. `job`, `used`, `progress` and `cancel_wanted` are guarded
 * by the executor's mutex for writing and for reading by others; the rest is the supervisor's own.
 */
typedef struct slot {
    bool used;
    queue_job job;
    char *progress;
    bool cancel_wanted;

    engine_attempt *attempt; /* NULL: not started, or ended */
    char *directory;
    limits limit;
    int64_t started_ms, moved_ms; /* monotonic: of the start, of the last progress */
    settlement_stop stop;
    bool asked, forced;
    int64_t force_ms; /* when to end what was asked to end */
    bool decided;
    settlement verdict;
    engine_ending ending;
    int64_t retry_ms; /* when to try the settlement again */
} slot;

struct executor {
    executor_settings settings;
    char *state_dir, *worker, **input_roots;
    queue *q;
    const engine *engine;
    pthread_t thread;
    int wake_fd, drained_fd;
    atomic_bool draining, forcing, stopping;
    atomic_uint_fast64_t turns;
    _Atomic int64_t drain_ms; /* monotonic: when a drain stops what still runs */

    pthread_mutex_t mutex;
    executor_settings changed; /* guarded; what executor_change brought, for the supervisor to take */
    bool has_changed;
    size_t slot_count;
    slot *slots;

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
        .memory_mb = (int64_t)limit_or(at, "memory_mb", (double)x->settings.memory_mb),
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
    pthread_mutex_lock(&x->mutex);
    queue_job_clear(&s->job);
    free(s->progress);
    *s = (slot){0};
    pthread_mutex_unlock(&x->mutex);
}

static void slot_settle(executor *x, slot *s)
{
    error e = {0};
    if (settlement_apply(x->q, x->state_dir, &s->job, &s->verdict,
                         s->ending.last_words ? &s->ending : NULL, &e)) {
        slot_clear(x, s);
        return;
    }
    /* once an attempt: it is tried until it works */
    log_write(s->retry_ms ? LOG_LEVEL_DEBUG : LOG_LEVEL_ERROR,
              "attempt not settled job=%s attempt=%d: %s", s->job.id, s->job.attempt, e.message);
    s->retry_ms = clock_monotonic_ms() + RETRY_MS;
    /* when the daemon ends, the next start settles it as after a crash */
    if (atomic_load(&x->draining)) slot_clear(x, s);
}

/* What becomes of an attempt that ended, and then that. */
static void slot_decide(executor *x, slot *s)
{
    settlement_decide(&s->job, s->stop,
                      s->stop == SETTLEMENT_STALLED ? s->limit.stall_s : s->limit.timeout_s,
                      &s->ending, s->directory, &s->verdict);
    if (s->verdict.undecided) {
        log_write(s->retry_ms ? LOG_LEVEL_DEBUG : LOG_LEVEL_ERROR,
                  "attempt not settled job=%s attempt=%d: %s", s->job.id, s->job.attempt,
                  s->verdict.message);
        s->retry_ms = clock_monotonic_ms() + RETRY_MS;
        if (atomic_load(&x->draining)) slot_clear(x, s);
        return;
    }
    s->decided = true;
    slot_settle(x, s);
}

static void slot_start(executor *x, slot *s)
{
    error e = {0};
    s->directory = result_attempt_directory(x->state_dir, s->job.id, s->job.attempt);
    s->limit = read_limits(x, s->job.spec);
    engine_request request = {
        .worker = x->worker,
        .directory = s->directory,
        .spec = s->job.spec,
        .input_roots = (const char *const *)x->input_roots,
        .input_root_count = x->settings.input_root_count,
        .memory_mb = s->limit.memory_mb,
        .file_mb = x->settings.file_mb,
        .sandbox = x->settings.sandbox,
    };
    s->started_ms = s->moved_ms = clock_monotonic_ms();
    if (store_directory_create(s->directory, &e)) s->attempt = x->engine->start(&request, &e);
    if (s->attempt) {
        x->start_wait_ms = 0;
        log_write(LOG_LEVEL_INFO, "attempt started job=%s attempt=%d worker=%s", s->job.id, s->job.attempt,
                  x->engine->identify(s->attempt));
        return;
    }
    log_write(LOG_LEVEL_ERROR, "attempt not started job=%s attempt=%d: %s", s->job.id,
              s->job.attempt, e.message);
    settlement_decide_unstarted(&e, &s->verdict);
    s->decided = true;
    /* whatever keeps this one from starting would keep the next one, too */
    x->start_wait_ms =
        x->start_wait_ms ? least(2 * x->start_wait_ms, START_WAIT_MOST_MS) : RETRY_MS;
    x->claim_ms = clock_monotonic_ms() + x->start_wait_ms;
    slot_settle(x, s);
}

/* Claims into a free slot. The mutex is held over both, so that a cancellation finds either a
 * queued job or its slot. */
static bool claim(executor *x, slot *s)
{
    error e = {0};
    bool found = false;
    queue_job job = {0};
    pthread_mutex_lock(&x->mutex);
    if (queue_claim(x->q, &job, &found, &e)) {
        if (found) {
            s->job = job;
            s->used = true;
        }
    } else {
        log_write(LOG_LEVEL_DEBUG, "no job can be claimed: %s", e.message); /* the queue said it */
        x->claim_ms = clock_monotonic_ms() + RETRY_MS;
    }
    pthread_mutex_unlock(&x->mutex);
    return found;
}

static void fill_slots(executor *x)
{
    for (size_t i = 0; i < x->slot_count; i++) {
        slot *s = &x->slots[i];
        if (s->used) continue;
        if (atomic_load(&x->draining) || clock_monotonic_ms() < x->claim_ms || !claim(x, s)) return;
        slot_start(x, s);
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
}

static int64_t after(int64_t from_ms, double seconds)
{
    return seconds > 0 && seconds < 1e12 ? from_ms + (int64_t)(seconds * 1000) : INT64_MAX;
}

/* Why the attempt has to be stopped now, if it has to. */
static settlement_stop find_reason(executor *x, slot *s, int64_t now)
{
    pthread_mutex_lock(&x->mutex);
    bool cancelled = s->cancel_wanted;
    pthread_mutex_unlock(&x->mutex);
    if (cancelled) return SETTLEMENT_CANCELLED;
    if (now >= after(s->started_ms, s->limit.timeout_s)) return SETTLEMENT_TIMED_OUT;
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
        log_write(LOG_LEVEL_INFO, "attempt is asked to end job=%s attempt=%d", s->job.id,
                  s->job.attempt);
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
    if (s->decided || !s->attempt) {
        if (clock_monotonic_ms() < s->retry_ms) return;
        if (s->decided) slot_settle(x, s);
        else slot_decide(x, s);
        return;
    }
    const char *progress;
    bool ended = x->engine->poll(s->attempt, &progress);
    if (progress) keep_progress(x, s, progress);
    if (!ended) {
        stop_if_due(x, s);
        return;
    }
    x->engine->settle(s->attempt, &s->ending);
    s->attempt = NULL;
    slot_decide(x, s);
}

/* When the slot wants to be looked at again although none of its descriptors is ready. */
static int64_t slot_due(executor *x, const slot *s)
{
    if (s->decided || !s->attempt) return s->retry_ms;
    if (s->forced) return INT64_MAX;
    if (s->asked) return s->force_ms;
    int64_t due =
        least(after(s->started_ms, s->limit.timeout_s), after(s->moved_ms, s->limit.stall_s));
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
    if (room && x->claim_ms) due = least(due, x->claim_ms);
    int64_t wait = due == INT64_MAX ? -1 : due - clock_monotonic_ms();
    if (due != INT64_MAX && wait < 0) wait = 0;
    /* one millisecond more: due is a rounded time, and waking too early would turn in vain */
    poll(fds, count, wait < 0 ? -1 : wait >= INT32_MAX ? INT32_MAX : (int)wait + 1);
    if (fds[0].revents) {
        uint64_t times;
        ssize_t got = read(x->wake_fd, &times, sizeof times);
        (void)got;
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
        x->settings.memory_mb = x->changed.memory_mb;
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
    pthread_mutex_destroy(&x->mutex);
    free(x);
}

executor *executor_start(const executor_settings *settings, queue *q, error *e)
{
    executor *x = mem_alloc(sizeof *x);
    long cores = sysconf(_SC_NPROCESSORS_ONLN);
    x->settings = *settings;
    x->state_dir = mem_strdup(settings->state_dir);
    x->worker = mem_strdup(settings->worker);
    x->input_roots = mem_alloc(settings->input_root_count * sizeof *x->input_roots);
    for (size_t i = 0; i < settings->input_root_count; i++)
        x->input_roots[i] = mem_strdup(settings->input_roots[i]);
    x->q = q;
    x->engine = &engine_local;
    x->slot_count = settings->workers > 0 ? (size_t)settings->workers
                    : cores > 0           ? (size_t)cores
                                          : 1;
    x->slots = mem_alloc(x->slot_count * sizeof *x->slots);
    pthread_mutex_init(&x->mutex, NULL);
    x->wake_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    x->drained_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    int why = 0;
    bool ok = true;
    if (x->wake_fd < 0 || x->drained_fd < 0)
        ok = error_set(e, ERROR_INTERNAL, "no event descriptor: %s", strerror(errno));
    ok = ok && make_places(x, e) && settlement_recover(q, x->state_dir, e);
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

bool executor_cancel(executor *x, const char *id, bool *found, bool *changed, queue_state *now,
                     error *e)
{
    pthread_mutex_lock(&x->mutex);
    bool ok = queue_cancel(x->q, id, found, changed, now, e);
    if (ok && *found && *now == QUEUE_CANCELLING)
        for (size_t i = 0; i < x->slot_count; i++)
            if (x->slots[i].used && strcmp(x->slots[i].job.id, id) == 0)
                x->slots[i].cancel_wanted = true;
    pthread_mutex_unlock(&x->mutex);
    executor_wake(x);
    return ok;
}

char *executor_progress(executor *x, const char *id)
{
    char *progress = NULL;
    pthread_mutex_lock(&x->mutex);
    for (size_t i = 0; i < x->slot_count; i++) {
        const slot *s = &x->slots[i];
        if (s->used && s->progress && strcmp(s->job.id, id) == 0)
            progress = mem_strdup(s->progress);
    }
    pthread_mutex_unlock(&x->mutex);
    return progress;
}

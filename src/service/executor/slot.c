// SPDX-License-Identifier: Apache-2.0
#include "service/executor/slot.h"

#include <assert.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/background.h"
#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "base/core/runner.h"
#include "base/core/worker_contract.h"
#include "service/executor/cache.h"
#include "service/executor/input_permissions.h"
#include "base/json/json.h"
#include "service/results/kept_result.h"
#include "service/results/own_report.h"
#include "service/results/own_spec.h"
#include "service/results/publication.h"
#include "service/results/result.h"
#include "files/file.h"
#include "files/sent_file.h"

typedef struct limits {
    double timeout_s, stall_s; /* 0: none */
} limits;

/* The data of the current task; zero in a free slot. */
typedef struct work {
    /* written by the supervisor under the mutex */
    queue_claimed claimed;
    int threads; /* resources that the attempt uses */
    int64_t memory_mb;
    char *progress;                                /* the newest progress line */
    bool began;                                    /* the worker has started */
    char host[ENGINE_HOST_SIZE];                   /* see engine.find_host */
    bool cancel_wanted, pause_wanted, move_wanted; /* written by any thread */

    /* used by the supervisor only */
    bool repeat;     /* no worker will be started */
    bool resumed;    /* an earlier daemon has started the worker */
    char *directory; /* of the attempt */
    limits limit;
    engine_attempt *attempt; /* in RUNNING and STOPPING */
    int64_t started_wall_ms;
    int64_t moved_ms;         /* monotonic: start, last progress */
    settlement_stop stop;     /* reason why the worker was stopped */
    int64_t force_ms;         /* time at which it is killed, monotonic */
    bool forced;              /* it was killed */
    engine_ending ending;     /* with `has_ended` */
    bool has_ended;           /* a worker ran, and has ended */
    bool was_lost;            /* the state directory was lost when the worker ended */
    int64_t ran_ms;           /* once it has ended */
    publication *publication; /* in PUBLISHING */
    background_call *call;    /* in REUSING and CHECKING; it owns `reused` meanwhile */
    store_deadline call_end;  /* a drain sets it */
    struct {
        char *from; /* directory of the result of the equal job */
        bool ok;
        queue_outcome outcome; /* if ok */
        error fault;           /* otherwise */
    } reused;
    settlement settlement;
    int64_t retry_ms; /* DECIDING, SETTLING: time of the next try, monotonic; 0: no try has failed */
    /* referenced by the settlement */
    char *copied;
    char cached_from[ULID_SIZE], *cache_inputs;
} work;

struct slot {
    const slot_context *context;
    pthread_mutex_t mutex; /* never held during queries or disk access */
    slot_phase phase;      /* written by the supervisor under the mutex */
    work w;
};

static int64_t least(int64_t a, int64_t b)
{
    return a < b ? a : b;
}

static int64_t most(int64_t a, int64_t b)
{
    return a > b ? a : b;
}

static int64_t after(int64_t from_ms, double seconds)
{
    return seconds > 0 && seconds < 1e12 ? from_ms + (int64_t)(seconds * 1000) : INT64_MAX;
}

static void enter(slot *s, slot_phase phase)
{
    pthread_mutex_lock(&s->mutex);
    s->phase = phase;
    pthread_mutex_unlock(&s->mutex);
}

slot *slot_new(const slot_context *context)
{
    slot *s = mem_alloc(sizeof *s);
    s->context = context;
    pthread_mutex_init(&s->mutex, NULL);
    return s;
}

bool slot_is_free(const slot *s)
{
    return s->phase == SLOT_FREE;
}

void slot_take(slot *s, const queue_claimed *claimed, int width, int64_t memory_mb)
{
    assert(s->phase == SLOT_FREE);
    pthread_mutex_lock(&s->mutex);
    s->w.claimed = *claimed;
    s->w.threads = width;
    s->w.memory_mb = memory_mb;
    s->phase = SLOT_STARTING;
    pthread_mutex_unlock(&s->mutex);
}

void slot_take_repeat(slot *s, const queue_claimed *claimed)
{
    s->w.repeat = true;
    slot_take(s, claimed, 0, 0);
}

void slot_take_resumed(slot *s, const queue_claimed *claimed, int width, int64_t memory_mb)
{
    s->w.resumed = true;
    s->w.cancel_wanted = claimed->job.state == QUEUE_CANCELLING;
    slot_take(s, claimed, width, memory_mb);
}

/* Empties the slot. */
static unsigned release(slot *s)
{
    work *w = &s->w;
    assert(!w->attempt && !w->publication && !w->call);
    free(w->directory);
    free(w->reused.from);
    free(w->ending.last_words);
    free(w->cache_inputs);
    free(w->copied);
    pthread_mutex_lock(&s->mutex);
    queue_claimed_clear(&w->claimed);
    free(w->progress);
    *w = (work){0};
    s->phase = SLOT_FREE;
    pthread_mutex_unlock(&s->mutex);
    return SLOT_FREED;
}

void slot_free(slot *s)
{
    if (!s) return;
    if (s->phase != SLOT_FREE) release(s); /* taken over, but the supervisor did not start */
    pthread_mutex_destroy(&s->mutex);
    free(s);
}

/* Deciding or settling has failed and is tried again. In a drain the next start settles the task, as after
 * a crash. */
static unsigned try_later(slot *s, const char *why)
{
    work *w = &s->w;
    log_write(w->retry_ms ? LOG_LEVEL_DEBUG : LOG_LEVEL_ERROR, /* an error once per attempt */
              "attempt not settled job=%s attempt=%d: %s", w->claimed.job.id, w->claimed.task.attempt, why);
    w->retry_ms = runner_retry_time();
    return SLOT_NOT_WRITTEN | (s->context->draining ? release(s) : SLOT_NO_NEWS);
}

/* ---- starting */

static limits read_limits(const slot_context *x, const queue_claimed *c)
{
    return (limits){
        .timeout_s = c->timeout_ms > 0 ? clock_seconds(c->timeout_ms) : x->timeout_s,
        .stall_s = c->stall_ms > 0 ? clock_seconds(c->stall_ms) : x->stall_s,
    };
}

/* Handles a result in the attempt's directory: copies it to output.directory first, if the job names one. */
static void publish_or_settle(slot *s)
{
    const slot_context *x = s->context;
    work *w = &s->w;
    const queue_claimed *c = &w->claimed;
    if (w->settlement.decision == SETTLEMENT_SUCCEED && c->directory)
        w->publication = publication_start(x->outputs, c->job.owner, w->directory, c->directory,
                                           c->task.frame, x->wake_fd);
    enter(s, w->publication ? SLOT_PUBLISHING : SLOT_SETTLING);
}

static bool is_cacheable(const slot *s)
{
    const queue_claimed *c = &s->w.claimed;
    return s->context->cache && c->task.frame == QUEUE_NO_FRAME && c->cache_key;
}

/* Starts a call in a thread of its own. */
static void start_call(slot *s, void (*run)(void *context), slot_phase phase)
{
    atomic_store(&s->w.call_end, INT64_MAX);
    s->w.call = background_call_start(run, s, s->context->wake_fd);
    enter(s, phase);
}

/* In a thread of its own. */
static void reuse(void *context)
{
    slot *s = context;
    work *w = &s->w;
    result r = {0};
    w->reused.ok = cache_link_result(w->reused.from, w->directory, w->claimed.job.spec, &w->call_end, &r,
                                     &w->reused.fault);
    w->reused.outcome = r.outcome;
    result_clear(&r);
}

/* Begins to give the task the result of an equal job, if there is one and its input files have not changed. */
static bool begin_reuse(slot *s)
{
    const slot_context *x = s->context;
    work *w = &s->w;
    char *inputs = NULL;
    bool found = false;
    if (!is_cacheable(s)) return false;
    found = queue_recall(x->place->q, w->claimed.cache_key, w->cached_from, &inputs, &found, NULL) && found &&
            cache_is_fresh(x->roots, inputs);
    free(inputs);
    if (found) {
        w->reused.from = result_directory(x->place->work_dir, w->cached_from, QUEUE_NO_FRAME);
        start_call(s, reuse, SLOT_REUSING);
    } else {
        x->place->meter->cache_misses++;
    }
    return found;
}

static bool take_kept(slot *s)
{
    work *w = &s->w;
    return kept_result_take(s->context->place->work_dir, &w->claimed, w->directory) &&
           (w->claimed.task.frame != QUEUE_NO_FRAME ||
            own_report_correct(w->directory, w->claimed.job.spec, NULL)) &&
           settlement_decide_kept(w->directory, &w->settlement, NULL);
}

/* The names of the uploaded files that the task reads, `count` of them: those that all tasks read, and its own
 * file. The caller frees the list, but not the names. */
static const char **list_inputs(const queue_claimed *c, char own[STORE_INPUT_NAME_SIZE], size_t *count)
{
    const char **names = mem_alloc((c->input_count + 1) * sizeof *names);
    for (*count = 0; *count < c->input_count; ++*count) names[*count] = c->inputs[*count];
    if (c->task.file && sent_file_match(c->task.file, own)) names[(*count)++] = own;
    return names;
}

static bool start_worker(slot *s, error *e)
{
    const slot_context *x = s->context;
    work *w = &s->w;
    const queue_claimed *c = &w->claimed;
    size_t root_count = 0, input_count = 0;
    char own_file[STORE_INPUT_NAME_SIZE];
    const char **inputs = list_inputs(c, own_file, &input_count);
    char **roots = input_permissions_list(inputs, input_count, x->inputs, x->input_roots, x->input_root_count,
                                          &root_count);
    char *own_spec = c->task.file ? own_spec_make(c->job.spec, c->task.file) : NULL;
    char *previous =
        c->previous == QUEUE_NO_FRAME ? NULL : result_directory(x->place->work_dir, c->job.id, c->previous);
    engine_request request = {
        .worker = x->worker,
        .command = WORKER_COMMAND_RUN,
        .directory = w->directory,
        .spec = own_spec ? own_spec : c->job.spec,
        .input_roots = (const char *const *)roots,
        .input_root_count = root_count,
        .memory_mb = w->memory_mb,
        .most_memory_mb = x->memory_mb,
        .groups = x->groups,
        .threads = w->threads,
        .frame = c->task.frame,
        .chunk = c->chunk,
        .more = c->more,
        .previous = previous,
        .trace = c->job.trace,
        .file_mb = x->file_mb,
        .sandbox = x->sandbox,
        .instance = x->instance,
        .owner = c->job.owner,
        .priority = c->job.priority,
        .timeout_s = w->limit.timeout_s > 0 ? w->limit.timeout_s - clock_seconds(c->task.ran_ms) : 0,
        .wake_fd = x->wake_fd,
    };
    w->moved_ms = clock_monotonic_ms();
    w->started_wall_ms = w->resumed ? 0 : clock_wall_ms(); /* 0: its result is not cached */
    if (w->resumed)
        w->attempt = x->engine->resume(x->engine_place, &request, e);
    else if (store_directory_add(w->directory, e))
        w->attempt = x->engine->start(x->engine_place, &request, e);
    free(previous);
    free(own_spec);
    free(inputs);
    mem_free_texts(roots, root_count);
    return w->attempt != NULL;
}

/* True if no worker is needed: the next phase is then SETTLING with a decision, or PUBLISHING. */
static bool decide_at_once(slot *s)
{
    const slot_context *x = s->context;
    work *w = &s->w;
    if (w->memory_mb > x->memory_mb) {
        settlement_decide_too_large(&w->claimed, x->memory_mb, &w->settlement);
    } else if (w->limit.timeout_s > 0 && (double)w->claimed.task.ran_ms >= 1000 * w->limit.timeout_s) {
        settlement_decide_late(w->limit.timeout_s, &w->settlement);
    } else if (take_kept(s)) {
        publish_or_settle(s);
        return true;
    } else {
        return false;
    }
    enter(s, SLOT_SETTLING);
    return true;
}

/* Queues the task again, since its worker is not started. */
static unsigned put_back(slot *s, const char *why)
{
    error e = {0};
    error_set(&e, ERROR_INTERNAL, "%s", why);
    settlement_decide_unstarted(&e, &s->w.settlement);
    enter(s, SLOT_SETTLING);
    return SLOT_NO_NEWS;
}

/* The next phase is RUNNING, or SETTLING with a decision. */
static unsigned begin_attempt(slot *s)
{
    const slot_context *x = s->context;
    work *w = &s->w;
    const queue_job *job = &w->claimed.job;
    const queue_task *task = &w->claimed.task;
    error e = {0};
    if (w->repeat) return put_back(s, "the result of an equal job was deleted or is damaged");
    if (!start_worker(s, &e)) {
        log_write(LOG_LEVEL_ERROR, "attempt not started job=%s task=%d attempt=%d: %s", job->id, task->number,
                  task->attempt, e.message);
        settlement_decide_unstarted(&e, &w->settlement);
        enter(s, SLOT_SETTLING);
        return SLOT_NOT_STARTED | SLOT_NOT_WRITTEN;
    }
    log_write(LOG_LEVEL_INFO, "attempt %s job=%s task=%d attempt=%d worker=%s trace=%s",
              w->resumed ? "resumed" : "started", job->id, task->number, task->attempt,
              x->engine->identify(w->attempt), job->trace ? job->trace : "-");
    enter(s, SLOT_RUNNING);
    return SLOT_STARTED;
}

/* The next phase is REUSING, RUNNING, PUBLISHING, or SETTLING with a decision. */
static unsigned step_starting(slot *s)
{
    work *w = &s->w;
    const queue_task *task = &w->claimed.task;
    w->directory =
        result_attempt_directory(s->context->place->work_dir, w->claimed.job.id, task->frame, task->attempt);
    w->limit = read_limits(s->context, &w->claimed);
    return !w->resumed && (decide_at_once(s) || begin_reuse(s)) ? SLOT_NO_NEWS : begin_attempt(s);
}

/* Whether the call of the slot has ended; then frees it. */
static bool take_call(slot *s)
{
    work *w = &s->w;
    if (s->context->draining) atomic_store(&w->call_end, s->context->drain_ms);
    if (!background_call_has_ended(w->call)) return false;
    background_call_end(w->call);
    w->call = NULL;
    return true;
}

/* Without a result, a worker has to compute it. */
static unsigned step_reusing(slot *s)
{
    work *w = &s->w;
    meter *m = s->context->place->meter;
    if (!take_call(s)) return SLOT_NO_NEWS;
    (*(w->reused.ok ? &m->cache_hits : &m->cache_misses))++;
    if (w->reused.ok) {
        settlement_decide_cached(w->reused.outcome, w->cached_from, &w->settlement);
        publish_or_settle(s);
        return SLOT_NO_NEWS;
    }
    log_write(LOG_LEVEL_WARNING, "cannot use a cached result job=%s from=%s: %s", w->claimed.job.id,
              w->cached_from, w->reused.fault.message);
    store_remove(w->directory, NULL);
    return s->context->draining ? put_back(s, "the daemon is being stopped") : begin_attempt(s);
}

/* ---- running and stopping */

static void keep_progress(slot *s, const char *line)
{
    work *w = &s->w;
    json *document = json_parse(line, strlen(line), NULL);
    bool valid = json_type_of(json_root(document)) == JSON_OBJECT;
    json_free(document);
    if (!valid) return;
    w->moved_ms = clock_monotonic_ms();
    char *copy = mem_strdup(line);
    pthread_mutex_lock(&s->mutex);
    char *old = w->progress;
    w->progress = copy;
    pthread_mutex_unlock(&s->mutex);
    free(old);
    progress_ring_add(s->context->progress, w->claimed.job.id, w->claimed.job.owner, w->claimed.task.frame,
                      w->claimed.task.attempt, line);
    queue_signal(s->context->place->q);
}

static int64_t began_ms(const slot *s)
{
    return s->context->engine->began_ms(s->w.attempt);
}

static void keep_host(slot *s)
{
    work *w = &s->w;
    char host[ENGINE_HOST_SIZE];
    bool began = began_ms(s) != INT64_MAX;
    if (!began) return;
    s->context->engine->find_host(w->attempt, host);
    pthread_mutex_lock(&s->mutex);
    w->began = true;
    memcpy(w->host, host, sizeof host);
    pthread_mutex_unlock(&s->mutex);
}

/* Time at which the task has used up its time limit, including the time of earlier attempts. */
static int64_t timeout_ms(const slot *s)
{
    int64_t began = began_ms(s);
    return began == INT64_MAX ? INT64_MAX : after(began - s->w.claimed.task.ran_ms, s->w.limit.timeout_s);
}

static int64_t stall_ms(const slot *s)
{
    int64_t began = began_ms(s);
    return began == INT64_MAX ? INT64_MAX : after(most(s->w.moved_ms, began), s->w.limit.stall_s);
}

/* The user's request for the job. */
static settlement_stop find_request(slot *s)
{
    pthread_mutex_lock(&s->mutex);
    bool cancel = s->w.cancel_wanted, pause = s->w.pause_wanted, move = s->w.move_wanted;
    pthread_mutex_unlock(&s->mutex);
    if (cancel) return SETTLEMENT_CANCELLED;
    if (!(pause || move) || began_ms(s) != INT64_MAX) return SETTLEMENT_NOT_STOPPED;
    return pause ? SETTLEMENT_PAUSED : SETTLEMENT_MOVED;
}

/* Why the worker has to be stopped now, if it has to. */
static settlement_stop find_reason(slot *s, int64_t now)
{
    const slot_context *x = s->context;
    settlement_stop wish = find_request(s);
    if (wish != SETTLEMENT_NOT_STOPPED) return wish;
    if (now >= timeout_ms(s)) return SETTLEMENT_TIMED_OUT;
    if (now >= stall_ms(s)) return SETTLEMENT_STALLED;
    if (x->draining && now >= x->drain_ms) return SETTLEMENT_DRAINED;
    return SETTLEMENT_NOT_STOPPED;
}

static void stop_if_due(slot *s)
{
    work *w = &s->w;
    int64_t now = clock_monotonic_ms();
    settlement_stop why = find_reason(s, now);
    if (w->stop == SETTLEMENT_NOT_STOPPED || why == SETTLEMENT_CANCELLED) w->stop = why;
    if (w->stop == SETTLEMENT_NOT_STOPPED) return;
    if (s->phase == SLOT_RUNNING) {
        log_write(LOG_LEVEL_INFO, "attempt stop requested job=%s attempt=%d", w->claimed.job.id,
                  w->claimed.task.attempt);
        s->context->engine->cancel(w->attempt, false);
        w->force_ms = now + (int64_t)(s->context->grace_s * 1000);
        enter(s, SLOT_STOPPING);
    }
    if (!w->forced && (now >= w->force_ms || s->context->forcing)) {
        s->context->engine->cancel(w->attempt, true);
        w->forced = true;
    }
}

/* The step in the phases RUNNING and STOPPING. */
static unsigned step_running(slot *s)
{
    work *w = &s->w;
    const engine *runs = s->context->engine;
    const char *progress;
    bool ended = runs->poll(w->attempt, &progress);
    if (progress) keep_progress(s, progress);
    if (!ended && !*w->host) keep_host(s);
    if (!ended && s->phase == SLOT_RUNNING && s->context->draining && runs->leave) {
        log_write(LOG_LEVEL_INFO, "attempt continues job=%s attempt=%d", w->claimed.job.id,
                  w->claimed.task.attempt);
        runs->leave(w->attempt);
        w->attempt = NULL;
        return release(s);
    }
    if (!ended) {
        stop_if_due(s);
        return SLOT_NO_NEWS;
    }
    int64_t began = began_ms(s);
    runs->settle(w->attempt, &w->ending);
    w->ran_ms = w->ending.ran_ms ? w->ending.ran_ms : began == INT64_MAX ? 0 : clock_monotonic_ms() - began;
    w->attempt = NULL;
    w->has_ended = true;
    enter(s, SLOT_DECIDING);
    return SLOT_NO_NEWS;
}

/* ---- deciding, publishing, settling */

/* Describes the inputs of the result, so that other jobs may reuse it. */
static void describe_for_cache(slot *s)
{
    work *w = &s->w;
    if (w->settlement.decision != SETTLEMENT_SUCCEED || !is_cacheable(s)) return;
    w->cache_inputs = cache_describe_inputs(s->context->roots, w->directory, w->started_wall_ms);
    if (!w->cache_inputs) return;
    w->settlement.cache_key = w->claimed.cache_key;
    w->settlement.cache_inputs = w->cache_inputs;
}

/* Removes the uploads of the task that are damaged, so that they can be sent again. In a thread of its own. */
static void check_uploads(void *context)
{
    const slot *s = context;
    size_t count = 0;
    char own[STORE_INPUT_NAME_SIZE];
    const char **names = list_inputs(&s->w.claimed, own, &count);
    for (size_t i = 0; i < count; i++)
        store_inputs_discard_damaged(s->context->inputs, names[i], &s->w.call_end);
    free(names);
}

static unsigned step_deciding(slot *s)
{
    work *w = &s->w;
    error e = {0};
    if (!queue_has_place(s->context->place->q, &e)) {
        w->was_lost = true;
        return try_later(s, e.message);
    }
    settlement_decide(&w->claimed, w->stop,
                      w->stop == SETTLEMENT_STALLED ? w->limit.stall_s : w->limit.timeout_s, &w->ending,
                      w->directory, &w->settlement);
    w->settlement.ran_ms = w->ran_ms;
    if (w->settlement.decision == SETTLEMENT_UNDECIDED) return try_later(s, w->settlement.message);
    if (w->was_lost) settlement_excuse_loss(&w->settlement);
    describe_for_cache(s);
    if (w->settlement.code == ERROR_INPUT_DAMAGED && s->context->inputs)
        start_call(s, check_uploads, SLOT_CHECKING);
    else
        publish_or_settle(s);
    return SLOT_NO_NEWS;
}

static void step_checking(slot *s)
{
    if (take_call(s)) publish_or_settle(s);
}

static void step_publishing(slot *s)
{
    work *w = &s->w;
    error e = {0};
    if (!publication_has_ended(w->publication)) return;
    if (!publication_end(w->publication, &e)) settlement_decide_unpublished(&e, &w->settlement);
    w->publication = NULL;
    w->settlement.copied = w->copied = publication_temporary(w->directory);
    enter(s, SLOT_SETTLING);
}

static unsigned step_settling(slot *s)
{
    work *w = &s->w;
    error e = {0};
    const bool unwritten = w->settlement.decision == SETTLEMENT_RETRY_STORAGE;
    if (settlement_apply(s->context->place, &w->claimed, &w->settlement, w->has_ended ? &w->ending : NULL,
                         &e))
        return release(s) | (unwritten ? SLOT_NOT_WRITTEN : SLOT_NO_NEWS);
    return try_later(s, e.message);
}

/* ---- the machine */

static unsigned step_once(slot *s)
{
    switch (s->phase) {
    case SLOT_FREE:
        break;
    case SLOT_STARTING:
        return step_starting(s);
    case SLOT_REUSING:
        return step_reusing(s);
    case SLOT_RUNNING:
    case SLOT_STOPPING:
        return step_running(s);
    case SLOT_DECIDING:
        return clock_monotonic_ms() < s->w.retry_ms ? SLOT_NO_NEWS : step_deciding(s);
    case SLOT_CHECKING:
        step_checking(s);
        break;
    case SLOT_PUBLISHING:
        step_publishing(s);
        break;
    case SLOT_SETTLING:
        return clock_monotonic_ms() < s->w.retry_ms ? SLOT_NO_NEWS : step_settling(s);
    }
    return SLOT_NO_NEWS;
}

/* Performs steps until the phase is unchanged. A worker that was just started or signalled to end has no
 * output yet, so the loop also ends at these phases; the next step follows when there is output. */
unsigned slot_step(slot *s)
{
    unsigned news = SLOT_NO_NEWS;
    slot_phase before;
    do {
        before = s->phase;
        news |= step_once(s);
    } while (s->phase != before && s->phase != SLOT_FREE && s->phase != SLOT_RUNNING &&
             s->phase != SLOT_STOPPING);
    return news;
}

int64_t slot_due(const slot *s)
{
    const slot_context *x = s->context;
    const work *w = &s->w;
    int64_t due;
    switch (s->phase) {
    case SLOT_STARTING:
        return 0;
    case SLOT_RUNNING:
        due = least(timeout_ms(s), stall_ms(s));
        return x->draining ? least(due, x->drain_ms) : due;
    case SLOT_STOPPING:
        return w->forced ? INT64_MAX : w->force_ms;
    case SLOT_DECIDING:
    case SLOT_SETTLING:
        return w->retry_ms;
    case SLOT_FREE:
    case SLOT_REUSING: /* these three write to wake_fd at their ends */
    case SLOT_CHECKING:
    case SLOT_PUBLISHING:
        break;
    }
    return INT64_MAX;
}

size_t slot_watch(const slot *s, struct pollfd fds[ENGINE_MAX_FDS])
{
    return s->w.attempt ? s->context->engine->watch(s->w.attempt, fds) : 0;
}

/* ---- any thread */

/* Under the mutex. */
static bool holds(const slot *s, const char *id)
{
    return s->phase != SLOT_FREE && strcmp(s->w.claimed.job.id, id) == 0;
}

void slot_cancel(slot *s, const char *id)
{
    pthread_mutex_lock(&s->mutex);
    if (holds(s, id)) s->w.cancel_wanted = true;
    pthread_mutex_unlock(&s->mutex);
}

void slot_pause(slot *s, const char *id, bool paused)
{
    pthread_mutex_lock(&s->mutex);
    if (holds(s, id)) s->w.pause_wanted = paused;
    pthread_mutex_unlock(&s->mutex);
}

void slot_move(slot *s, const char *id, int priority)
{
    pthread_mutex_lock(&s->mutex);
    if (holds(s, id)) s->w.move_wanted = s->w.claimed.job.priority != priority;
    pthread_mutex_unlock(&s->mutex);
}

char *slot_progress(slot *s, const char *id)
{
    char *progress = NULL;
    pthread_mutex_lock(&s->mutex);
    if (holds(s, id) && s->w.progress) progress = mem_strdup(s->w.progress);
    pthread_mutex_unlock(&s->mutex);
    return progress;
}

bool slot_host(slot *s, const char *id, int task, char host[ENGINE_HOST_SIZE])
{
    pthread_mutex_lock(&s->mutex);
    bool found = holds(s, id) && s->w.claimed.task.number == task && s->w.began;
    if (found) memcpy(host, s->w.host, sizeof s->w.host);
    pthread_mutex_unlock(&s->mutex);
    return found;
}

slot_usage slot_get_usage(slot *s)
{
    pthread_mutex_lock(&s->mutex);
    slot_usage usage = {
        .attempts = s->phase != SLOT_FREE, .threads = s->w.threads, .memory_mb = s->w.memory_mb};
    pthread_mutex_unlock(&s->mutex);
    return usage;
}

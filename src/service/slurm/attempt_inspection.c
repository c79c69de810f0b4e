// SPDX-License-Identifier: Apache-2.0
/* attempt_inspection: finds out how each attempt has ended or why it waits, from the files of the attempts
 * and from the answers of Slurm.
 */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "base/json/json.h"
#include "service/slurm/engine_data.h"

/* Maximum time, in ms, by which a network file system may show an ending later than Slurm reports the end of
 * the job. */
#define LATE_MS 3000
/* Maximum time, in ms, to wait until Slurm reports why it stopped a worker. */
#define WORD_MS 30000
#define AVOID_MS 600000
/* Maximum age, in ms, of a listing that shows that an attempt waits. After that the attempt's files are
 * examined. */
#define FRESH_MS 2000

/* The data for the decision about an attempt, copied under the mutex. */
typedef struct view {
    engine_attempt *a;
    char *directory;
    bool waits; /* it is not submitted */
    bool refused, cancelled, forced, notified;
    slurm_task task; /* as reported by Slurm */
    bool has_started, is_claimed, has_predecessor;
    int64_t over_ms, stopped_ms, offset;
} view;

/* ---- the answers of Slurm */

/* Whether Slurm answers and has not listed the task for lost_s. */
static bool is_gone(const slurm *s, const slurm_task *t)
{
    return s->listing >= t->listing + 2 &&
           clock_monotonic_ms() - t->seen_ms >= (int64_t)(s->settings.lost_s * 1000);
}

/* Updates `runs` and `waiter` of the batch. The caller holds the mutex. */
static void survey(slurm *s, slurm_batch *b)
{
    b->runs = false;
    b->waiter = b->task_count;
    for (size_t i = 0; i < b->task_count; i++) {
        const slurm_task *t = &b->tasks[i];
        if (is_gone(s, t) || (t->state && t->state->over)) continue;
        if (t->state && t->state->waits)
            b->waiter = i;
        else
            b->runs = true;
    }
    s->sharing |= b->shared && b->runs;
}

/* The task that determines the state of the attempt. An attempt that any task may run has the state of the
 * task that may run it first. The caller holds the mutex. */
static slurm_task find_task(const slurm *s, const engine_attempt *a)
{
    const slurm_batch *b = a->batch;
    bool open = b->shared && !a->is_claimed, waits = open && b->waiter < b->task_count;
    if (open && (b->runs || (waits && s->sharing))) return (slurm_task){.seen_ms = clock_monotonic_ms()};
    slurm_task task = b->tasks[waits ? b->waiter : a->task];
    if (is_gone(s, &task)) task.state = &slurm_state_gone;
    return task;
}

static view take_view(const slurm *s, engine_attempt *a)
{
    view v = {.a = a,
              .directory = a->directory,
              .waits = !a->batch,
              .refused = a->refused,
              .cancelled = a->cancelled,
              .forced = a->forced,
              .notified = a->notified,
              .has_started = a->began_ms != INT64_MAX,
              .is_claimed = a->is_claimed,
              .has_predecessor = a->has_predecessor,
              .over_ms = a->over_ms,
              .stopped_ms = a->stopped_ms,
              .offset = a->offset};
    if (a->batch) v.task = find_task(s, a);
    return v;
}

/* ---- decisions */

/* Wakes the executor. The caller holds the mutex. */
static void wake(const engine_attempt *a)
{
    if (a->left) return;
    ssize_t written = write(a->place->wake_fd, &(uint64_t){1}, sizeof(uint64_t));
    (void)written; /* if the counter is full, it is readable already */
}

static void end(view *v, const engine_ending *ending)
{
    slurm *s = v->a->place;
    pthread_mutex_lock(&s->mutex);
    free(v->a->ending.last_words);
    v->a->ending = *ending;
    slurm_leave(v->a);
    v->a->ended = true;
    wake(v->a);
    pthread_mutex_unlock(&s->mutex);
}

static void end_lost(view *v, engine_loss loss, const char *why)
{
    engine_ending ending = {.exit_status = -1, .signal = -1, .loss = loss};
    snprintf(ending.why, sizeof ending.why, "%s%s%s", why, *v->task.host ? ", node " : "", v->task.host);
    snprintf(ending.host, sizeof ending.host, "%s", v->task.host);
    end(v, &ending);
}

/* Stores a line of progress; takes it over. */
static void put_progress(view *v, char *line)
{
    slurm *s = v->a->place;
    pthread_mutex_lock(&s->mutex);
    free(v->a->fresh);
    v->a->fresh = line;
    wake(v->a);
    pthread_mutex_unlock(&s->mutex);
}

/* Reports the reason why the attempt waits in Slurm, whenever it changes. */
static void tell_waiting(view *v)
{
    if (!*v->task.reason || strcmp(v->task.reason, v->a->reason) == 0) return;
    snprintf(v->a->reason, sizeof v->a->reason, "%s", v->task.reason);
    json *line = json_new_object();
    json_put_string(line, "phase", "queue");
    json_put_number(line, "fraction", 0);
    json_put_string(line, "reason", v->task.reason);
    put_progress(v, json_print(line));
    json_free(line);
}

/* Records whether the attempt has begun, and in which task. */
static void look_for_claim(view *v)
{
    slurm *s = v->a->place;
    engine_attempt *a = v->a;
    attempt_files_batch by;
    if (v->is_claimed || !attempt_files_read_claim(v->directory, &by)) return;
    pthread_mutex_lock(&s->mutex);
    if (!v->has_started) a->began_ms = clock_monotonic_ms();
    v->has_started = true;
    if (a->batch && strncmp(by.name, s->prefix, strlen(s->prefix)) == 0 && by.task < SLURM_TASKS_MOST) {
        slurm_take(a, &by);
        v->is_claimed = true;
        v->has_predecessor = a->has_predecessor;
        v->task = find_task(s, a);
    }
    pthread_mutex_unlock(&s->mutex);
}

/* Records the host of an attempt that has begun, once Slurm has reported it. */
static void keep_host(view *v)
{
    slurm *s = v->a->place;
    pthread_mutex_lock(&s->mutex);
    if (!*v->a->host) snprintf(v->a->host, sizeof v->a->host, "%s", v->task.host);
    pthread_mutex_unlock(&s->mutex);
}

static void keep_progress(view *v)
{
    slurm *s = v->a->place;
    char *line = attempt_files_read_progress(v->directory, &v->offset);
    if (!line) return;
    pthread_mutex_lock(&s->mutex);
    v->a->offset = v->offset;
    pthread_mutex_unlock(&s->mutex);
    put_progress(v, line);
}

/* The loss of an attempt whose worker has begun. A time limit that other attempts have partly used does
 * not count. */
static engine_loss find_loss(const view *v)
{
    engine_loss loss = v->task.state->begun;
    return loss == ENGINE_OUT_OF_TIME && v->has_predecessor ? ENGINE_INTERRUPTED : loss;
}

/* Sets the reason why a worker was stopped. Slurm may be the only source of the reason. False: Slurm has not
 * reported it yet. */
static bool explain(view *v, engine_ending *ending)
{
    const slurm_state *state = v->task.state;
    bool killed = ending->signal == SIGKILL || ending->signal == SIGTERM ||
                  ending->exit_status == WORKER_EXIT_CANCELLED;
    if (v->cancelled || !killed) return true;
    int64_t now = clock_monotonic_ms();
    if (!v->stopped_ms) {
        pthread_mutex_lock(&v->a->place->mutex);
        v->a->stopped_ms = now;
        pthread_mutex_unlock(&v->a->place->mutex);
        return false;
    }
    if ((state && state->waits && v->task.seen_ms > v->stopped_ms) ||
        attempt_files_is_requeued(v->directory)) {
        ending->loss = ENGINE_GIVEN_BACK;
        snprintf(ending->why, sizeof ending->why, "Slurm requeued the job");
        return true;
    }
    if (state && state->speaks) {
        ending->loss = find_loss(v);
        ending->out_of_memory = strcmp(state->name, "OUT_OF_MEMORY") == 0;
        snprintf(ending->why, sizeof ending->why, "%s, node %s", state->words, ending->host);
        if (!ending->out_of_memory) return true;
        ending->loss = ENGINE_NOT_LOST;
        ending->exit_status = -1;
        ending->signal = SIGKILL;
        return true;
    }
    return (state && state->over) || now - v->stopped_ms >= WORD_MS;
}

/* Handles an ending that cannot be read. The storage may have failed temporarily: the ending is read again
 * for lost_s, or until the attempt is abandoned. False: it was abandoned. */
static bool wait_for_ending(view *v, const error *why)
{
    char words[256];
    int64_t now = clock_monotonic_ms();
    if (!v->a->unread_ms) {
        v->a->unread_ms = now;
        log_write(LOG_LEVEL_WARNING, "slurm: cannot read the end of an attempt and tries again: %s",
                  why->message);
    }
    if (v->forced) return false;
    if (now - v->a->unread_ms < (int64_t)(v->a->place->settings.lost_s * 1000)) return true;
    snprintf(words, sizeof words, "cannot read the end of the attempt: %.200s", why->message);
    end_lost(v, ENGINE_INTERRUPTED, words);
    return true;
}

/* Reads the ending. True if there is an ending, or if it must be read again. */
static bool read_ending(view *v)
{
    engine_ending ending = {0};
    bool found = false;
    error e = {0};
    if (!attempt_files_read_ending(v->directory, &ending, &found, &e)) return wait_for_ending(v, &e);
    v->a->unread_ms = 0;
    if (found && explain(v, &ending))
        end(v, &ending);
    else
        free(ending.last_words);
    return found;
}

/* Cancels an attempt. The creator of the claim owns it: if this is the service, no node will run the
 * attempt. */
static void follow_cancel(view *v)
{
    error e = {0};
    attempt_files_claim claim = v->has_started ? ATTEMPT_FILES_TAKEN : attempt_files_take(v->directory, NULL);
    if (claim == ATTEMPT_FILES_WON || claim == ATTEMPT_FILES_GONE) {
        end_lost(v, ENGINE_GIVEN_BACK, "its worker had not started");
    } else if (!v->notified && attempt_files_cancel(v->directory, &e)) {
        pthread_mutex_lock(&v->a->place->mutex);
        v->a->notified = true;
        pthread_mutex_unlock(&v->a->place->mutex);
    } else if (v->forced) {
        end_lost(v, ENGINE_INTERRUPTED, "it was abandoned while its worker may still have run");
    }
}

static void avoid_host(slurm *s, const char *host)
{
    log_write(
        LOG_LEVEL_WARNING,
        "slurm: an attempt failed on the node %s before its worker started, and the node is excluded for %d minutes:"
        " check that hexad-node and work_dir are available there",
        host, AVOID_MS / 60000);
    pthread_mutex_lock(&s->mutex);
    slurm_avoided *next = &s->avoided[s->avoided_next++ % AVOIDED_MOST];
    snprintf(next->host, sizeof next->host, "%s", host);
    next->until_ms = clock_monotonic_ms() + AVOID_MS;
    pthread_mutex_unlock(&s->mutex);
}

static void follow_over(view *v)
{
    const slurm_state *state = v->task.state;
    int64_t now = clock_monotonic_ms();
    error e = {0};
    if (!v->over_ms) {
        pthread_mutex_lock(&v->a->place->mutex);
        v->a->over_ms = now;
        pthread_mutex_unlock(&v->a->place->mutex);
        return;
    }
    if (now - v->over_ms < LATE_MS) return;
    attempt_files_claim claim = attempt_files_take(v->directory, NULL);
    if (claim == ATTEMPT_FILES_UNCLEAR) return;
    if (claim == ATTEMPT_FILES_TAKEN) attempt_files_cancel(v->directory, &e); /* its worker may still run */
    if (claim == ATTEMPT_FILES_TAKEN && strcmp(state->name, "OUT_OF_MEMORY") == 0) {
        engine_ending ending = {.exit_status = -1, .signal = SIGKILL, .out_of_memory = true};
        end(v, &ending);
        return;
    }
    if (claim == ATTEMPT_FILES_WON && strcmp(state->name, "FAILED") == 0 && *v->task.host)
        avoid_host(v->a->place, v->task.host);
    end_lost(v, claim == ATTEMPT_FILES_TAKEN ? find_loss(v) : state->not_begun, state->words);
}

static void inspect(view *v)
{
    const slurm_state *state = v->task.state;
    if (v->refused) {
        end_lost(v, ENGINE_REFUSED, v->a->ending.why);
        return;
    }
    if (v->waits) {
        if (v->cancelled) end_lost(v, ENGINE_GIVEN_BACK, "it was not submitted");
        return;
    }
    bool fresh = clock_monotonic_ms() - v->task.seen_ms < FRESH_MS;
    if (state && state->waits && fresh && !v->cancelled && !v->has_started) { /* no access to the storage */
        tell_waiting(v);
        return;
    }
    look_for_claim(v);
    state = v->task.state;
    bool over = state && state->over;
    if (v->has_started) keep_host(v);
    if (v->has_started || over) { /* otherwise there is neither */
        keep_progress(v);
        if (read_ending(v)) return;
    }
    if (v->cancelled)
        follow_cancel(v);
    else if (over)
        follow_over(v);
}

void slurm_inspect(slurm *s)
{
    pthread_mutex_lock(&s->mutex);
    size_t count = 0;
    view *views = mem_alloc((s->attempt_count + 1) * sizeof *views);
    s->sharing = false;
    slurm_batch *b;
    LIST_FOREACH (b, &s->batches, link) survey(s, b);
    engine_attempt *a;
    TAILQ_FOREACH (a, &s->attempts, link)
        if (!a->ended) views[count++] = take_view(s, a);
    pthread_mutex_unlock(&s->mutex);
    for (size_t i = 0; i < count; i++) inspect(&views[i]);
    free(views);
}

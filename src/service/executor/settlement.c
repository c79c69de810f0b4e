// SPDX-License-Identifier: Apache-2.0
#include "service/executor/settlement.h"

#include <assert.h>
#include <inttypes.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "base/json/json.h"
#include "service/results/own_report.h"
#include "service/results/result.h"
#include "files/file.h"

static void set_end(settlement *s, queue_state state, const error *why)
{
    s->decision = SETTLEMENT_END;
    s->state = state;
    s->code = why->code;
    snprintf(s->message, sizeof s->message, "%s", why->message);
}

static void set_success(settlement *s, queue_outcome outcome)
{
    s->decision = SETTLEMENT_SUCCEED;
    s->state = QUEUE_SUCCEEDED;
    s->outcome = outcome;
}

/* The last part of the messages of crashed attempts. */
static const char ADVICE_FAULT[] = ", a fault of hexad: report it with the spec and the log",
                  ADVICE_STOPPED[] =
                      ": look for the cause in the logs of the job and of the machine, then retry the job";

/* Retries the task of a crashed or stalled attempt if it has attempts left. Otherwise the task fails;
 * `advice` ends the message. */
static void set_crashed(settlement *s, const queue_claimed *c, const error *why, const char *advice)
{
    if (c->task.spent < c->job.max_attempts) {
        s->decision = SETTLEMENT_RETRY_CRASHED;
        s->code = why->code;
        return;
    }
    error e = *why;
    error_set(&e, why->code, "%s in attempt %d of %d%s", why->message, c->task.spent, c->job.max_attempts,
              advice);
    set_end(s, QUEUE_FAILED, &e);
}

bool settlement_read_last_words(const char *words, error *said)
{
    json *document = json_parse(words, strlen(words), NULL);
    json_at root = json_root(document);
    const char *code = json_string(json_member(&root, "code"), NULL);
    const char *message = json_string(json_member(&root, "message"), NULL);
    bool ok = code && message;
    if (ok) error_set(said, error_code_from_name(code), "%s", message);
    json_free(document);
    return ok;
}

static void decide_success(const char *directory, settlement *s)
{
    result r = {0};
    error e = {0};
    if (result_read(directory, &r, &e)) {
        set_success(s, r.outcome);
        result_clear(&r);
        return;
    }
    if (e.code ==
        ERROR_INTERNAL) { /* a finished job must not fail because its result cannot be read at the moment */
        s->decision = SETTLEMENT_UNDECIDED;
        snprintf(s->message, sizeof s->message, "%s", e.message);
        return;
    }
    error_prefix(
        &e, "the worker reported success but wrote no valid result (report this with the spec and the log)");
    e.code = ERROR_INTERNAL;
    set_end(s, QUEUE_FAILED, &e);
}

/* Queues the task again because of a fault of the host. settlement_apply limits the number of such
 * retries. */
static void set_storage(settlement *s, const error *why)
{
    set_end(s, QUEUE_FAILED, why); /* this is how the task ends when no retry is left */
    s->decision = SETTLEMENT_RETRY_STORAGE;
    snprintf(s->reason, sizeof s->reason, "%s: %.120s", error_code_name(why->code), why->message);
}

static void decide_exit(const queue_claimed *c, const engine_ending *ending, settlement *s)
{
    error said = {0};
    bool spoke = settlement_read_last_words(ending->last_words, &said);
    if (ending->exit_status == WORKER_EXIT_CANCELLED) {
        /* the executor did not request it, so another process sent the signal, which counts as a crash */
        error_set(&said, ERROR_INTERNAL, "another process stopped the worker");
        set_crashed(s, c, &said, ADVICE_STOPPED);
        return;
    }
    if (!spoke)
        error_set(
            &said, ERROR_INTERNAL,
            "the worker ended with exit status %d and no error message: report it with the spec and the "
            "log%s%.200s",
            ending->exit_status, *ending->last_words ? ", whose last line is: " : "", ending->last_words);
    if (error_is_of_storage(said.code))
        set_storage(s, &said);
    else
        set_end(s, said.code == ERROR_LIMIT_TIME ? QUEUE_TIMED_OUT : QUEUE_FAILED, &said);
}

/* Whether a fault of the program causes this signal, and not another process. */
static bool is_fault(int signal)
{
    return signal == SIGSEGV || signal == SIGBUS || signal == SIGILL || signal == SIGFPE ||
           signal == SIGABRT || signal == SIGSYS || signal == SIGTRAP;
}

/* In the sandbox no process can send itself SIGABRT: abort ends by one of these (base/core/sandbox). */
static bool may_be_abort(int signal)
{
    return signal == SIGSEGV || signal == SIGTRAP;
}

static void decide_signal(const queue_claimed *c, const engine_ending *ending, settlement *s)
{
    error e = {0};
    if (ending->out_of_memory) {
        error_set(&e, ERROR_LIMIT_MEMORY,
                  "the worker exceeded its %" PRId64
                  " MiB and was killed by the kernel: raise limits.memory_mb",
                  c->job.memory_mb);
        snprintf(s->reason, sizeof s->reason, "out of memory: signal %d", ending->signal);
        set_end(s, QUEUE_FAILED, &e);
        return;
    }
    const char *name = sigabbrev_np(ending->signal);
    error_set(&e, ERROR_INTERNAL, "the worker was killed by signal %d (SIG%s%s)", ending->signal,
              name ? name : "?", may_be_abort(ending->signal) ? ": it crashed or aborted" : "");
    set_crashed(s, c, &e, is_fault(ending->signal) ? ADVICE_FAULT : ADVICE_STOPPED);
}

static bool is_success(const engine_ending *ending)
{
    return ending->exit_status == WORKER_EXIT_CONVERGED || ending->exit_status == WORKER_EXIT_UNRESOLVED ||
           ending->exit_status == WORKER_EXIT_NOT_CONVERGED;
}

static void describe(const engine_ending *ending, const char *prefix, settlement *s)
{
    if (ending->loss)
        snprintf(s->reason, sizeof s->reason, "%s%.140s", prefix, ending->why);
    else if (ending->signal >= 0)
        snprintf(s->reason, sizeof s->reason, "%ssignal %d", prefix, ending->signal);
    else
        snprintf(s->reason, sizeof s->reason, "%sexit status %d", prefix, ending->exit_status);
}

static void set_timed_out(settlement *s, double limit_s)
{
    error e = {0};
    error_set(&e, ERROR_LIMIT_TIME,
              "the job exceeded limits.timeout_s = %g s over all attempts: raise it, or ask for "
              "fewer points",
              limit_s);
    set_end(s, QUEUE_TIMED_OUT, &e);
}

static void set_interrupted(settlement *s)
{
    s->decision = SETTLEMENT_RETRY_INTERRUPTED;
    s->code = ERROR_INTERRUPTED;
}

static void decide_loss(const queue_claimed *c, const engine_ending *ending, settlement *s)
{
    error e = {0};
    switch (ending->loss) {
    case ENGINE_NOT_LOST:
        break;
    case ENGINE_GIVEN_BACK:
        s->decision = SETTLEMENT_RETRY;
        return;
    case ENGINE_INTERRUPTED:
        set_interrupted(s);
        return;
    case ENGINE_CRASHED:
        error_set(&e, ERROR_INTERNAL, "%s", ending->why);
        set_crashed(s, c, &e, ADVICE_STOPPED);
        return;
    case ENGINE_OUT_OF_TIME:
        error_set(&e, ERROR_LIMIT_TIME, "%s", ending->why);
        set_end(s, QUEUE_TIMED_OUT, &e);
        return;
    case ENGINE_REFUSED:
        error_set(&e, ERROR_NOT_SUPPORTED, "%s", ending->why);
        set_end(s, QUEUE_FAILED, &e);
        return;
    }
}

void settlement_decide(const queue_claimed *c, settlement_stop stop, double limit_s,
                       const engine_ending *ending, const char *directory, settlement *s)
{
    *s = (settlement){0};
    error e = {0};
    switch (stop) {
    case SETTLEMENT_CANCELLED:
        describe(ending, "cancelled: ", s);
        error_set(&e, ERROR_CANCELLED, "cancelled while it ran");
        set_end(s, QUEUE_CANCELLED, &e);
        return;
    case SETTLEMENT_TIMED_OUT:
        set_timed_out(s, limit_s);
        describe(ending, "timeout: ", s);
        return;
    case SETTLEMENT_STALLED:
        describe(ending, "stalled: ", s);
        error_set(&e, ERROR_STALLED, "the worker reported no progress for %g s (limits.stall_s)", limit_s);
        set_crashed(s, c, &e,
                    ": raise limits.stall_s; if the job stalls again, report it with the spec and the log");
        return;
    case SETTLEMENT_DRAINED:
    case SETTLEMENT_PAUSED:
    case SETTLEMENT_MOVED:
        describe(ending,
                 stop == SETTLEMENT_PAUSED  ? "paused: "
                 : stop == SETTLEMENT_MOVED ? "priority changed: "
                                            : "drained: ",
                 s);
        if (is_success(ending)) break;
        s->decision = SETTLEMENT_RETRY;
        return;
    case SETTLEMENT_NOT_STOPPED:
        describe(ending, "", s);
        break;
    }
    if (ending->loss)
        decide_loss(c, ending, s);
    else if (is_success(ending))
        decide_success(directory, s);
    else if (ending->signal >= 0)
        decide_signal(c, ending, s);
    else
        decide_exit(c, ending, s);
}

void settlement_excuse_loss(settlement *s)
{
    error e = {0};
    if (s->decision != SETTLEMENT_RETRY_CRASHED && s->state != QUEUE_FAILED) return;
    error_set(&e, ERROR_STORAGE_FAILED, "the state directory was not at its path when the worker ended");
    set_storage(s, &e);
}

void settlement_decide_unstarted(const error *why, settlement *s)
{
    *s = (settlement){.decision = SETTLEMENT_RETRY};
    snprintf(s->reason, sizeof s->reason, "not started: %.140s", why->message);
}

void settlement_decide_too_large(const queue_claimed *claimed, int64_t memory_mb, settlement *s)
{
    error e = {0};
    error_set(&e, ERROR_LIMIT_MEMORY,
              "limits.memory_mb is %" PRId64 " MiB, more than the %" PRId64
              " MiB that this service has for all jobs: lower it, or raise host_memory_mb",
              claimed->job.memory_mb, memory_mb);
    *s = (settlement){0};
    snprintf(s->reason, sizeof s->reason, "not started: too large");
    set_end(s, QUEUE_FAILED, &e);
}

void settlement_decide_late(double limit_s, settlement *s)
{
    *s = (settlement){0};
    snprintf(s->reason, sizeof s->reason, "not started: its time is spent");
    set_timed_out(s, limit_s);
}

void settlement_decide_cached(queue_outcome outcome, const char *from, settlement *s)
{
    *s = (settlement){.cached_from = from};
    set_success(s, outcome);
    snprintf(s->reason, sizeof s->reason, "the result of an equal job"); /* which may be another user's */
}

bool settlement_decide_kept(const char *directory, settlement *s, error *e)
{
    result r = {0};
    if (!result_read(directory, &r, e)) return false;
    *s = (settlement){0};
    set_success(s, r.outcome);
    snprintf(s->reason, sizeof s->reason, "the result of an earlier attempt");
    result_clear(&r);
    return true;
}

void settlement_decide_unpublished(const error *why, settlement *s)
{
    error fault = *why;
    if (why->code == ERROR_INPUT_DAMAGED) fault.code = ERROR_STORAGE_FAILED; /* of the disk of the attempt */
    if (error_is_of_storage(fault.code)) {
        s->keep = why->code == fault.code;
        s->outcome = QUEUE_NO_OUTCOME;
        set_storage(s, &fault);
    } else {
        s->copy_fault = *why;
    }
}

/* Fails a task that was tried storage_retries times while a disk was full or failed. */
static void bound_storage(const settlement_place *place, const queue_claimed *c, settlement *s)
{
    error e = {.code = s->code};
    if (s->decision != SETTLEMENT_RETRY_STORAGE || c->task.storage_faults < place->storage_retries) return;
    error_set(&e, s->code, "%s (the last of %d tries, setting storage_retries)", s->message,
              c->task.storage_faults + 1);
    s->keep = false;
    set_end(s, QUEUE_FAILED, &e);
}

/* An attempt that ended with the daemon, its host or its node does not count against max_attempts.
 * max_interruptions stops a job that ends them each time. */
static void bound_interruptions(const settlement_place *place, const queue_claimed *c, settlement *s)
{
    error e = {0};
    int times = c->task.interrupted + 1;
    if (s->decision != SETTLEMENT_RETRY_INTERRUPTED || place->max_interruptions <= 0 ||
        times <= place->max_interruptions)
        return;
    error_set(&e, ERROR_INTERRUPTED,
              "hexad or the machine of the worker stopped %d times while the job ran, and the setting "
              "max_interruptions allows %d: look for the cause in the log of hexad, then retry the job",
              times, place->max_interruptions);
    set_end(s, QUEUE_FAILED, &e);
}

/* Earliest time of the next attempt, wall clock; 0: now. */
static int64_t next_try_ms(const settlement_place *place, const queue_claimed *c,
                           settlement_decision decision)
{
    if (decision != SETTLEMENT_RETRY_CRASHED && decision != SETTLEMENT_RETRY_STORAGE) return 0;
    double wait_s = place->backoff.first_s;
    int times = decision == SETTLEMENT_RETRY_STORAGE ? c->task.storage_faults + 1 : c->task.spent;
    for (int i = 1; i < times && wait_s < place->backoff.most_s; i++) wait_s *= 2;
    return clock_wall_ms() + (int64_t)(fmin(wait_s, place->backoff.most_s) * 1000);
}

/* Moves the result into place and makes the move durable. The result may be in place already: at a start, or
 * if the flush of an earlier try failed. */
static bool move_result(const char *work_dir, const char *from, const char *to, bool in_place, error *e)
{
    if (!in_place && (access(from, F_OK) == 0 || access(to, F_OK) != 0)) return store_rename(from, to, e);
    char *attempts = mem_printf("%s/attempts", work_dir), *results = mem_printf("%s/results", work_dir);
    bool ok = store_directory_sync(results, e) && store_directory_sync(attempts, e);
    free(attempts);
    free(results);
    return ok;
}

/* Whether the attempt is still the current one (the fence). This is checked before a result moves into place.
 * The queue checks again in its transaction. */
static bool check_fence(queue *q, const queue_claimed *c, bool *current, error *e)
{
    queue_task *now = NULL;
    size_t count = 0;
    if (!queue_list_tasks(q, c->job.id, c->task.number - 1, 1, &now, &count, e)) return false;
    *current = count && now->attempt == c->task.attempt && now->state == QUEUE_RUNNING;
    queue_tasks_free(now, count);
    return true;
}

/* Describes the end of the attempt for the queue. */
static queue_ending make_ending(const settlement_place *place, const queue_claimed *c, const settlement *s,
                                const engine_ending *ending, int64_t bytes)
{
    bool success = s->decision == SETTLEMENT_SUCCEED; /* a result that is kept for its copy is not reused */
    bool uncopied = s->copy_fault.code != ERROR_NONE;
    return (queue_ending){
        .state = s->state,
        .outcome = s->outcome,
        .error_code = s->code == ERROR_NONE ? NULL : error_code_name(s->code),
        .error_message = s->code == ERROR_NONE ? NULL : s->message,
        .exit_status = ending ? ending->exit_status : -1,
        .signal = ending ? ending->signal : -1,
        .peak_memory_bytes = ending ? ending->peak_memory_bytes : 0,
        .waited_ms = ending ? ending->waited_ms : 0,
        .processor_ms = ending ? ending->processor_ms : 0,
        .ran_ms = s->ran_ms,
        .interrupted = s->decision == SETTLEMENT_RETRY_INTERRUPTED,
        .storage_fault = s->decision == SETTLEMENT_RETRY_STORAGE,
        .host = ending && *ending->host ? ending->host : place->host,
        .reason = s->reason,
        .cached_from = success ? s->cached_from : NULL,
        .copied = s->copied,
        .bytes = bytes,
        .delivered = success && c->directory && !uncopied && !s->copy_pending,
        .copy_pending = success && s->copy_pending,
        .copy_code = success && uncopied ? error_code_name(s->copy_fault.code) : NULL,
        .copy_message = success && uncopied ? s->copy_fault.message : NULL,
        .cache_key = success ? s->cache_key : NULL,
        .cache_inputs = success ? s->cache_inputs : NULL,
    };
}

/* Moves the result into place, or removes the attempt's files. False if the disk is at fault: the caller
 * tries again later. */
static bool settle_directory(const settlement_place *place, const queue_claimed *c, const settlement *s,
                             const char *directory, error *e)
{
    bool current = true, deliver = s->decision == SETTLEMENT_SUCCEED;
    if (deliver && !check_fence(place->q, c, &current, e)) return false;
    if (deliver && current) {
        char *results = result_directory(place->work_dir, c->job.id, c->task.frame);
        bool ok = move_result(place->work_dir, directory, results, s->in_place, e);
        free(results);
        return ok;
    }
    if (!s->keep) result_remove_leftovers(directory);
    return true;
}

/* The disk space of the attempt. A result that is kept for the next attempt is counted at the end of that
 * attempt. */
static int64_t measure_left(const settlement_place *place, const queue_claimed *c, const settlement *s,
                            const char *directory)
{
    if (s->keep) return 0;
    if (s->decision != SETTLEMENT_SUCCEED) return result_disk_bytes(directory);
    char *results = result_directory(place->work_dir, c->job.id, c->task.frame);
    int64_t bytes = result_disk_bytes(results);
    free(results);
    return bytes;
}

/* Stores the decision in the queue. If the task was cancelled in the meantime, it ends as cancelled instead
 * of being queued again. */
static bool settle_task(const settlement_place *place, const queue_claimed *c, const settlement *s,
                        const engine_ending *ending, const char *directory, error *e)
{
    bool requeue = s->decision >= SETTLEMENT_RETRY, accepted = false;
    queue_ending end = make_ending(place, c, s, ending, measure_left(place, c, s, directory));
    const queue_fence fence = {c->job.id, c->task.number, c->task.attempt};
    bool ok = requeue ? queue_requeue(place->q, &fence, s->decision == SETTLEMENT_RETRY_CRASHED,
                                      next_try_ms(place, c, s->decision), &end, &accepted, e)
                      : queue_finish(place->q, &fence, &end, &accepted, e);
    error_code code = s->code;
    if (ok && !accepted && requeue) {
        requeue = false;
        code = ERROR_CANCELLED;
        end.state = QUEUE_CANCELLED;
        end.error_code = error_code_name(code);
        end.error_message = "cancelled while it ran";
        if (s->keep) result_remove_leftovers(directory);
        ok = queue_finish(place->q, &fence, &end, &accepted, e);
    }
    if (ok && accepted)
        meter_note_end(place->meter, requeue ? QUEUE_QUEUED : end.state, end.outcome, code, s->ran_ms);
    if (ok)
        log_write(accepted && code != ERROR_INTERNAL ? LOG_LEVEL_INFO : LOG_LEVEL_WARNING,
                  "attempt ended job=%s task=%d attempt=%d reason=\"%s\" state=%s%s%s%s%s", c->job.id,
                  c->task.number, c->task.attempt, s->reason,
                  requeue ? "queued" : queue_state_name(end.state), end.error_code ? " code=" : "",
                  end.error_code ? end.error_code : "", end.error_message && *end.error_message ? ": " : "",
                  end.error_message ? end.error_message : "");
    return ok;
}

bool settlement_apply(const settlement_place *place, const queue_claimed *c, const settlement *decided,
                      const engine_ending *ending, error *e)
{
    settlement s = *decided;
    assert(s.decision != SETTLEMENT_UNDECIDED);
    if (!queue_has_place(place->q, e)) return false; /* its files are elsewhere */
    bound_storage(place, c, &s);
    bound_interruptions(place, c, &s);
    char *directory = result_attempt_directory(place->work_dir, c->job.id, c->task.frame, c->task.attempt);
    bool ok = settle_directory(place, c, &s, directory, e) && settle_task(place, c, &s, ending, directory, e);
    free(directory);
    return ok;
}

static void decide_interrupted(bool restarted, settlement *s)
{
    snprintf(s->reason, sizeof s->reason, "the %s during the attempt",
             restarted ? "host restarted" : "daemon ended");
    set_interrupted(s);
}

static bool recover_task(const settlement_place *place, const queue_claimed *c, bool restarted, error *e)
{
    settlement s = {0};
    result r = {0};
    error why = {0};
    struct stat info;
    char *results = result_directory(place->work_dir, c->job.id, c->task.frame);
    bool found = lstat(results, &info) == 0;
    /* an earlier version may have ended after it gave the task the report of another job */
    bool good = found && S_ISDIR(info.st_mode) && result_read(results, &r, &why) &&
                result_compare_at_start(results, &r, &why) &&
                (c->task.frame != QUEUE_NO_FRAME || own_report_correct(results, c->job.spec, &why));
    const queue_outcome outcome = r.outcome;
    result_clear(&r);
    if (found && !good && why.code != ERROR_NONE && why.code != ERROR_STORAGE_FAILED &&
        why.code != ERROR_INPUT_DAMAGED) { /* never discard what could not be examined, as on a full disk */
        free(results);
        if (e) *e = why;
        return error_prefix(e, "the result of job %s", c->job.id);
    }
    if (good) {
        set_success(&s, outcome);
        s.in_place = true;
        s.copy_pending = c->directory != NULL; /* whether it was copied is unknown */
        snprintf(s.reason, sizeof s.reason, "the result was found at the start of the daemon");
    } else if (c->job.state == QUEUE_CANCELLING) {
        error_set(&why, ERROR_CANCELLED, "cancelled while it ran");
        decide_interrupted(restarted, &s); /* for the reason */
        set_end(&s, QUEUE_CANCELLED, &why);
    } else {
        decide_interrupted(restarted, &s);
    }
    /* what is there and no result is moved to lost+found (service/results/inventory) */
    bool ok = settlement_apply(place, c, &s, NULL, e);
    free(results);
    return ok;
}

bool settlement_recover(const settlement_place *place, bool restarted, settlement_keep *keep, void *keeper,
                        error *e)
{
    queue_claimed *left = NULL;
    size_t count = 0;
    if (!queue_list_unsettled(place->q, &left, &count, e)) return false;
    bool ok = true;
    for (size_t i = 0; ok && i < count; i++) {
        if (keep && keep(keeper, &left[i]))
            left[i] = (queue_claimed){0};
        else
            ok = recover_task(place, &left[i], restarted, e);
    }
    queue_claimed_free(left, count);
    return ok;
}

#include "queue/book.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

#define BOOK_COLUMNS                                                                                    \
    "seq, revision, state, is_array, is_paused, is_cancelled, pending, tasks, ready, delayed, running," \
    " succeeded, failed, cancelled, timed_out, not_converged, attempts, started_ms, finished_ms, "      \
    "retention_s, is_ordered"

static void read_book(sqlite3_stmt *s, book *b)
{
    *b = (book){
        .seq = sqlite3_column_int64(s, 0),
        .revision = sqlite3_column_int64(s, 1),
        .array = sqlite3_column_int(s, 3),
        .paused = sqlite3_column_int(s, 4),
        .cancelled = sqlite3_column_int(s, 5),
        .pending = sqlite3_column_int(s, 6),
        .tasks = sqlite3_column_int(s, 7),
        .ready = sqlite3_column_int(s, 8),
        .delayed = sqlite3_column_int(s, 9),
        .running = sqlite3_column_int(s, 10),
        .succeeded = sqlite3_column_int(s, 11),
        .failed = sqlite3_column_int(s, 12),
        .cancelled_tasks = sqlite3_column_int(s, 13),
        .timed_out = sqlite3_column_int(s, 14),
        .not_converged = sqlite3_column_int(s, 15),
        .attempts = sqlite3_column_int(s, 16),
        .started_ms = sqlite3_column_int64(s, 17),
        .finished_ms = sqlite3_column_int64(s, 18),
        .retention_s = sqlite3_column_int64(s, 19),
        .ordered = sqlite3_column_int(s, 20),
    };
    queue_state_from_name((const char *)sqlite3_column_text(s, 2), &b->state);
}

static bool load(database *d, sqlite3_stmt *s, book *b, bool *found, error *e)
{
    bool ok = false;
    *found = database_next(d, s, &ok, e);
    if (!*found) return ok;
    read_book(s, b);
    database_end(s);
    return true;
}

bool book_load(database *d, const char *id, book *b, bool *found, error *e)
{
    return load(d, ASK(d, e, "SELECT " BOOK_COLUMNS " FROM job WHERE id = ?1", text(id)), b, found, e);
}

bool book_load_row(database *d, int64_t seq, book *b, error *e)
{
    bool found = false;
    return load(d, ASK(d, e, "SELECT " BOOK_COLUMNS " FROM job WHERE seq = ?1", integer(seq)), b, &found, e);
}

int *book_count_of(book *b, queue_state final)
{
    return final == QUEUE_SUCCEEDED   ? &b->succeeded
           : final == QUEUE_FAILED    ? &b->failed
           : final == QUEUE_TIMED_OUT ? &b->timed_out
                                      : &b->cancelled_tasks;
}

bool book_note(database *d, int64_t seq, queue_event_type type, queue_state state, queue_outcome outcome,
               int frame, int attempt, int64_t now, error *e)
{
    return RUN(d, e,
               "INSERT INTO event (at_ms, job, type, state, outcome, frame, attempt)"
               " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
               integer(now), integer(seq), text(queue_event_type_name(type)), text(queue_state_name(state)),
               text(queue_outcome_name(outcome)), integer_if(frame, frame != QUEUE_NO_FRAME),
               integer_if(attempt, attempt > 0));
}

queue_state book_state(const book *b)
{
    int waiting = b->ready + b->delayed;
    if (!waiting && !b->running) {
        if (b->cancelled && b->cancelled_tasks) return QUEUE_CANCELLED;
        return b->failed            ? QUEUE_FAILED
               : b->timed_out       ? QUEUE_TIMED_OUT
               : b->cancelled_tasks ? QUEUE_CANCELLED
                                    : QUEUE_SUCCEEDED;
    }
    if (b->cancelled) return QUEUE_CANCELLING;
    if (b->running) return QUEUE_RUNNING;
    if (b->pending) return QUEUE_BLOCKED;
    if (b->paused) return QUEUE_PAUSED;
    return waiting < b->tasks ? QUEUE_RUNNING : QUEUE_QUEUED;
}

/* The job's error is the first one of its tasks; of an array it says how many have failed. */
static bool store_error(database *d, const book *b, error *e)
{
    bool ok = false, read = false;
    char *code = NULL, *message = NULL;
    int ended = b->state == QUEUE_FAILED      ? b->failed
                : b->state == QUEUE_TIMED_OUT ? b->timed_out
                                              : b->cancelled_tasks;
    sqlite3_stmt *s = ASK(d, e,
                          "SELECT error_code, error_message, frame FROM task WHERE job = ?1 AND state = ?2"
                          " ORDER BY number LIMIT 1",
                          integer(b->seq), text(queue_state_name(b->state)));
    while (database_next(d, s, &ok, e)) {
        read = true;
        code = database_text(s, 0);
        message = database_text(s, 1);
        if (b->array && message) {
            char *whole = mem_printf("%d of %d frames %s; frame %d: %s", ended, b->tasks,
                                     queue_state_name(b->state), sqlite3_column_int(s, 2), message);
            free(message);
            message = whole;
        }
    }
    if (ok && read)
        ok = RUN(d, e, "UPDATE job SET error_code = ?2, error_message = ?3 WHERE seq = ?1", integer(b->seq),
                 text(code), text(message));
    free(code);
    free(message);
    return ok;
}

static bool store(database *d, const book *b, queue_outcome outcome, error *e)
{
    bool final = queue_state_is_final(b->state);
    int64_t expires = b->finished_ms + b->retention_s * 1000;
    return RUN(
        d, e,
        "UPDATE job SET revision = ?2, state = ?3, outcome = ?4, is_paused = ?5, is_cancelled = ?6,"
        " pending = ?7, ready = ?8, delayed = ?9, running = ?10, succeeded = ?11, failed = ?12,"
        " cancelled = ?13, timed_out = ?14, not_converged = ?15, attempts = ?16, started_ms = ?17,"
        " finished_ms = ?18, expires_ms = ?19, retention_s = ?20, error_code = NULL, error_message = NULL"
        " WHERE seq = ?1",
        integer(b->seq), integer(b->revision), text(queue_state_name(b->state)),
        text(queue_outcome_name(outcome)), integer(b->paused), integer(b->cancelled), integer(b->pending),
        integer(b->ready), integer(b->delayed), integer(b->running), integer(b->succeeded),
        integer(b->failed), integer(b->cancelled_tasks), integer(b->timed_out), integer(b->not_converged),
        integer(b->attempts), integer_if(b->started_ms, b->started_ms > 0), integer_if(b->finished_ms, final),
        integer_if(expires, final && b->retention_s > 0), integer(b->retention_s));
}

static bool count_for_owner(database *d, int64_t seq, int unfinished, int running, error *e)
{
    if (!unfinished && !running) return true;
    return RUN(d, e,
               "INSERT INTO owner (name, unfinished, running) SELECT owner, max(?2, 0), max(?3, 0) FROM job"
               " WHERE seq = ?1"
               " ON CONFLICT (name) DO UPDATE SET unfinished = unfinished + ?2, running = running + ?3",
               integer(seq), integer(unfinished), integer(running)) &&
           (unfinished >= 0 ||
            RUN(d, e,
                "DELETE FROM owner WHERE name = (SELECT owner FROM job WHERE seq = ?1) AND unfinished = 0",
                integer(seq)));
}

/* Stores one job. */
static bool save_one(database *d, const book *before, book *b, int64_t now, error *e)
{
    b->state = book_state(b);
    b->revision = before->revision + 1;
    bool was_final = queue_state_is_final(before->state), is_final = queue_state_is_final(b->state);
    queue_outcome outcome = b->state != QUEUE_SUCCEEDED ? QUEUE_NO_OUTCOME
                            : b->not_converged          ? QUEUE_NOT_CONVERGED
                                                        : QUEUE_CONVERGED;
    if (is_final && !was_final) b->finished_ms = now;
    if (b->running && !b->started_ms) b->started_ms = now;
    bool ok = store(d, b, outcome, e);
    if (is_final && b->state != QUEUE_SUCCEEDED) ok = ok && store_error(d, b, e);
    if (is_final && !was_final)
        ok = ok &&
             RUN(d, e,
                 "INSERT INTO outbox (job, webhook, state, outcome, due_ms)"
                 " SELECT seq, webhook, state, outcome, ?2 FROM job WHERE seq = ?1 AND webhook IS NOT NULL",
                 integer(b->seq), integer(now));
    if (b->state != before->state)
        ok = ok && book_note(d, b->seq, QUEUE_EVENT_STATE, b->state, outcome, QUEUE_NO_FRAME, 0, now, e);
    return ok && count_for_owner(d, b->seq, (int)was_final - (int)is_final, b->running - before->running, e);
}

bool book_enter(database *d, const book *b, int64_t now, error *e)
{
    return book_note(d, b->seq, QUEUE_EVENT_STATE, b->state, QUEUE_NO_OUTCOME, QUEUE_NO_FRAME, 0, now, e) &&
           count_for_owner(d, b->seq, 1, 0, e);
}

bool book_end_waiting(database *d, book *b, queue_state state, const char *code, const char *message,
                      int64_t now, error *e)
{
    if (!RUN(d, e,
             "UPDATE task SET state = ?2, error_code = ?3, error_message = ?4, finished_ms = ?5, "
             "not_before_ms = NULL"
             " WHERE job = ?1 AND state IN ('queued', 'delayed')",
             integer(b->seq), text(queue_state_name(state)), text(code), text(message), integer(now)))
        return false;
    *book_count_of(b, state) += b->ready + b->delayed;
    b->ready = b->delayed = 0;
    return true;
}

bool book_lose_need(database *d, book *b, const char *need, queue_state how, int64_t now, error *e)
{
    char message[128];
    snprintf(message, sizeof message, "the job %s, on which this one depends, is %s", need,
             queue_state_name(how));
    return book_end_waiting(d, b, QUEUE_FAILED, error_code_name(ERROR_DEPENDENCY_FAILED), message, now, e);
}

/* One job that waits for another hears of its end, which may be its own, too. */
static bool tell_dependent(database *d, const char *need, queue_state state, book *b, int64_t now, error *e)
{
    book before = *b;
    if (state == QUEUE_SUCCEEDED)
        b->pending--;
    else if (!book_lose_need(d, b, need, state, now, e))
        return false;
    return save_one(d, &before, b, now, e);
}

/* A job that waits for the one that has ended, if there is another; those with a lower number were told. */
static bool next_dependent(database *d, int64_t need, int64_t after, book *b, bool *found, error *e)
{
    return load(d,
                ASK(d, e,
                    "SELECT " BOOK_COLUMNS
                    " FROM job WHERE seq = (SELECT job FROM dependency JOIN job ON seq = job"
                    " WHERE needs = ?1 AND job > ?2 AND state = 'blocked' ORDER BY job LIMIT 1)",
                    integer(need), integer(after)),
                b, found, e);
}

static bool read_id(database *d, int64_t seq, char id[ULID_SIZE], error *e)
{
    bool ok = false;
    sqlite3_stmt *s = ASK(d, e, "SELECT id FROM job WHERE seq = ?1", integer(seq));
    while (database_next(d, s, &ok, e))
        snprintf(id, ULID_SIZE, "%s", (const char *)sqlite3_column_text(s, 0));
    return ok;
}

/* Those that fail of it end others in turn; however long the chain, one after the other. */
static bool tell_dependents(database *d, const book *ended, int64_t now, error *e)
{
    size_t count = 1, room = 16;
    struct {
        int64_t seq;
        queue_state state;
    } *line = mem_alloc(room * sizeof *line);
    line[0].seq = ended->seq;
    line[0].state = ended->state;
    bool ok = true;
    for (size_t i = 0; ok && i < count; i++) {
        char id[ULID_SIZE] = "";
        bool found = true;
        int64_t after = 0;
        ok = read_id(d, line[i].seq, id, e);
        while (ok && found) {
            book b;
            ok = next_dependent(d, line[i].seq, after, &b, &found, e);
            if (!ok || !found) break;
            after = b.seq;
            ok = tell_dependent(d, id, line[i].state, &b, now, e);
            if (!queue_state_is_final(b.state)) continue;
            if (count == room) line = mem_resize(line, (room *= 2) * sizeof *line);
            line[count].seq = b.seq;
            line[count++].state = b.state;
        }
    }
    free(line);
    return ok;
}

bool book_save(database *d, const book *before, book *b, int64_t now, error *e)
{
    return save_one(d, before, b, now, e) &&
           (!queue_state_is_final(b->state) || queue_state_is_final(before->state) ||
            tell_dependents(d, b, now, e));
}

#include "queue/queue.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include <sqlite3.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/memory.h"
#include "queue/schema.h"

/* At a start somebody may still look with the sqlite3 program. */
#define OPEN_PATIENCE_MS 5000

#define HEAD_COLUMNS                                                                               \
    "seq, id, name, labels, state, outcome, priority, created_ms, started_ms, finished_ms,"        \
    " attempt, spent, max_attempts, error_code, error_message"

enum statement {
    BEGIN,
    COMMIT,
    ROLLBACK,
    PUT,
    GET,
    LIST,
    LIST_STATE,
    COUNT,
    LIST_UNSETTLED,
    LIST_ATTEMPTS,
    CLAIM,
    ADD_ATTEMPT,
    FINISH,
    REQUEUE,
    END_ATTEMPT,
    CANCEL,
    STATEMENT_COUNT
};

static const char *const sql[STATEMENT_COUNT] = {
    [BEGIN] = "BEGIN IMMEDIATE",
    [COMMIT] = "COMMIT",
    [ROLLBACK] = "ROLLBACK",
    [PUT] = "INSERT INTO job (id, name, labels, priority, max_attempts, created_ms, spec)"
            " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
    [GET] = "SELECT " HEAD_COLUMNS ", spec FROM job WHERE id = ?1",
    [LIST] = "SELECT " HEAD_COLUMNS ", NULL FROM job WHERE seq < ?1 ORDER BY seq DESC LIMIT ?2",
    [LIST_STATE] = "SELECT " HEAD_COLUMNS ", NULL FROM job WHERE seq < ?1 AND state = ?3"
                   " ORDER BY seq DESC LIMIT ?2",
    [COUNT] = "SELECT state, count(*) FROM job GROUP BY state",
    [LIST_UNSETTLED] = "SELECT " HEAD_COLUMNS ", NULL FROM job"
                       " WHERE state IN ('running', 'cancelling') ORDER BY seq",
    [LIST_ATTEMPTS] = "SELECT number, a.started_ms, a.finished_ms, exit_status, signal,"
                      " peak_memory_bytes, reason FROM attempt a JOIN job ON job = seq"
                      " WHERE id = ?1 ORDER BY number",
    [CLAIM] = "UPDATE job SET state = 'running', attempt = attempt + 1, spent = spent + 1,"
              " started_ms = coalesce(started_ms, ?1) WHERE seq = (SELECT seq FROM job"
              " WHERE state = 'queued' ORDER BY priority DESC, seq LIMIT 1)"
              " RETURNING " HEAD_COLUMNS ", spec",
    [ADD_ATTEMPT] = "INSERT INTO attempt (job, number, started_ms) VALUES (?1, ?2, ?3)",
    [FINISH] = "UPDATE job SET state = ?3, outcome = ?4, error_code = ?5, error_message = ?6,"
               " finished_ms = ?7"
               " WHERE id = ?1 AND attempt = ?2 AND state IN ('running', 'cancelling')",
    [REQUEUE] = "UPDATE job SET state = 'queued', spent = spent - ?3"
                " WHERE id = ?1 AND attempt = ?2 AND state = 'running'",
    [END_ATTEMPT] = "UPDATE attempt SET finished_ms = ?3, exit_status = ?4, signal = ?5,"
                    " peak_memory_bytes = ?6, reason = ?7"
                    " WHERE job = (SELECT seq FROM job WHERE id = ?1) AND number = ?2",
    [CANCEL] =
        "UPDATE job SET state = CASE state WHEN 'queued' THEN 'cancelled' ELSE 'cancelling' END,"
        " finished_ms = CASE state WHEN 'queued' THEN ?2 END"
        " WHERE id = ?1 AND state IN ('queued', 'running')",
};

struct queue {
    pthread_mutex_t mutex;
    int lock; /* descriptor that holds the lock on the state directory */
    sqlite3 *database;
    sqlite3_stmt *statement[STATEMENT_COUNT];
    char *trouble; /* what kept the last change from being stored; NULL: nothing did */
};

static const char *const state_names[QUEUE_STATE_COUNT] = {
    [QUEUE_QUEUED] = "queued",       [QUEUE_RUNNING] = "running", [QUEUE_CANCELLING] = "cancelling",
    [QUEUE_SUCCEEDED] = "succeeded", [QUEUE_FAILED] = "failed",   [QUEUE_CANCELLED] = "cancelled",
    [QUEUE_TIMED_OUT] = "timed_out",
};

const char *queue_state_name(queue_state state)
{
    return state_names[state];
}

bool queue_state_from_name(const char *name, queue_state *state)
{
    for (int i = 0; i < QUEUE_STATE_COUNT; i++) {
        if (strcmp(state_names[i], name) == 0) {
            *state = (queue_state)i;
            return true;
        }
    }
    return false;
}

bool queue_state_is_final(queue_state state)
{
    return state != QUEUE_QUEUED && state != QUEUE_RUNNING && state != QUEUE_CANCELLING;
}

const char *queue_outcome_name(queue_outcome outcome)
{
    return outcome == QUEUE_CONVERGED       ? "converged"
           : outcome == QUEUE_NOT_CONVERGED ? "not_converged"
                                            : NULL;
}

void queue_job_clear(queue_job *job)
{
    free(job->name);
    free(job->labels);
    free(job->spec);
    free(job->error_code);
    free(job->error_message);
    *job = (queue_job){0};
}

void queue_jobs_free(queue_job *jobs, size_t count)
{
    for (size_t i = 0; i < count; i++) queue_job_clear(&jobs[i]);
    free(jobs);
}

void queue_attempts_free(queue_attempt *attempts, size_t count)
{
    for (size_t i = 0; i < count; i++) free(attempts[i].reason);
    free(attempts);
}

/* Says so when changes can no longer be stored, and when they can again; not at every try. */
static void note_stored(queue *q)
{
    if (!q->trouble) return;
    log_write(LOG_LEVEL_INFO, "the queue stores again");
    free(q->trouble);
    q->trouble = NULL;
}

static void note_trouble(queue *q)
{
    const char *why = sqlite3_errmsg(q->database);
    if (q->trouble && strcmp(q->trouble, why) == 0) return;
    log_write(LOG_LEVEL_ERROR, "the queue cannot store: %s", why);
    free(q->trouble);
    q->trouble = mem_strdup(why);
}

static bool fail(queue *q, error *e)
{
    return error_set(e, ERROR_INTERNAL, "the queue's database: %s", sqlite3_errmsg(q->database));
}

static bool take_lock(queue *q, const char *state_dir, error *e)
{
    char *path = mem_printf("%s/lock", state_dir);
    q->lock = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    bool ok = q->lock >= 0 && flock(q->lock, LOCK_EX | LOCK_NB) == 0;
    if (!ok && q->lock >= 0 && errno == EWOULDBLOCK) {
        char holder[16] = "";
        ssize_t got = pread(q->lock, holder, sizeof holder - 1, 0);
        holder[got > 0 ? got : 0] = '\0';
        error_set(e, ERROR_INTERNAL, "another hexad (process %s) uses the state directory %s",
                  holder, state_dir);
    } else if (!ok) {
        error_set(e, ERROR_INTERNAL, "%s cannot be locked: %s", path, strerror(errno));
    } else if (ftruncate(q->lock, 0) != 0 || dprintf(q->lock, "%d", (int)getpid()) < 0) {
        ok = error_set(e, ERROR_INTERNAL, "%s cannot be written: %s", path, strerror(errno));
    }
    free(path);
    return ok;
}

queue *queue_open(const char *state_dir, error *e)
{
    queue *q = mem_alloc(sizeof *q);
    pthread_mutex_init(&q->mutex, NULL);
    q->lock = -1;
    char *path = mem_printf("%s/queue.db", state_dir);
    bool ok = take_lock(q, state_dir, e);
    if (ok && sqlite3_open_v2(path, &q->database,
                              SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX,
                              NULL) != SQLITE_OK)
        ok = q->database ? fail(q, e)
                         : error_set(e, ERROR_INTERNAL, "the queue's database: no memory");
    if (ok) sqlite3_busy_timeout(q->database, OPEN_PATIENCE_MS);
    ok = ok && schema_prepare(q->database, e);
    /* nobody else gets in from here: a wait would be for nothing, and all threads' at once */
    if (ok) sqlite3_busy_timeout(q->database, 0);
    for (int i = 0; ok && i < STATEMENT_COUNT; i++)
        if (sqlite3_prepare_v3(q->database, sql[i], -1, SQLITE_PREPARE_PERSISTENT, &q->statement[i],
                               NULL) != SQLITE_OK)
            ok = fail(q, e);
    if (!ok) {
        error_prefix(e, "%s", path);
        queue_close(q);
        q = NULL;
    }
    free(path);
    return q;
}

void queue_close(queue *q)
{
    if (!q) return;
    for (int i = 0; i < STATEMENT_COUNT; i++) sqlite3_finalize(q->statement[i]);
    sqlite3_close(q->database);
    if (q->lock >= 0) close(q->lock);
    pthread_mutex_destroy(&q->mutex);
    free(q->trouble);
    free(q);
}

/* Binds a text that outlives the statement's run. */
static void bind_text(sqlite3_stmt *s, int index, const char *text)
{
    sqlite3_bind_text(s, index, text, -1, SQLITE_STATIC); /* NULL binds NULL */
}

static void bind_known(sqlite3_stmt *s, int index, int64_t value, bool known)
{
    if (known)
        sqlite3_bind_int64(s, index, value);
    else
        sqlite3_bind_null(s, index);
}

static void reset(sqlite3_stmt *s)
{
    sqlite3_reset(s);
    sqlite3_clear_bindings(s);
}

/* Runs a statement that gives no rows. */
static bool run(queue *q, enum statement which, error *e)
{
    sqlite3_stmt *s = q->statement[which];
    bool ok = sqlite3_step(s) == SQLITE_DONE || fail(q, e);
    if (!ok) note_trouble(q);
    reset(s);
    return ok;
}

/* Ends a transaction: commits when all went well; in any other case nothing has happened. */
static bool end(queue *q, bool ok, error *e)
{
    if (ok && run(q, COMMIT, e)) return true;
    if (!sqlite3_get_autocommit(q->database)) run(q, ROLLBACK, NULL);
    return false;
}

static char *column_text(sqlite3_stmt *s, int column)
{
    const char *text = (const char *)sqlite3_column_text(s, column);
    return text ? mem_strdup(text) : NULL;
}

static void read_job(sqlite3_stmt *s, queue_job *job)
{
    *job = (queue_job){.seq = sqlite3_column_int64(s, 0)};
    snprintf(job->id, sizeof job->id, "%s", (const char *)sqlite3_column_text(s, 1));
    job->name = column_text(s, 2);
    job->labels = column_text(s, 3);
    queue_state_from_name((const char *)sqlite3_column_text(s, 4), &job->state);
    const char *outcome = (const char *)sqlite3_column_text(s, 5);
    if (outcome)
        job->outcome = strcmp(outcome, "converged") == 0 ? QUEUE_CONVERGED : QUEUE_NOT_CONVERGED;
    job->priority = sqlite3_column_int(s, 6);
    job->created_ms = sqlite3_column_int64(s, 7);
    job->started_ms = sqlite3_column_int64(s, 8);
    job->finished_ms = sqlite3_column_int64(s, 9);
    job->attempt = sqlite3_column_int(s, 10);
    job->spent = sqlite3_column_int(s, 11);
    job->max_attempts = sqlite3_column_int(s, 12);
    job->error_code = column_text(s, 13);
    job->error_message = column_text(s, 14);
    job->spec = column_text(s, 15);
}

/* Runs a statement that gives at most one job. */
static bool read_one(queue *q, enum statement which, queue_job *job, bool *found, error *e)
{
    sqlite3_stmt *s = q->statement[which];
    int status = sqlite3_step(s);
    queue_job read = {0};
    bool got = status == SQLITE_ROW;
    if (got) {
        read_job(s, &read);
        status = sqlite3_step(s);
    }
    bool ok = status == SQLITE_DONE || fail(q, e);
    reset(s);
    if (!ok) {
        queue_job_clear(&read);
        return false;
    }
    if (got) *job = read;
    *found = got;
    return true;
}

/* Runs a statement that gives any number of jobs. */
static bool read_many(queue *q, enum statement which, queue_job **jobs, size_t *count, error *e)
{
    sqlite3_stmt *s = q->statement[which];
    queue_job *read = NULL;
    size_t used = 0, room = 0;
    int status;
    while ((status = sqlite3_step(s)) == SQLITE_ROW) {
        if (used == room) read = mem_resize(read, (room = room * 2 + 16) * sizeof *read);
        read_job(s, &read[used++]);
    }
    bool ok = status == SQLITE_DONE || fail(q, e);
    reset(s);
    if (!ok) {
        queue_jobs_free(read, used);
        return false;
    }
    *jobs = read;
    *count = used;
    return true;
}

bool queue_put(queue *q, const queue_submission *submission, char id[ULID_SIZE], error *e)
{
    char made[ULID_SIZE];
    pthread_mutex_lock(&q->mutex);
    int64_t now = clock_wall_ms();
    ulid_make(now, made);
    sqlite3_stmt *s = q->statement[PUT];
    bind_text(s, 1, made);
    bind_text(s, 2, submission->name);
    bind_text(s, 3, submission->labels);
    sqlite3_bind_int(s, 4, submission->priority);
    sqlite3_bind_int(s, 5, submission->max_attempts);
    sqlite3_bind_int64(s, 6, now);
    bind_text(s, 7, submission->spec);
    bool ok = run(q, PUT, e);
    if (ok) note_stored(q);
    pthread_mutex_unlock(&q->mutex);
    if (ok) memcpy(id, made, sizeof made);
    return ok;
}

bool queue_get(queue *q, const char *id, queue_job *job, bool *found, error *e)
{
    pthread_mutex_lock(&q->mutex);
    bind_text(q->statement[GET], 1, id);
    bool ok = read_one(q, GET, job, found, e);
    pthread_mutex_unlock(&q->mutex);
    return ok;
}

bool queue_list(queue *q, const queue_filter *filter, queue_job **jobs, size_t *count, error *e)
{
    pthread_mutex_lock(&q->mutex);
    enum statement which = filter->state < 0 ? LIST : LIST_STATE;
    sqlite3_stmt *s = q->statement[which];
    sqlite3_bind_int64(s, 1, filter->before_seq > 0 ? filter->before_seq : INT64_MAX);
    sqlite3_bind_int(s, 2, filter->limit);
    if (which == LIST_STATE) bind_text(s, 3, state_names[filter->state]);
    bool ok = read_many(q, which, jobs, count, e);
    pthread_mutex_unlock(&q->mutex);
    return ok;
}

bool queue_count(queue *q, int64_t count[QUEUE_STATE_COUNT], error *e)
{
    int64_t read[QUEUE_STATE_COUNT] = {0};
    pthread_mutex_lock(&q->mutex);
    sqlite3_stmt *s = q->statement[COUNT];
    int status;
    while ((status = sqlite3_step(s)) == SQLITE_ROW) {
        queue_state state = QUEUE_QUEUED;
        if (queue_state_from_name((const char *)sqlite3_column_text(s, 0), &state))
            read[state] = sqlite3_column_int64(s, 1);
    }
    bool ok = status == SQLITE_DONE || fail(q, e);
    reset(s);
    pthread_mutex_unlock(&q->mutex);
    if (ok) memcpy(count, read, sizeof read);
    return ok;
}

bool queue_list_unsettled(queue *q, queue_job **jobs, size_t *count, error *e)
{
    pthread_mutex_lock(&q->mutex);
    bool ok = read_many(q, LIST_UNSETTLED, jobs, count, e);
    pthread_mutex_unlock(&q->mutex);
    return ok;
}

static int column_known(sqlite3_stmt *s, int column)
{
    return sqlite3_column_type(s, column) == SQLITE_NULL ? -1 : sqlite3_column_int(s, column);
}

bool queue_list_attempts(queue *q, const char *id, queue_attempt **attempts, size_t *count,
                         error *e)
{
    pthread_mutex_lock(&q->mutex);
    sqlite3_stmt *s = q->statement[LIST_ATTEMPTS];
    bind_text(s, 1, id);
    queue_attempt *read = NULL;
    size_t used = 0;
    int status;
    while ((status = sqlite3_step(s)) == SQLITE_ROW) {
        read = mem_resize(read, (used + 1) * sizeof *read);
        read[used++] = (queue_attempt){
            .number = sqlite3_column_int(s, 0),
            .started_ms = sqlite3_column_int64(s, 1),
            .finished_ms = sqlite3_column_int64(s, 2),
            .exit_status = column_known(s, 3),
            .signal = column_known(s, 4),
            .peak_memory_bytes = sqlite3_column_int64(s, 5),
            .reason = column_text(s, 6),
        };
    }
    bool ok = status == SQLITE_DONE || fail(q, e);
    reset(s);
    pthread_mutex_unlock(&q->mutex);
    if (!ok) {
        queue_attempts_free(read, used);
        return false;
    }
    *attempts = read;
    *count = used;
    return true;
}

bool queue_claim(queue *q, queue_job *job, bool *found, error *e)
{
    queue_job claimed = {0};
    bool got = false;
    pthread_mutex_lock(&q->mutex);
    int64_t now = clock_wall_ms();
    bool ok = run(q, BEGIN, e);
    if (ok) {
        sqlite3_bind_int64(q->statement[CLAIM], 1, now);
        ok = read_one(q, CLAIM, &claimed, &got, e);
        if (ok && got) {
            sqlite3_stmt *s = q->statement[ADD_ATTEMPT];
            sqlite3_bind_int64(s, 1, claimed.seq);
            sqlite3_bind_int(s, 2, claimed.attempt);
            sqlite3_bind_int64(s, 3, now);
            ok = run(q, ADD_ATTEMPT, e);
        }
        ok = end(q, ok, e);
    }
    if (ok && got) note_stored(q);
    pthread_mutex_unlock(&q->mutex);
    if (!ok) {
        queue_job_clear(&claimed);
        return false;
    }
    if (got) *job = claimed;
    *found = got;
    return true;
}

/* Writes how the attempt ended; the caller holds the mutex inside a transaction. */
static bool end_attempt(queue *q, const char *id, int attempt, const queue_ending *ending,
                        int64_t now, error *e)
{
    sqlite3_stmt *s = q->statement[END_ATTEMPT];
    bind_text(s, 1, id);
    sqlite3_bind_int(s, 2, attempt);
    sqlite3_bind_int64(s, 3, now);
    bind_known(s, 4, ending->exit_status, ending->exit_status >= 0);
    bind_known(s, 5, ending->signal, ending->signal >= 0);
    bind_known(s, 6, ending->peak_memory_bytes, ending->peak_memory_bytes > 0);
    bind_text(s, 7, ending->reason);
    return run(q, END_ATTEMPT, e);
}

/* Runs FINISH or REQUEUE, whose own parameters are bound, and the attempt's record with it. */
static bool settle(queue *q, enum statement which, const char *id, int attempt,
                   const queue_ending *ending, int64_t now, bool *accepted, error *e)
{
    sqlite3_stmt *s = q->statement[which];
    bind_text(s, 1, id);
    sqlite3_bind_int(s, 2, attempt);
    bool ok = run(q, BEGIN, e);
    if (!ok) {
        reset(s);
        return false;
    }
    ok = run(q, which, e);
    bool changed = ok && sqlite3_changes(q->database) > 0;
    if (changed) ok = end_attempt(q, id, attempt, ending, now, e);
    ok = end(q, ok, e);
    if (ok && changed) note_stored(q);
    if (ok) *accepted = changed;
    return ok;
}

bool queue_finish(queue *q, const char *id, int attempt, const queue_ending *ending, bool *accepted,
                  error *e)
{
    pthread_mutex_lock(&q->mutex);
    int64_t now = clock_wall_ms();
    sqlite3_stmt *s = q->statement[FINISH];
    bind_text(s, 3, state_names[ending->state]);
    bind_text(s, 4, queue_outcome_name(ending->outcome));
    bind_text(s, 5, ending->error_code);
    bind_text(s, 6, ending->error_message);
    sqlite3_bind_int64(s, 7, now);
    bool ok = settle(q, FINISH, id, attempt, ending, now, accepted, e);
    pthread_mutex_unlock(&q->mutex);
    return ok;
}

bool queue_requeue(queue *q, const char *id, int attempt, bool counts, const queue_ending *ending,
                   bool *accepted, error *e)
{
    pthread_mutex_lock(&q->mutex);
    sqlite3_bind_int(q->statement[REQUEUE], 3, counts ? 0 : 1);
    bool ok = settle(q, REQUEUE, id, attempt, ending, clock_wall_ms(), accepted, e);
    pthread_mutex_unlock(&q->mutex);
    return ok;
}

bool queue_cancel(queue *q, const char *id, bool *found, bool *changed, queue_state *now, error *e)
{
    queue_job job = {0};
    bool there = false, did = false;
    pthread_mutex_lock(&q->mutex);
    sqlite3_stmt *s = q->statement[CANCEL];
    bind_text(s, 1, id);
    sqlite3_bind_int64(s, 2, clock_wall_ms());
    bool ok = run(q, CANCEL, e);
    if (ok) {
        did = sqlite3_changes(q->database) > 0;
        bind_text(q->statement[GET], 1, id);
        ok = read_one(q, GET, &job, &there, e);
    }
    pthread_mutex_unlock(&q->mutex);
    if (ok) {
        *found = there;
        *changed = did;
        if (there) *now = job.state;
    }
    queue_job_clear(&job);
    return ok;
}

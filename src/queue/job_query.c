/* Functions that read the queue. */
#include "queue/members.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/memory.h"
#include "database/schema.h"
#include "queue/job_row.h"

bool queue_get(queue *q, const char *id, queue_job *job, bool *found, error *e)
{
    queue_job read = {0};
    bool ok = false, got = false;
    database_lock(q->database);
    sqlite3_stmt *s = ASK(
        q->database, e,
        "SELECT " JOB_COLUMNS ", spec, paths FROM job JOIN spec ON spec.job = seq WHERE id = ?1", text(id));
    while (database_next(q->database, s, &ok, e)) {
        got = true;
        job_row_read(s, 0, &read);
        read.spec = database_text(s, JOB_COLUMN_COUNT);
        read.paths = database_text(s, JOB_COLUMN_COUNT + 1);
    }
    read.stamp = queue_stamp(q, read.seq);
    database_unlock(q->database);
    if (ok && got)
        *job = read;
    else
        queue_job_clear(&read);
    if (ok) *found = got;
    return ok;
}

/* What all listings ask for. */
#define CONDITIONS                                                                             \
    " (?3 IS NULL OR state = ?3) AND (?4 IS NULL OR owner = ?4) AND (?6 IS NULL OR name = ?6)" \
    " AND (?11 IS NULL OR instr(lower(name), lower(?11))) AND created_ms >= ?7 AND created_ms < ?8"
/* Of those by age. ?7, the beginning of the time, is made a bound of the place in the order, too, so that no older job is
 * read; both orders differ where the clock was set back. */
#define CHOSEN                                                    \
    "seq < ?1 AND" CONDITIONS " AND seq >= CASE ?7 WHEN 0 THEN 0" \
    " ELSE coalesce((SELECT min(seq) FROM job INDEXED BY job_by_time WHERE created_ms >= ?7), ?1) END"
#define LISTED "SELECT " JOB_COLUMNS " FROM job WHERE " CHOSEN
#define NEWEST " ORDER BY seq DESC LIMIT ?2"
#define LABELLED " AND (?5 IS NULL OR EXISTS (SELECT 1 FROM label WHERE label = ?5 AND label.job = seq))"

/* The other orders, falling and rising. Each has an index of its key and seq, of which both are known of the last job of the
 * page before, or an end of the index is taken: all blobs are behind all texts and numbers. */
#define FALLING(index, key)                                                                             \
    "SELECT " JOB_COLUMNS " FROM job INDEXED BY " index " WHERE " key " <= coalesce(?9, x'') AND (" key \
    ", seq) < (coalesce(?9, x''), ?10) AND" CONDITIONS LABELLED " ORDER BY " key " DESC, seq DESC LIMIT ?2"
#define RISING(index, key, low)                                                                             \
    "SELECT " JOB_COLUMNS " FROM job INDEXED BY " index " WHERE " key " >= coalesce(?9, " low ") AND (" key \
    ", seq) > (coalesce(?9, " low "), ?10) AND" CONDITIONS LABELLED " ORDER BY " key ", seq LIMIT ?2"
#define SORTED(index, key, low)                      \
    {                                                \
        FALLING(index, key), RISING(index, key, low) \
    }
static const char *const sorted[QUEUE_ORDER_COUNT][2] = {
    [QUEUE_BY_AGE] = {NULL, LISTED LABELLED " AND seq > ?10 ORDER BY seq LIMIT ?2"},
    [QUEUE_BY_NAME] = SORTED("job_by_name", SCHEMA_NAME_KEY, "''"),
    [QUEUE_BY_OWNER] = SORTED("job_by_owner", "owner", "''"),
    [QUEUE_BY_STATE] = SORTED("job_by_state", "state", "''"),
    [QUEUE_BY_PRIORITY] = SORTED("job_by_priority", "priority", "-9223372036854775808"),
};

/* The statement that reads the fewest rows: each has an index for one of the conditions. A label is in another table, so
 * that only its statement asks for it. */
static const char *choose_listing(const queue_filter *f)
{
    if (sorted[f->order][f->rising]) return sorted[f->order][f->rising];
    if (f->label)
        return "SELECT " JOB_COLUMNS " FROM label CROSS JOIN job ON seq = label.job WHERE label = ?5"
               " AND label.job < ?1 AND " CHOSEN " ORDER BY label.job DESC LIMIT ?2";
    if (f->name) return LISTED " AND " SCHEMA_NAME_KEY " = ?6" NEWEST;
    if (f->state >= 0 && !queue_state_is_final((queue_state)f->state)) return LISTED " AND state = ?3" NEWEST;
    if (f->owner) return LISTED " AND owner = ?4" NEWEST;
    return f->state >= 0 ? LISTED " AND state = ?3" NEWEST : LISTED NEWEST;
}

bool queue_list(queue *q, const queue_filter *filter, queue_job **jobs, size_t *count, error *e)
{
    queue_job *read = NULL;
    size_t used = 0, room = 0;
    bool ok = false;
    bool newest = filter->order == QUEUE_BY_AGE && !filter->rising;
    int64_t end = filter->rising ? 0 : INT64_MAX, after = filter->after_seq > 0 ? filter->after_seq : end;
    database_lock(q->database);
    sqlite3_stmt *s = ASK(
        q->database, e, choose_listing(filter), integer(newest ? after : INT64_MAX), integer(filter->limit),
        text(filter->state < 0 ? NULL : queue_state_name((queue_state)filter->state)), text(filter->owner),
        text(filter->label), text(filter->name), integer(filter->since_ms),
        integer(filter->until_ms > 0 ? filter->until_ms : INT64_MAX),
        text(filter->after_seq > 0 ? filter->after_key : NULL), integer(after), text(filter->text));
    while (database_next(q->database, s, &ok, e)) {
        if (used == room) read = mem_resize(read, (room = room * 2 + 16) * sizeof *read);
        job_row_read(s, 0, &read[used++]);
    }
    database_unlock(q->database);
    if (!ok) {
        queue_jobs_free(read, used);
        return false;
    }
    *jobs = read;
    *count = used;
    return true;
}

const char *queue_sort_key(const queue_job *job, queue_order order, char text[QUEUE_SORT_KEY_SIZE])
{
    switch (order) {
    case QUEUE_BY_NAME:
        return job->name ? job->name : "";
    case QUEUE_BY_OWNER:
        return job->owner;
    case QUEUE_BY_STATE:
        return queue_state_name(job->state);
    case QUEUE_BY_PRIORITY:
        snprintf(text, QUEUE_SORT_KEY_SIZE, "%d", job->priority);
        return text;
    default:
        return "";
    }
}

int queue_compare(const queue_job *a, const queue_job *b, const queue_filter *filter)
{
    char text[2][QUEUE_SORT_KEY_SIZE];
    int found = 0;
    if (filter->order == QUEUE_BY_PRIORITY)
        found = (a->priority > b->priority) - (a->priority < b->priority);
    else if (filter->order != QUEUE_BY_AGE)
        found = (filter->order == QUEUE_BY_NAME ? strcasecmp : strcmp)(
            queue_sort_key(a, filter->order, text[0]), queue_sort_key(b, filter->order, text[1]));
    if (!found) found = (a->seq > b->seq) - (a->seq < b->seq);
    return filter->rising ? found : -found;
}

bool queue_wants_input(queue *q, const char *name, bool *wanted, error *e)
{
    bool ok = false, read = false;
    database_lock(q->database);
    sqlite3_stmt *s =
        ASK(q->database, e,
            "SELECT EXISTS (SELECT 1 FROM input JOIN job ON seq = input.job WHERE input.name = ?1"
            " AND state NOT IN (" SCHEMA_FINAL_STATES "))",
            text(name));
    while (database_next(q->database, s, &ok, e)) read = sqlite3_column_int(s, 0);
    database_unlock(q->database);
    if (ok) *wanted = read;
    return ok;
}

bool queue_list_tasks(queue *q, const char *id, int after, int limit, queue_task **tasks, size_t *count,
                      error *e)
{
    queue_task *read = NULL;
    size_t used = 0, room = 0;
    bool ok = false;
    database_lock(q->database);
    sqlite3_stmt *s = ASK(q->database, e,
                          "SELECT " TASK_COLUMNS " FROM task WHERE job = (SELECT seq FROM job WHERE id = ?1)"
                          " AND number > ?2 ORDER BY number LIMIT ?3",
                          text(id), integer(after), integer(limit));
    while (database_next(q->database, s, &ok, e)) {
        if (used == room) read = mem_resize(read, (room = room * 2 + 16) * sizeof *read);
        job_row_read_task(s, 0, &read[used++]);
    }
    database_unlock(q->database);
    if (!ok) {
        queue_tasks_free(read, used);
        return false;
    }
    *tasks = read;
    *count = used;
    return true;
}

bool queue_get_frame(queue *q, const char *id, int frame, queue_task *task, bool *found, error *e)
{
    queue_task read = {0};
    bool ok = false, got = false;
    database_lock(q->database);
    sqlite3_stmt *s = ASK(q->database, e,
                          "SELECT " TASK_COLUMNS " FROM task WHERE job = (SELECT seq FROM job WHERE id = ?1)"
                          " AND frame = ?2",
                          text(id), integer(frame));
    while (database_next(q->database, s, &ok, e)) {
        got = true;
        job_row_read_task(s, 0, &read);
    }
    database_unlock(q->database);
    if (ok && got)
        *task = read;
    else
        queue_task_clear(&read);
    if (ok) *found = got;
    return ok;
}

static int column_or(sqlite3_stmt *s, int column, int otherwise)
{
    return sqlite3_column_type(s, column) == SQLITE_NULL ? otherwise : sqlite3_column_int(s, column);
}

bool queue_list_attempts(queue *q, const char *id, int after_task, int after, int limit,
                         queue_attempt **attempts, size_t *count, error *e)
{
    queue_attempt *read = NULL;
    size_t used = 0, room = 0;
    bool ok = false;
    database_lock(q->database);
    sqlite3_stmt *s =
        ASK(q->database, e,
            "SELECT a.task, t.frame, a.number, a.started_ms, a.finished_ms, exit_status, signal,"
            " peak_memory_bytes, host, reason, waited_ms, processor_ms FROM attempt a"
            " JOIN task t ON t.job = a.job AND t.number = a.task"
            " WHERE a.job = (SELECT seq FROM job WHERE id = ?1) AND (a.task, a.number) > (?2, ?3)"
            " ORDER BY a.task, a.number LIMIT ?4",
            text(id), integer(after_task), integer(after), integer(limit));
    while (database_next(q->database, s, &ok, e)) {
        if (used == room) read = mem_resize(read, (room = room * 2 + 4) * sizeof *read);
        read[used++] = (queue_attempt){
            .task = sqlite3_column_int(s, 0),
            .frame = column_or(s, 1, QUEUE_NO_FRAME),
            .number = sqlite3_column_int(s, 2),
            .started_ms = sqlite3_column_int64(s, 3),
            .finished_ms = sqlite3_column_int64(s, 4),
            .exit_status = column_or(s, 5, -1),
            .signal = column_or(s, 6, -1),
            .peak_memory_bytes = sqlite3_column_int64(s, 7),
            .host = database_text(s, 8),
            .reason = database_text(s, 9),
            .waited_ms = sqlite3_column_int64(s, 10),
            .processor_ms = sqlite3_column_int64(s, 11),
        };
    }
    database_unlock(q->database);
    if (!ok) {
        queue_attempts_free(read, used);
        return false;
    }
    *attempts = read;
    *count = used;
    return true;
}

/* Reads one time; INT64_MAX: there is none. */
static bool read_time(queue *q, const char *sql, int64_t *wall_ms, error *e)
{
    int64_t read = INT64_MAX;
    bool ok = false;
    database_lock(q->database);
    sqlite3_stmt *s = database_ask(q->database, sql, NULL, 0, e);
    while (database_next(q->database, s, &ok, e)) read = sqlite3_column_int64(s, 0);
    database_unlock(q->database);
    if (ok) *wall_ms = read;
    return ok;
}

bool queue_next_due(queue *q, int64_t *wall_ms, error *e)
{
    static const char sql[] =
        "SELECT not_before_ms FROM task WHERE state = 'delayed' ORDER BY not_before_ms LIMIT 1";
    return read_time(q, sql, wall_ms, e);
}

bool queue_next_expiry(queue *q, int64_t *wall_ms, error *e)
{
    static const char sql[] =
        "SELECT expires_ms FROM job WHERE expires_ms IS NOT NULL ORDER BY expires_ms LIMIT 1";
    return read_time(q, sql, wall_ms, e);
}

bool queue_list_expired(queue *q, int64_t wall_ms, int limit, char (**ids)[ULID_SIZE], size_t *count,
                        error *e)
{
    char(*read)[ULID_SIZE] = mem_alloc((size_t)limit * sizeof *read);
    size_t used = 0;
    bool ok = false;
    database_lock(q->database);
    sqlite3_stmt *s =
        ASK(q->database, e, "SELECT id FROM job WHERE expires_ms <= ?1 ORDER BY expires_ms LIMIT ?2",
            integer(wall_ms), integer(limit));
    while (database_next(q->database, s, &ok, e))
        snprintf(read[used++], ULID_SIZE, "%s", (const char *)sqlite3_column_text(s, 0));
    database_unlock(q->database);
    if (!ok) {
        free(read);
        return false;
    }
    *ids = read;
    *count = used;
    return true;
}

// SPDX-License-Identifier: Apache-2.0
/* job_query: reads jobs, lists and filters of the queue. */
#include "service/queue/members.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/core/memory.h"
#include "service/database/schema.h"
#include "service/queue/job_row.h"

bool queue_get(queue *q, const char *id, queue_job *job, bool *found, error *e)
{
    queue_job read = {0};
    bool ok = false, got = false;
    uint64_t commits = atomic_load(&q->commits);
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s =
        ASK(d, e,
            "SELECT " JOB_COLUMNS
            ", spec, paths FROM job JOIN spec ON spec.job = seq WHERE id = ?1 AND " SCHEMA_WHOLE,
            text(id));
    while (database_next(d, s, &ok, e)) {
        got = true;
        job_row_read(s, &read);
        read.spec = database_text(s, JOB_COLUMN_COUNT);
        read.paths = database_text(s, JOB_COLUMN_COUNT + 1);
    }
    database_end_read(d);
    read.stamp = queue_stamp(q, read.seq);
    if (atomic_load(&q->commits) != commits) read.stamp = QUEUE_NO_STAMP;
    if (ok && got)
        *job = read;
    else
        queue_job_clear(&read);
    if (ok) *found = got;
    return ok;
}

/* Conditions of all listings. */
#define CONDITIONS                                                                             \
    " (?3 IS NULL OR state = ?3) AND (?4 IS NULL OR owner = ?4) AND (?6 IS NULL OR name = ?6)" \
    " AND (?11 IS NULL OR instr(lower(name), lower(?11))) AND created_ms >= ?7 AND created_ms < ?8 AND " SCHEMA_WHOLE
#define LABELLED " AND (?5 IS NULL OR EXISTS (SELECT 1 FROM label WHERE label = ?5 AND label.job = seq))"
#define NEEDED "(SELECT seq FROM job WHERE id = ?14)"
#define NEEDING                                                                   \
    " AND (?14 IS NULL OR EXISTS (SELECT 1 FROM dependency WHERE needs = " NEEDED \
    " AND dependency.job = seq))"

/* The columns of a listing. The spec is read of jobs without a name, which the list calls by their input, if it
 * is short: a page of 500 jobs then parses a few megabytes. */
#define LISTED_SPEC_MOST "16384"
#define LISTED                                                                                      \
    JOB_COLUMNS ", (SELECT spec FROM spec WHERE spec.job = job.seq AND coalesce(job.name, '') = ''" \
                " AND length(spec) <= " LISTED_SPEC_MOST ")"

/* A walk of a listing, descending or ascending, between two places (both excluded): (?9, ?10) is the lower
 * and (?12, ?1) the upper. The statement `stop` finds the last place that a page visits, in the index
 * alone. */
typedef struct walk {
    const char *stop, *list;
} walk;

#define WALK(key, rows, more, order)                                                             \
    {                                                                                            \
        "SELECT " key ", seq FROM " rows " ORDER BY " order " LIMIT 1 OFFSET ?13",               \
            "SELECT " LISTED " FROM " rows " AND" CONDITIONS more " ORDER BY " order " LIMIT ?2" \
    }
#define BOTH_WAYS(key, rows, more, falling, rising)                   \
    {                                                                 \
        WALK(key, rows, more, falling), WALK(key, rows, more, rising) \
    }

/* By age, with a condition that an index answers. A listing uses the first one that applies. */
enum { BY_NEED, BY_LABEL, BY_NAME, BY_UNFINISHED_STATE, BY_OWNER, BY_STATE, ALL, CONDITION_COUNT };
#define BY_AGE(index, condition)                                                                            \
    BOTH_WAYS("NULL", "job " index " WHERE seq > ?10 AND seq < ?1" condition, LABELLED NEEDING, "seq DESC", \
              "seq")
#define LABELS " WHERE label = ?5 AND label.job > ?10 AND label.job < ?1"
#define LABEL_WALK(direction)                                                                  \
    {                                                                                          \
        "SELECT NULL, job FROM label" LABELS " ORDER BY job " direction " LIMIT 1 OFFSET ?13", \
            "SELECT " LISTED " FROM label CROSS JOIN job ON seq = label.job" LABELS            \
            " AND" CONDITIONS NEEDING " ORDER BY label.job " direction " LIMIT ?2"             \
    }
#define NEEDS " WHERE needs = " NEEDED " AND dependency.job > ?10 AND dependency.job < ?1"
#define NEED_WALK(direction)                                                                       \
    {                                                                                              \
        "SELECT NULL, job FROM dependency" NEEDS " ORDER BY job " direction " LIMIT 1 OFFSET ?13", \
            "SELECT " LISTED " FROM dependency CROSS JOIN job ON seq = dependency.job" NEEDS       \
            " AND" CONDITIONS LABELLED " ORDER BY dependency.job " direction " LIMIT ?2"           \
    }
static const walk age_walks[CONDITION_COUNT][2] = {
    [BY_NEED] = {NEED_WALK("DESC"), NEED_WALK("")},
    [BY_LABEL] = {LABEL_WALK("DESC"), LABEL_WALK("")},
    [BY_NAME] = BY_AGE("INDEXED BY job_by_name", " AND " SCHEMA_NAME_KEY " = ?6"),
    [BY_UNFINISHED_STATE] = BY_AGE("INDEXED BY job_by_state", " AND state = ?3"),
    [BY_OWNER] = BY_AGE("INDEXED BY job_by_owner", " AND owner = ?4"),
    [BY_STATE] = BY_AGE("INDEXED BY job_by_state", " AND state = ?3"),
    [ALL] = BY_AGE("NOT INDEXED", ""),
};

/* The other orders, each with an index of its key and seq. An unknown place is an end of the index: blobs
 * sort after all texts and numbers. */
#define LOW(low) "coalesce(?9, " low ")"
#define HIGH "coalesce(?12, x'')"
#define SORTED(index, key, low)                                                                   \
    BOTH_WAYS(key,                                                                                \
              "job INDEXED BY " index " WHERE " key                                               \
              " >= " LOW(low) " AND " key " <= " HIGH " AND (" key                                \
                              ", seq) > (" LOW(low) ", ?10) AND (" key ", seq) < (" HIGH ", ?1)", \
              LABELLED NEEDING, key " DESC, seq DESC", key ", seq")
static const walk key_walks[QUEUE_ORDER_COUNT][2] = {
    [QUEUE_BY_NAME] = SORTED("job_by_name", SCHEMA_NAME_KEY, "''"),
    [QUEUE_BY_OWNER] = SORTED("job_by_owner", "owner", "''"),
    [QUEUE_BY_STATE] = SORTED("job_by_state", "state", "''"),
    [QUEUE_BY_PRIORITY] = SORTED("job_by_priority", "priority", "-9223372036854775808"),
};

/* The walk with the fewest rows. */
static const walk *choose_walk(const queue_filter *f)
{
    if (f->order != QUEUE_BY_AGE) return &key_walks[f->order][f->rising];
    bool unfinished = f->state >= 0 && !queue_state_is_final((queue_state)f->state);
    return &age_walks[f->needs        ? BY_NEED
                      : f->label      ? BY_LABEL
                      : f->name       ? BY_NAME
                      : unfinished    ? BY_UNFINISHED_STATE
                      : f->owner      ? BY_OWNER
                      : f->state >= 0 ? BY_STATE
                                      : ALL][f->rising];
}

/* The lowest seq of a job created at this time or later; 0: unknown, because there are too many such jobs.
 * The orders by seq and by time differ where the clock was set back. */
static bool find_first(database *d, int64_t since_ms, int64_t *first, error *e)
{
    bool ok = false;
    *first = 0;
    if (since_ms <= 0) return true;
    sqlite3_stmt *s = ASK(d, e,
                          "SELECT coalesce(min(seq), 9223372036854775807), count(*) FROM"
                          " (SELECT seq FROM job INDEXED BY job_by_time WHERE created_ms >= ?1"
                          " ORDER BY created_ms LIMIT ?2)",
                          integer(since_ms), integer(QUEUE_VISITS));
    while (database_next(d, s, &ok, e))
        if (sqlite3_column_int(s, 1) < QUEUE_VISITS) *first = sqlite3_column_int64(s, 0);
    return ok;
}

/* Indices of the values of a walk's statements. */
enum { UPPER_SEQ = 0, LOWER_KEY = 8, LOWER_SEQ = 9, UPPER_KEY = 11, STOP_OFFSET = 12, VALUE_COUNT = 14 };
static void bind_filter(const queue_filter *f, int64_t first, value v[VALUE_COUNT])
{
    bool goes_on = f->after_seq > 0, by_age = f->order == QUEUE_BY_AGE;
    int64_t after = f->after_seq, least = first > 0 && by_age ? first - 1 : 0;
    const char *key = goes_on ? f->after_key : NULL;
    const value values[VALUE_COUNT] = {
        integer(goes_on && !f->rising ? after : INT64_MAX),
        integer(f->limit),
        text(f->state < 0 ? NULL : queue_state_name((queue_state)f->state)),
        text(f->owner),
        text(f->label),
        text(f->name),
        integer(f->since_ms),
        integer(f->until_ms > 0 ? f->until_ms : INT64_MAX),
        text(f->rising ? key : NULL),
        integer(goes_on && f->rising && after > least ? after : least),
        text(f->text),
        text(f->rising ? NULL : key),
        integer(0),
        text(f->needs),
    };
    memcpy(v, values, sizeof values);
}

/* Finds the place where a page of `visits` rows stops, and ends the walk there. *stop remains empty if there
 * are fewer rows. */
static bool find_stop(database *d, const walk *w, bool rising, int visits, value v[VALUE_COUNT],
                      queue_place *stop, error *e)
{
    bool ok = false;
    v[STOP_OFFSET] = integer(visits - 1);
    sqlite3_stmt *s = database_ask(d, w->stop, v, VALUE_COUNT, e);
    while (database_next(d, s, &ok, e))
        *stop = (queue_place){.seq = sqlite3_column_int64(s, 1), .key = database_text(s, 0)};
    if (!ok || !stop->seq) return ok;
    v[rising ? UPPER_KEY : LOWER_KEY] = text(stop->key);
    v[rising ? UPPER_SEQ : LOWER_SEQ] = integer(rising ? stop->seq + 1 : stop->seq - 1);
    return true;
}

void queue_page_clear(queue_page *page)
{
    queue_jobs_free(page->jobs, page->count);
    free(page->stop.key);
    *page = (queue_page){0};
}

/* Lists the jobs of one state, or of any. */
static bool list_walk(queue *q, const queue_filter *filter, int visits, queue_page *page, error *e)
{
    queue_page read = {0};
    size_t capacity = 0;
    bool ok = false;
    int64_t first = 0;
    value v[VALUE_COUNT];
    const walk *w = choose_walk(filter);
    database *d = database_begin_read(q->database);
    if (find_first(d, filter->since_ms, &first, e)) {
        bind_filter(filter, first, v);
        ok = visits <= 0 || find_stop(d, w, filter->rising, visits, v, &read.stop, e);
    }
    sqlite3_stmt *s = ok ? database_ask(d, w->list, v, VALUE_COUNT, e) : NULL;
    while (ok && database_next(d, s, &ok, e)) {
        if (read.count == capacity)
            read.jobs = mem_resize(read.jobs, (capacity = capacity * 2 + 16) * sizeof *read.jobs);
        job_row_read(s, &read.jobs[read.count]);
        read.jobs[read.count++].spec = database_text(s, JOB_COLUMN_COUNT);
    }
    database_end_read(d);
    if (ok)
        *page = read;
    else
        queue_page_clear(&read);
    return ok;
}

/* A job at this place of the list, for comparisons only; its texts are not owned. */
static queue_job job_at(const queue_place *place, queue_order order)
{
    queue_job job = {.seq = place->seq, .name = place->key, .owner = place->key};
    if (place->key && order == QUEUE_BY_STATE) queue_state_from_name(place->key, &job.state);
    if (place->key && order == QUEUE_BY_PRIORITY) job.priority = (int)strtol(place->key, NULL, 10);
    return job;
}

static int compare_jobs(const void *a, const void *b, void *filter)
{
    return queue_compare(a, b, filter);
}

/* Appends a part to a page. The page stops where the first of its parts stops. */
static void add_part(queue_page *page, queue_page *part, const queue_filter *filter)
{
    page->jobs = mem_resize(page->jobs, (page->count + part->count + 1) * sizeof *page->jobs);
    if (part->count) memcpy(page->jobs + page->count, part->jobs, part->count * sizeof *part->jobs);
    page->count += part->count;
    free(part->jobs);
    queue_job a = job_at(&part->stop, filter->order), b = job_at(&page->stop, filter->order);
    bool sooner = part->stop.seq && (!page->stop.seq || queue_compare(&a, &b, filter) < 0);
    char *unused = sooner ? page->stop.key : part->stop.key;
    if (sooner) page->stop = part->stop;
    free(unused);
}

/* Sorts the jobs of several parts, and removes those that belong to a later page. */
static void end_parts(queue_page *page, const queue_filter *filter)
{
    size_t kept = 0;
    queue_job stop = job_at(&page->stop, filter->order);
    qsort_r(page->jobs, page->count, sizeof *page->jobs, compare_jobs, (void *)(uintptr_t)filter);
    for (size_t i = 0; i < page->count; i++) {
        queue_job *job = &page->jobs[i];
        bool wanted = kept < (size_t)filter->limit &&
                      (!page->stop.seq || queue_compare(job, &stop, filter) <= 0) &&
                      /* its state has changed between two reads */
                      (!kept || page->jobs[kept - 1].seq != job->seq);
        if (wanted)
            page->jobs[kept++] = *job;
        else
            queue_job_clear(job);
    }
    page->count = kept;
}

bool queue_list_page(queue *q, const queue_filter *filter, int visits, queue_page *page, error *e)
{
    queue_page read = {0};
    int states = __builtin_popcount(filter->states);
    bool ok = true;
    if (!states) return list_walk(q, filter, visits, page, e);
    queue_filter one = *filter;
    for (int state = 0; ok && state < QUEUE_STATE_COUNT; state++) {
        queue_page part = {0};
        if (!(filter->states & 1u << state)) continue;
        one.state = state;
        ok = list_walk(q, &one, visits > states ? visits / states : visits > 0, &part, e);
        if (ok) add_part(&read, &part, filter);
    }
    if (ok) {
        end_parts(&read, filter);
        *page = read;
    } else {
        queue_page_clear(&read);
    }
    return ok;
}

bool queue_list(queue *q, const queue_filter *filter, queue_job **jobs, size_t *count, error *e)
{
    queue_page page = {0};
    if (!queue_list_page(q, filter, 0, &page, e)) return false;
    *jobs = page.jobs;
    *count = page.count;
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

bool queue_count_ahead(queue *q, const queue_job *job, int *count, error *e)
{
    int64_t found = 0;
    database *d = database_begin_read(q->database);
    bool ok = database_read_integer(
        d,
        ASK(d, e,
            "SELECT count(*) FROM (SELECT 1 FROM job INDEXED BY job_ready WHERE owner = ?1 AND " SCHEMA_CLAIMABLE
            " AND (priority > ?2 OR (priority = ?2 AND seq < ?3)) LIMIT ?4)",
            text(job->owner), integer(job->priority), integer(job->seq), integer(QUEUE_AHEAD_MOST)),
        &found, e);
    database_end_read(d);
    *count = (int)found;
    return ok;
}

bool queue_list_input_jobs(queue *q, const char *name, const char *owner, queue_input_jobs *jobs, error *e)
{
    bool ok = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s =
        ASK(d, e,
            "SELECT id, state NOT IN (" SCHEMA_FINAL_STATES ") FROM input JOIN job ON seq = input.job"
            " WHERE input.name = ?1 AND owner = ?2 AND " SCHEMA_WHOLE " ORDER BY input.job DESC",
            text(name), text(owner));
    *jobs = (queue_input_jobs){0};
    while (database_next(d, s, &ok, e)) {
        if (jobs->id_count < QUEUE_INPUT_IDS_MOST)
            snprintf(jobs->id[jobs->id_count++], ULID_SIZE, "%s", (const char *)sqlite3_column_text(s, 0));
        jobs->all++;
        jobs->unfinished += sqlite3_column_int(s, 1);
    }
    database_end_read(d);
    return ok;
}

bool queue_list_tasks(queue *q, const char *id, int after, int limit, queue_task **tasks, size_t *count,
                      error *e)
{
    queue_task *read = NULL;
    size_t used = 0, capacity = 0;
    bool ok = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = ASK(d, e,
                          "SELECT " TASK_COLUMNS " FROM task WHERE job = (SELECT seq FROM job WHERE id = ?1)"
                          " AND number > ?2 ORDER BY number LIMIT ?3",
                          text(id), integer(after), integer(limit));
    while (database_next(d, s, &ok, e)) {
        if (used == capacity) read = mem_resize(read, (capacity = capacity * 2 + 16) * sizeof *read);
        job_row_read_task(s, 0, &read[used++]);
    }
    database_end_read(d);
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
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = ASK(d, e,
                          "SELECT " TASK_COLUMNS " FROM task WHERE job = (SELECT seq FROM job WHERE id = ?1)"
                          " AND frame = ?2",
                          text(id), integer(frame));
    while (database_next(d, s, &ok, e)) {
        got = true;
        job_row_read_task(s, 0, &read);
    }
    database_end_read(d);
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
    size_t used = 0, capacity = 0;
    bool ok = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s =
        ASK(d, e,
            "SELECT a.task, t.frame, a.number, a.started_ms, a.finished_ms, exit_status, signal,"
            " peak_memory_bytes, host, reason, waited_ms, processor_ms FROM attempt a"
            " JOIN task t ON t.job = a.job AND t.number = a.task"
            " WHERE a.job = (SELECT seq FROM job WHERE id = ?1) AND (a.task, a.number) > (?2, ?3)"
            " ORDER BY a.task, a.number LIMIT ?4",
            text(id), integer(after_task), integer(after), integer(limit));
    while (database_next(d, s, &ok, e)) {
        if (used == capacity) read = mem_resize(read, (capacity = capacity * 2 + 4) * sizeof *read);
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
    database_end_read(d);
    if (!ok) {
        queue_attempts_free(read, used);
        return false;
    }
    *attempts = read;
    *count = used;
    return true;
}

/* Reads one time; INT64_MAX: none. */
static bool read_time(queue *q, const char *sql, int64_t *wall_ms, error *e)
{
    int64_t read = INT64_MAX;
    bool ok = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = database_ask(d, sql, NULL, 0, e);
    while (database_next(d, s, &ok, e)) read = sqlite3_column_int64(s, 0);
    database_end_read(d);
    if (ok) *wall_ms = read;
    return ok;
}

bool queue_next_due(queue *q, int64_t *wall_ms, error *e)
{
    static const char sql[] =
        "SELECT not_before_ms FROM task WHERE state = 'delayed' ORDER BY not_before_ms LIMIT 1";
    return read_time(q, sql, wall_ms, e);
}

bool queue_next_expiry(queue *q, int64_t after_ms, int64_t *wall_ms, error *e)
{
    bool ok = false;
    int64_t next = INT64_MAX;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s =
        ASK(d, e, "SELECT expires_ms FROM job WHERE expires_ms > ?1 ORDER BY expires_ms LIMIT 1",
            integer(after_ms));
    while (database_next(d, s, &ok, e)) next = sqlite3_column_int64(s, 0);
    database_end_read(d);
    if (ok) *wall_ms = next;
    return ok;
}

/* Appends expired jobs up to the limit. */
static bool list_expired(database *d, const running_bound *bound, int limit, char (*ids)[ULID_SIZE],
                         size_t *count, error *e)
{
    bool ok = false;
    sqlite3_stmt *s = ASK(d, e,
                          "SELECT id FROM job WHERE expires_ms <= ?1 AND finished_ms >= ?2"
                          " AND finished_ms < ?3 AND max(finished_ms, ?4) + 1000 * retention_s <= ?1"
                          " ORDER BY expires_ms LIMIT ?5",
                          integer(bound->over_ms), integer(bound->from_ms), integer(bound->until_ms),
                          integer(bound->counts_from_ms), integer(limit - (int)*count));
    while (database_next(d, s, &ok, e))
        snprintf(ids[(*count)++], ULID_SIZE, "%s", (const char *)sqlite3_column_text(s, 0));
    return ok;
}

bool queue_list_expired(queue *q, const running_bound *bounds, size_t bound_count, int limit,
                        char (**ids)[ULID_SIZE], size_t *count, error *e)
{
    char(*read)[ULID_SIZE] = mem_alloc((size_t)limit * sizeof *read);
    size_t used = 0;
    bool ok = true;
    database *d = database_begin_read(q->database);
    for (size_t i = 0; ok && i < bound_count && used < (size_t)limit; i++)
        ok = list_expired(d, &bounds[i], limit, read, &used, e);
    database_end_read(d);
    if (!ok) {
        free(read);
        return false;
    }
    *ids = read;
    *count = used;
    return true;
}

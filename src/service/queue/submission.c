// SPDX-License-Identifier: Apache-2.0
/* Submission of jobs. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/compare.h"
#include "base/core/memory.h"
#include "service/database/schema.h"
#include "service/queue/frame_needs.h"
#include "service/queue/job_row.h"
#include "service/queue/job_save.h"
#include "service/queue/members.h"
#include "service/queue/pieces.h"
#include "service/queue/relation.h"
#include "service/queue/usage.h"

/* A submission in progress. */
typedef struct submission_entry {
    LIST_ENTRY(submission_entry) link;
    const char *owner, *key; /* key NULL: none */
    int tasks;               /* admitted, and not yet counted by the database */
} submission_entry;

typedef struct submission_change {
    change change;
    const queue_submission *in;
    queue *q;
    const char *owner;
    submission_entry entry;
    job_state job;
    bool refused, published;
    size_t items, next;   /* number of jobs that it needs and of tasks; number of those that are inserted */
    int64_t dependencies; /* inserted ones */
    queue_receipt receipt;
} submission_change;

/* Looks up the idempotency key. If it was used before, sets the receipt. */
static bool find_replay(database *d, submission_change *s, bool *seen, error *e)
{
    bool ok = false;
    queue_receipt *r = &s->receipt;
    *seen = false;
    if (!s->in->key) return true;
    sqlite3_stmt *row =
        ASK(d, e, "SELECT id, state, revision, body_hash FROM job WHERE owner = ?1 AND key = ?2",
            text(s->owner), text(s->in->key));
    while (database_next(d, row, &ok, e)) {
        *seen = true;
        snprintf(r->id, sizeof r->id, "%s", (const char *)sqlite3_column_text(row, 0));
        queue_state_from_name((const char *)sqlite3_column_text(row, 1), &r->state);
        r->revision = sqlite3_column_int64(row, 2);
        bool same = strcmp((const char *)sqlite3_column_text(row, 3), s->in->body_hash) == 0;
        r->admission = same ? QUEUE_REPLAYED : QUEUE_MISMATCH;
    }
    return ok;
}

/* Whether a submission with the key is being stored. The caller holds the mutex `storing`. */
static bool find_entry(const queue *q, const char *owner, const char *key)
{
    const submission_entry *entry;
    LIST_FOREACH (entry, &q->entries, link)
        if (entry->key && strcmp(entry->key, key) == 0 && strcmp(entry->owner, owner) == 0) return true;
    return false;
}

static void note_tasks(submission_change *s, int tasks)
{
    pthread_mutex_lock(&s->q->storing);
    s->entry.tasks = tasks;
    pthread_mutex_unlock(&s->q->storing);
}

/* The numbers of jobs and tasks of other submissions of the owner that are being stored. */
static void count_entries(const submission_change *s, int64_t *jobs, int64_t *tasks)
{
    const submission_entry *other;
    *jobs = *tasks = 0;
    pthread_mutex_lock(&s->q->storing);
    LIST_FOREACH (other, &s->q->entries, link) {
        if (other == &s->entry || !other->tasks || strcmp(other->owner, s->owner) != 0) continue;
        ++*jobs;
        *tasks += other->tasks;
    }
    pthread_mutex_unlock(&s->q->storing);
}

static bool check_share(database *d, submission_change *s, bool *full, error *e)
{
    bool ok = false;
    int64_t jobs, tasks;
    *full = false;
    if (s->in->most_waiting <= 0 && s->in->most_tasks <= 0) return true;
    count_entries(s, &jobs, &tasks);
    sqlite3_stmt *row = ASK(d, e, "SELECT unfinished, tasks FROM owner WHERE name = ?1", text(s->owner));
    while (database_next(d, row, &ok, e)) {
        jobs += sqlite3_column_int64(row, 0);
        tasks += sqlite3_column_int64(row, 1);
    }
    const bool too_many = s->in->most_waiting > 0 && jobs >= s->in->most_waiting;
    *full = too_many || (s->in->most_tasks > 0 && tasks + s->job.tasks > s->in->most_tasks);
    if (*full) s->receipt.admission = too_many ? QUEUE_TOO_MANY : QUEUE_TOO_MANY_TASKS;
    return ok;
}

/* Whether the bounds permit more results. */
static bool check_results(database *d, submission_change *s, bool *full, error *e)
{
    usage_level level = USAGE_BELOW_BOUNDS;
    if (!usage_check(s->q, d, s->owner, &level, e)) return false;
    *full = level != USAGE_BELOW_BOUNDS;
    if (*full) s->receipt.admission = level == USAGE_FULL ? QUEUE_RESULTS_FULL : QUEUE_USER_RESULTS_FULL;
    return true;
}

/* A job for which the new job waits. */
typedef struct need {
    int64_t seq; /* 0: there is no such job */
    bool shown;  /* the new job may wait for its frames */
} need;

#define NEED_IS_SHOWN RELATION_IS_SHOWN("?2", "owner")

static bool look_at_need(database *d, const submission_change *s, const char *id, need *n, error *e)
{
    bool ok = false;
    sqlite3_stmt *row = ASK(d, e, "SELECT seq, " NEED_IS_SHOWN " FROM job WHERE id = ?1 AND " SCHEMA_WHOLE,
                            text(id), text(s->owner));
    *n = (need){0};
    while (database_next(d, row, &ok, e))
        *n = (need){.seq = sqlite3_column_int64(row, 0),
                    .shown = s->in->any_frames || sqlite3_column_int(row, 1)};
    return ok;
}

/* The event of another job that the new job waits for: its success, its end, or the success of the same
 * frames. */
typedef enum need_kind { NEEDS_SUCCESS, NEEDS_END, NEEDS_FRAMES } need_kind;

static size_t count_needs(const queue_submission *in)
{
    return in->depends_on_count + in->after_count + in->after_frames_count;
}

/* The job with this index for which the new one waits. */
static const char *need_at(const queue_submission *in, size_t index, need_kind *kind)
{
    *kind = NEEDS_SUCCESS;
    if (index < in->depends_on_count) return in->depends_on[index];
    index -= in->depends_on_count;
    *kind = NEEDS_END;
    if (index < in->after_count) return in->after[index];
    *kind = NEEDS_FRAMES;
    return in->after_frames[index - in->after_count];
}

/* Finds a frame of the new job that the job `id` lacks. *missing: QUEUE_NO_FRAME: the job `id` is not an
 * array. *all: it has all frames. */
static bool find_missing_frame(database *d, const queue_submission *in, const char *id, bool *all,
                               int *missing, error *e)
{
    bool ok = false;
    size_t next = 0, found = 0;
    int *frames = mem_alloc(in->frame_count * sizeof *frames);
    if (in->frame_count) memcpy(frames, in->frames, in->frame_count * sizeof *frames);
    qsort(frames, in->frame_count, sizeof *frames, compare_ints);
    sqlite3_stmt *s = ASK(d, e,
                          "SELECT frame FROM task WHERE job = (SELECT seq FROM job WHERE id = ?1)"
                          " AND frame IS NOT NULL ORDER BY frame",
                          text(id));
    while (database_next(d, s, &ok, e)) {
        int frame = sqlite3_column_int(s, 0);
        found++;
        if (next < in->frame_count && frames[next] == frame) next++;
    }
    *all = next == in->frame_count && found;
    *missing = found && !*all ? frames[next] : QUEUE_NO_FRAME;
    free(frames);
    return ok;
}

/* Refuses the dependency with this index. */
static bool refuse(submission_change *s, queue_admission why, size_t index, bool *refused)
{
    s->receipt.admission = why;
    s->receipt.dependency = index;
    *refused = true;
    return true;
}

/* Checks a job in after_frames. If it is refused, sets the receipt. The frames of another user's job are
 * not read. */
static bool check_frames(database *d, submission_change *s, size_t index, const need *n, bool again,
                         bool *refused, error *e)
{
    bool all = false;
    need_kind kind;
    if (!n->shown) return refuse(s, QUEUE_FOREIGN_DEPENDENCY, index, refused);
    if (again) return refuse(s, QUEUE_REPEATED_DEPENDENCY, index, refused);
    return find_missing_frame(d, s->in, need_at(s->in, index, &kind), &all, &s->receipt.frame, e) &&
           (all || refuse(s, QUEUE_UNKNOWN_FRAME, index, refused));
}

/* Checks that the jobs exist for which the new job waits. *refused: a dependency is not possible; the receipt has
 * its index. */
static bool check_needs(database *d, submission_change *s, bool *refused, error *e)
{
    *refused = false;
    for (size_t i = 0; !*refused && i < count_needs(s->in); i++) {
        need_kind kind, other;
        bool again = false;
        need n;
        const char *id = need_at(s->in, i, &kind);
        if (!look_at_need(d, s, id, &n, e)) return false;
        if (!n.seq) return refuse(s, QUEUE_UNKNOWN_DEPENDENCY, i, refused);
        if (kind != NEEDS_FRAMES) continue;
        for (size_t k = 0; k < i; k++) again |= strcmp(id, need_at(s->in, k, &other)) == 0;
        if (!check_frames(d, s, i, &n, again, refused, e)) return false;
    }
    return true;
}

/* Sets `refused`, and the receipt if it is true. */
static bool admit(database *d, submission_change *s, error *e)
{
    bool stop = false;
    s->refused = true;
    if (!find_replay(d, s, &stop, e)) return false;
    if (stop) return true;
    if (!check_share(d, s, &stop, e)) return false;
    if (stop) return true;
    if (!check_results(d, s, &stop, e)) return false;
    if (stop) return true;
    s->refused = !database_has_space(s->q->database);
    if (s->refused) s->receipt.admission = QUEUE_NO_SPACE;
    return true;
}

/* Inserts the job without tasks: no caller sees it. */
static bool insert_job(database *d, submission_change *s, int64_t now, error *e)
{
    const queue_submission *in = s->in;
    job_state *j = &s->job;
    bool ok = RUN(
        d, e,
        "INSERT INTO job (id, owner, state, priority, threads, memory_mb, max_attempts, retention_s,"
        " is_array, is_ordered, tasks, ready, created_ms, name, labels, trace, webhook, accept, max_running,"
        " chunk)"
        " VALUES (?1, ?2, 'paused', ?3, ?4, ?5, ?6, ?7, ?8, ?9, 0, 0, ?10, ?11, ?12, ?13, ?14, ?15, ?16, ?17)",
        text(s->receipt.id), text(s->owner), integer(in->priority), integer(in->threads),
        integer(in->memory_mb), integer(in->max_attempts), integer(in->retention_s), integer(j->array),
        integer(j->ordered), integer(now), text(in->name), text(in->labels), text(in->trace),
        text(in->webhook), integer(in->accept ? in->accept : QUEUE_ANY_OUTCOME), integer(in->max_running),
        integer(j->chunk));
    j->seq = database_last_row(d);
    ok = ok &&
         RUN(d, e,
             "INSERT INTO spec (job, spec, paths, timeout_ms, stall_ms, directory, cache_key)"
             " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
             integer(j->seq), text(in->spec), text(in->paths), integer(in->timeout_ms), integer(in->stall_ms),
             text(in->directory), text(in->cache_key)) &&
         (strcmp(in->labels, "[]") == 0 ||
          RUN(d, e, "INSERT INTO label (label, job) SELECT DISTINCT value, ?1 FROM json_each(?2)",
              integer(j->seq), text(in->labels)));
    for (size_t i = 0; ok && i < in->input_count; i++)
        ok = RUN(d, e, "INSERT OR IGNORE INTO input (name, job) VALUES (?1, ?2)", text(in->inputs[i]),
                 integer(j->seq));
    return ok;
}

static bool insert_dependency(database *d, submission_change *s, size_t index, error *e)
{
    need_kind kind;
    const char *id = need_at(s->in, index, &kind);
    bool ok = RUN(d, e,
                  "INSERT OR IGNORE INTO dependency (job, needs, any_end, by_frame)"
                  " SELECT ?1, seq, ?3, ?4 FROM job WHERE id = ?2 AND " SCHEMA_WHOLE,
                  integer(s->job.seq), text(id), integer(kind == NEEDS_END), integer(kind == NEEDS_FRAMES));
    s->dependencies += database_changes(d);
    if (!ok || database_changes(d)) return ok;
    need n; /* it is listed twice, or was deleted */
    return look_at_need(d, s, id, &n, e) &&
           (n.seq || refuse(s, QUEUE_UNKNOWN_DEPENDENCY, index, &s->refused));
}

/* Inserts a task, and the uploaded file that it reads. */
static bool insert_task(database *d, const submission_change *s, size_t i, error *e)
{
    const queue_submission *in = s->in;
    return RUN(d, e, "INSERT INTO task (job, number, frame, file, waits) VALUES (?1, ?2, ?3, ?4, ?5)",
               integer(s->job.seq), integer((int64_t)i),
               integer_if(in->frames ? in->frames[i] : 0, in->frames), text(in->files ? in->files[i] : NULL),
               integer((int64_t)in->after_frames_count)) &&
           (i >= in->file_input_count ||
            RUN(d, e, "INSERT OR IGNORE INTO input (name, job, of_task) VALUES (?1, ?2, 1)",
                text(in->file_inputs[i]), integer(s->job.seq)));
}

/* Inserts at most `most` dependencies and tasks. */
static bool insert_items(database *d, submission_change *s, size_t most, error *e)
{
    const size_t needs = count_needs(s->in);
    bool ok = true;
    for (; ok && !s->refused && s->next < s->items && most; s->next++, most--)
        ok = s->next < needs ? insert_dependency(d, s, s->next, e) : insert_task(d, s, s->next - needs, e);
    return ok;
}

/* Refuses the job if one that it needs was deleted after its dependency was inserted. */
static bool check_dependencies(database *d, submission_change *s, error *e)
{
    int64_t kept = 0;
    return !s->dependencies ||
           (database_read_integer(d,
                                  ASK(d, e,
                                      "SELECT count(*) FROM dependency JOIN job ON job.seq = needs"
                                      " WHERE dependency.job = ?1 AND job.tasks > 0",
                                      integer(s->job.seq)),
                                  &kept, e) &&
            (kept == s->dependencies || check_needs(d, s, &s->refused, e)));
}

/* Makes the job visible. */
static bool publish(database *d, submission_change *s, int64_t now, error *e)
{
    job_state *j = &s->job;
    int64_t lost = 0;
    if (!check_dependencies(d, s, e)) return false;
    if (s->refused) return true;
    if (!job_state_count_needs(d, j, &j->pending, &lost, e)) return false;
    j->state = job_state_derive(j);
    bool ok = RUN(d, e,
                  "UPDATE job SET state = ?2, pending = ?3, tasks = ?4, ready = ?4, held = ?5, key = ?6,"
                  " body_hash = ?7 WHERE seq = ?1",
                  integer(j->seq), text(queue_state_name(j->state)), integer(j->pending), integer(j->tasks),
                  integer(j->held), text(s->in->key), text(s->in->key ? s->in->body_hash : NULL)) &&
              job_state_begin(d, j, now, e);
    job_state before = *j;
    if (ok && lost) ok = pieces_fail_dependent(d, j, lost, now, e);
    if (ok && j->held) ok = pieces_examine(d, j, now, e);
    if (ok && (lost || s->in->after_frames_count)) ok = job_save(d, &before, j, now, e);
    s->receipt.admission = QUEUE_CREATED;
    s->receipt.state = j->state;
    s->receipt.seq = j->seq;
    s->receipt.revision = j->revision;
    s->published = ok;
    note_tasks(s, 0); /* the database counts them */
    return ok;
}

static bool begin(database *d, change *c)
{
    submission_change *s = (submission_change *)c;
    error *e = &c->fault;
    const int64_t now = clock_wall_ms();
    if (!admit(d, s, e)) return false;
    if (s->refused) return true;
    ulid_make(now, s->receipt.id);
    note_tasks(s, s->job.tasks);
    return insert_job(d, s, now, e) && insert_items(d, s, DATABASE_FEW_ROWS, e) &&
           (s->refused || s->next < s->items || publish(d, s, now, e));
}

static bool go_on(database *d, change *c)
{
    return insert_items(d, (submission_change *)c, DATABASE_PIECE_ROWS, &c->fault);
}

/* Bounds may have been reached meanwhile. */
static bool complete(database *d, change *c)
{
    submission_change *s = (submission_change *)c;
    return admit(d, s, &c->fault) && (s->refused || publish(d, s, clock_wall_ms(), &c->fault));
}

static bool abandon(database *d, change *c)
{
    return RUN(d, &c->fault, "UPDATE job SET state = 'cancelled' WHERE seq = ?1 AND tasks = 0",
               integer(((submission_change *)c)->job.seq));
}

static bool run(submission_change *s, bool (*apply)(database *d, change *c), const char *user, error *e)
{
    s->change.apply = apply;
    s->change.user = user;
    return database_change(s->q->database, &s->change, e);
}

/* Reads the jobs that the new job needs. This may take long, so that no change does it. */
static bool look_at_needs(submission_change *s, error *e)
{
    if (!count_needs(s->in)) return true;
    database *d = database_begin_read(s->q->database);
    bool ok = admit(d, s, e) && (s->refused || check_needs(d, s, &s->refused, e));
    database_end_read(d);
    return ok;
}

/* Stores the job. If that fails in part, the rest is deleted, by a later start at the latest. */
static bool store(submission_change *s, error *e)
{
    bool more = true;
    if (!look_at_needs(s, e)) return false;
    if (s->refused) return true;
    if (!run(s, begin, NULL, e)) return false;
    bool ok = true;
    while (ok && !s->refused && s->next < s->items) ok = run(s, go_on, s->owner, e);
    if (ok && !s->refused && !s->published) {
        ok = run(s, complete, NULL, e);
        s->published = s->published && ok;
    }
    if (!s->published && s->job.seq && run(s, abandon, NULL, NULL))
        while (more && queue_delete_hidden(s->q, &more, NULL)) continue;
    return ok;
}

/* Waits until no other submission has the same key. */
static void enter(submission_change *s)
{
    queue *q = s->q;
    pthread_mutex_lock(&q->storing);
    while (s->entry.key && find_entry(q, s->owner, s->entry.key)) pthread_cond_wait(&q->stored, &q->storing);
    LIST_INSERT_HEAD(&q->entries, &s->entry, link);
    pthread_mutex_unlock(&q->storing);
}

static void leave(submission_change *s)
{
    pthread_mutex_lock(&s->q->storing);
    LIST_REMOVE(&s->entry, link);
    pthread_cond_broadcast(&s->q->stored);
    pthread_mutex_unlock(&s->q->storing);
}

/* Reads the state after the changes of many tasks. */
static void await_pieces(queue *q, queue_receipt *receipt)
{
    bool found = false;
    job_state j;
    if (!queue_complete(q, receipt->id, &receipt->state, NULL)) return;
    database *d = database_begin_read(q->database);
    if (job_state_load(d, receipt->id, &j, &found, NULL) && found) {
        receipt->state = j.state;
        receipt->revision = j.revision;
    }
    database_end_read(d);
}

bool queue_put(queue *q, const queue_submission *in, queue_receipt *receipt, error *e)
{
    const char *owner = in->owner ? in->owner : "";
    const int tasks = in->frames ? (int)in->frame_count : 1;
    submission_change s = {.q = q,
                           .in = in,
                           .owner = owner,
                           .entry = {.owner = owner, .key = in->key},
                           .items = count_needs(in) + (size_t)tasks,
                           .job = {.revision = 1,
                                   .array = in->frames != NULL,
                                   .ordered = in->ordered,
                                   .chunk = in->chunk > 1 ? in->chunk : 1,
                                   .tasks = tasks,
                                   .ready = tasks,
                                   .held = in->after_frames_count ? tasks : 0,
                                   .ended = JOB_STATE_NONE_ENDED,
                                   .target = JOB_STATE_NO_TARGET,
                                   .examine_from = -1,
                                   .retention_s = in->retention_s}};
    enter(&s);
    bool ok = store(&s, e);
    leave(&s);
    if (!ok) return false;
    *receipt = s.receipt;
    if (s.job.target != JOB_STATE_NO_TARGET || s.job.examine_from >= 0) await_pieces(q, receipt);
    return true;
}
bool queue_has_key(queue *q, const char *owner, const char *key, bool *found, error *e)
{
    int64_t seq = 0;
    /* the entry first: when it is gone, the job is in the database */
    pthread_mutex_lock(&q->storing);
    const bool stores = find_entry(q, owner, key);
    pthread_mutex_unlock(&q->storing);
    database *d = database_begin_read(q->database);
    bool ok = database_read_integer(
        d, ASK(d, e, "SELECT seq FROM job WHERE owner = ?1 AND key = ?2", text(owner), text(key)), &seq, e);
    database_end_read(d);
    if (ok) *found = seq != 0 || stores;
    return ok;
}

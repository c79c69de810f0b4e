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
#include "service/queue/relation.h"
#include "service/queue/usage.h"

typedef struct submitting {
    change change;
    const queue_submission *in;
    queue *q;
    const char *owner;
    queue_receipt receipt;
} submitting;

/* Looks up the idempotency key. If it was used before, sets the receipt. */
static bool find_replay(database *d, submitting *s, bool *seen, error *e)
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

static bool check_share(database *d, submitting *s, bool *full, error *e)
{
    bool ok = false;
    *full = false;
    if (s->in->most_waiting <= 0) return true;
    sqlite3_stmt *row = ASK(d, e, "SELECT unfinished FROM owner WHERE name = ?1", text(s->owner));
    while (database_next(d, row, &ok, e)) *full = sqlite3_column_int64(row, 0) >= s->in->most_waiting;
    if (*full) s->receipt.admission = QUEUE_TOO_MANY;
    return ok;
}

/* Whether the bounds permit more results. */
static bool check_results(database *d, submitting *s, bool *full, error *e)
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
    bool ended, accepted;
} need;

#define NEED_IS_SHOWN RELATION_IS_SHOWN("?2", "owner")

static bool look_at_need(database *d, const submitting *s, const char *id, need *n, error *e)
{
    bool ok = false;
    sqlite3_stmt *row = ASK(d, e,
                            "SELECT seq, " NEED_IS_SHOWN ", state IN (" SCHEMA_FINAL_STATES
                            "), " SCHEMA_ACCEPTED " FROM job WHERE id = ?1",
                            text(id), text(s->owner));
    *n = (need){0};
    while (database_next(d, row, &ok, e))
        *n = (need){.seq = sqlite3_column_int64(row, 0),
                    .shown = s->in->any_frames || sqlite3_column_int(row, 1),
                    .ended = sqlite3_column_int(row, 2),
                    .accepted = sqlite3_column_int(row, 3)};
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
static bool refuse(submitting *s, queue_admission why, size_t index, bool *refused)
{
    s->receipt.admission = why;
    s->receipt.dependency = index;
    *refused = true;
    return true;
}

/* Checks a job in after_frames. If it is refused, sets the receipt. The frames of another user's job are
 * not read. */
static bool check_frames(database *d, submitting *s, size_t index, const need *n, bool again, bool *refused,
                         error *e)
{
    bool all = false;
    need_kind kind;
    if (!n->shown) return refuse(s, QUEUE_FOREIGN_DEPENDENCY, index, refused);
    if (again) return refuse(s, QUEUE_REPEATED_DEPENDENCY, index, refused);
    return find_missing_frame(d, s->in, need_at(s->in, index, &kind), &all, &s->receipt.frame, e) &&
           (all || refuse(s, QUEUE_UNKNOWN_FRAME, index, refused));
}

/* Counts the jobs for which the new job has to wait. *lost: the seq of an ended job with which the new job
 * cannot start; 0: there is none. *refused: a dependency is not possible; the receipt has its index. */
static bool check_needs(database *d, submitting *s, int *pending, int64_t *lost, bool *refused, error *e)
{
    *refused = false;
    *pending = 0;
    *lost = 0;
    for (size_t i = 0; !*refused && i < count_needs(s->in); i++) {
        need_kind kind, other;
        bool again = false;
        need n;
        const char *id = need_at(s->in, i, &kind);
        if (!look_at_need(d, s, id, &n, e)) return false;
        if (!n.seq) return refuse(s, QUEUE_UNKNOWN_DEPENDENCY, i, refused);
        for (size_t k = 0; k < i; k++) again |= strcmp(id, need_at(s->in, k, &other)) == 0;
        if (kind == NEEDS_FRAMES) {
            if (!check_frames(d, s, i, &n, again, refused, e)) return false;
            continue;
        }
        if (again || n.accepted || (kind == NEEDS_END && n.ended)) continue;
        ++*pending;
        if (n.ended) *lost = n.seq;
    }
    return true;
}

static bool insert_job(database *d, const submitting *s, job_state *j, int64_t now, error *e)
{
    const queue_submission *in = s->in;
    bool ok = RUN(
        d, e,
        "INSERT INTO job (id, owner, state, priority, threads, memory_mb, max_attempts, retention_s,"
        " is_array, is_ordered, pending, tasks, ready, created_ms, name, labels, trace, webhook, key,"
        " body_hash, accept, max_running, chunk)"
        " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?19, ?10, ?11, ?11, ?12, ?13, ?14, ?15, ?16, ?17,"
        " ?18, ?20, ?21, ?22)",
        text(s->receipt.id), text(s->owner), text(queue_state_name(j->state)), integer(in->priority),
        integer(in->threads), integer(in->memory_mb), integer(in->max_attempts), integer(in->retention_s),
        integer(j->array), integer(j->pending), integer(j->tasks), integer(now), text(in->name),
        text(in->labels), text(in->trace), text(in->webhook), text(in->key),
        text(in->key ? in->body_hash : NULL), integer(j->ordered),
        integer(in->accept ? in->accept : QUEUE_ANY_OUTCOME), integer(in->max_running), integer(j->chunk));
    j->seq = database_last_row(d);
    return ok &&
           RUN(d, e,
               "INSERT INTO spec (job, spec, paths, timeout_ms, stall_ms, directory, cache_key)"
               " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
               integer(j->seq), text(in->spec), text(in->paths), integer(in->timeout_ms),
               integer(in->stall_ms), text(in->directory), text(in->cache_key)) &&
           (strcmp(in->labels, "[]") == 0 ||
            RUN(d, e, "INSERT INTO label (label, job) SELECT DISTINCT value, ?1 FROM json_each(?2)",
                integer(j->seq), text(in->labels)));
}

static bool insert_tasks(database *d, const submitting *s, const job_state *j, error *e)
{
    bool ok = true;
    for (int i = 0; ok && i < j->tasks; i++)
        ok = RUN(d, e, "INSERT INTO task (job, number, frame, file) VALUES (?1, ?2, ?3, ?4)", integer(j->seq),
                 integer(i), integer_if(j->array ? s->in->frames[i] : 0, j->array),
                 text(s->in->files ? s->in->files[i] : NULL));
    for (size_t i = 0; ok && i < count_needs(s->in); i++) {
        need_kind kind;
        const char *id = need_at(s->in, i, &kind);
        ok = RUN(d, e,
                 "INSERT OR IGNORE INTO dependency (job, needs, any_end, by_frame)"
                 " SELECT ?1, seq, ?3, ?4 FROM job WHERE id = ?2",
                 integer(j->seq), text(id), integer(kind == NEEDS_END), integer(kind == NEEDS_FRAMES));
    }
    for (size_t i = 0; ok && i < s->in->input_count; i++)
        ok = RUN(d, e, "INSERT OR IGNORE INTO input (name, job) VALUES (?1, ?2)", text(s->in->inputs[i]),
                 integer(j->seq));
    for (size_t i = 0; ok && i < s->in->file_input_count; i++)
        ok = RUN(d, e, "INSERT OR IGNORE INTO input (name, job, of_task) VALUES (?1, ?2, 1)",
                 text(s->in->file_inputs[i]), integer(j->seq));
    return ok;
}

static bool put(database *d, change *c)
{
    submitting *s = (submitting *)c;
    error *e = &c->fault;
    bool stop = false;
    int pending = 0;
    int64_t lost = 0;
    if (!find_replay(d, s, &stop, e)) return false;
    if (stop) return true;
    if (!check_share(d, s, &stop, e)) return false;
    if (stop) return true;
    if (!check_results(d, s, &stop, e)) return false;
    if (stop) return true;
    if (!check_needs(d, s, &pending, &lost, &stop, e)) return false;
    if (stop) return true;
    if (!database_has_space(d)) {
        s->receipt.admission = QUEUE_NO_SPACE;
        return true;
    }
    int64_t now = clock_wall_ms();
    int tasks = s->in->frames ? (int)s->in->frame_count : 1;
    job_state j = {.revision = 1,
                   .array = s->in->frames != NULL,
                   .ordered = s->in->ordered,
                   .pending = pending,
                   .chunk = s->in->chunk > 1 ? s->in->chunk : 1,
                   .tasks = tasks,
                   .ready = tasks,
                   .ended = JOB_STATE_NONE_ENDED,
                   .retention_s = s->in->retention_s};
    j.state = job_state_derive(&j);
    ulid_make(now, s->receipt.id);
    bool ok = insert_job(d, s, &j, now, e) && insert_tasks(d, s, &j, e) && job_state_begin(d, &j, now, e);
    job_state before = j;
    if (ok && lost) ok = job_state_fail_dependent(d, &j, lost, now, e);
    if (ok && s->in->after_frames_count) ok = frame_needs_begin(d, &j, now, e);
    if (ok && (lost || s->in->after_frames_count)) ok = job_save(d, &before, &j, now, e);
    s->receipt.admission = QUEUE_CREATED;
    s->receipt.state = j.state;
    s->receipt.seq = j.seq;
    s->receipt.revision = j.revision;
    return ok;
}

bool queue_put(queue *q, const queue_submission *submission, queue_receipt *receipt, error *e)
{
    submitting s = {
        .change.apply = put, .q = q, .in = submission, .owner = submission->owner ? submission->owner : ""};
    if (!database_change(q->database, &s.change, e)) return false;
    *receipt = s.receipt;
    return true;
}

bool queue_has_key(queue *q, const char *owner, const char *key, bool *found, error *e)
{
    int64_t seq = 0;
    database *d = database_begin_read(q->database);
    bool ok = database_read_integer(
        d, ASK(d, e, "SELECT seq FROM job WHERE owner = ?1 AND key = ?2", text(owner), text(key)), &seq, e);
    database_end_read(d);
    if (ok) *found = seq != 0;
    return ok;
}

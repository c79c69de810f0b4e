// SPDX-License-Identifier: Apache-2.0
#include "service/queue/copy.h"

#include <stdio.h>
#include <stdlib.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "service/queue/job_save.h"
#include "service/queue/members.h"
#include "service/queue/usage.h"

typedef struct record_change {
    change change;
    const char *directory, *name; /* directory NULL: deletes the record */
    const char *output, *owner;
} record_change;

bool copy_forget(database *d, const char *name, error *e)
{
    return RUN(d, e, "DELETE FROM copy WHERE name = ?1", text(name));
}

static bool apply(database *d, change *asked)
{
    const record_change *n = (record_change *)asked;
    error *e = &asked->fault;
    if (!n->directory) return copy_forget(d, n->name, e);
    return RUN(d, e, "INSERT OR REPLACE INTO copy (name, directory) VALUES (?1, ?2)", text(n->name),
               text(n->directory)) &&
           RUN(d, e, "INSERT OR REPLACE INTO output (directory, owner) VALUES (?1, ?2)", text(n->output),
               text(n->owner));
}

bool queue_note_copy(queue *q, const char *directory, const char *name, const char *output, const char *owner,
                     error *e)
{
    record_change n = {
        .change.apply = apply, .directory = directory, .name = name, .output = output, .owner = owner};
    return database_change(q->database, &n.change, e);
}

bool queue_get_output_owner(queue *q, const char *output, char **owner, error *e)
{
    bool ok = false;
    char *read = NULL;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = ASK(d, e, "SELECT owner FROM output WHERE directory = ?1", text(output));
    while (database_next(d, s, &ok, e)) read = database_text(s, 0);
    database_end_read(d);
    if (ok)
        *owner = read;
    else
        free(read);
    return ok;
}

bool queue_forget_copy(queue *q, const char *name, error *e)
{
    record_change n = {.change.apply = apply, .name = name};
    return database_change(q->database, &n.change, e);
}

bool queue_list_copies(queue *q, queue_copy **copies, size_t *count, error *e)
{
    queue_copy *read = NULL;
    size_t used = 0, capacity = 0;
    bool ok = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = database_ask(d, "SELECT directory, name FROM copy ORDER BY name", NULL, 0, e);
    while (database_next(d, s, &ok, e)) {
        if (used == capacity) read = mem_resize(read, (capacity = capacity * 2 + 16) * sizeof *read);
        read[used++] = (queue_copy){database_text(s, 0), database_text(s, 1)};
    }
    database_end_read(d);
    if (!ok) {
        queue_copies_free(read, used);
        return false;
    }
    *copies = read;
    *count = used;
    return true;
}

void queue_copies_free(queue_copy *copies, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        free(copies[i].directory);
        free(copies[i].name);
    }
    free(copies);
}

/* ---- results to copy again */

void queue_uncopied_clear(queue_uncopied *job)
{
    free(job->owner);
    free(job->directory);
    free(job->tasks);
    *job = (queue_uncopied){0};
}

static bool read_tasks(database *d, int64_t seq, queue_uncopied *job, error *e)
{
    bool ok = false;
    sqlite3_stmt *s =
        ASK(d, e,
            "SELECT number, frame FROM task JOIN job ON job.seq = task.job WHERE task.job = ?1"
            " AND (task.copy_code IS NOT NULL OR number >= copy_from) AND task.state = 'succeeded'"
            " ORDER BY number",
            integer(seq));
    while (database_next(d, s, &ok, e)) {
        job->tasks = mem_resize(job->tasks, (job->count + 1) * sizeof *job->tasks);
        job->tasks[job->count++] = (queue_task){
            .number = sqlite3_column_int(s, 0),
            .frame = sqlite3_column_type(s, 1) == SQLITE_NULL ? QUEUE_NO_FRAME : sqlite3_column_int(s, 1)};
    }
    return ok;
}

bool queue_next_uncopied(queue *q, int64_t after, queue_uncopied *job, bool *found, error *e)
{
    queue_uncopied read = {0};
    bool ok = false, any = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = ASK(d, e,
                          "SELECT seq, id, owner, directory FROM job JOIN spec ON spec.job = seq"
                          " WHERE copy_state = 'pending' AND seq > ?1 ORDER BY seq LIMIT 1",
                          integer(after));
    while (database_next(d, s, &ok, e)) {
        any = true;
        read.seq = sqlite3_column_int64(s, 0);
        snprintf(read.id, sizeof read.id, "%s", (const char *)sqlite3_column_text(s, 1));
        read.owner = database_text(s, 2);
        read.directory = database_text(s, 3);
    }
    ok = ok && (!any || read_tasks(d, read.seq, &read, e));
    database_end_read(d);
    if (ok && any)
        *job = read;
    else
        queue_uncopied_clear(&read);
    if (ok) *found = any;
    return ok;
}

typedef struct copied_change {
    change change;
    const char *id, *name;
    const queue_task *task;
    const error *fault;
} copied_change;

static bool note_copied(database *d, change *asked)
{
    const copied_change *c = (copied_change *)asked;
    error *e = &asked->fault;
    int64_t seq = 0, now = clock_wall_ms();
    if (!copy_forget(d, c->name, e) ||
        !database_read_integer(d, ASK(d, e, "SELECT seq FROM job WHERE id = ?1", text(c->id)), &seq, e))
        return false;
    if (!seq) return true; /* the job has been deleted */
    if (!RUN(d, e, "UPDATE job SET copy_from = ?2 + 1 WHERE seq = ?1 AND copy_from <= ?2", integer(seq),
             integer(c->task->number)))
        return false;
    if (c->fault)
        return RUN(d, e, "UPDATE task SET copy_code = ?3, copy_message = ?4 WHERE job = ?1 AND number = ?2",
                   integer(seq), integer(c->task->number), text(error_code_name(c->fault->code)),
                   text(c->fault->message));
    return RUN(d, e, "UPDATE task SET copy_code = NULL, copy_message = NULL WHERE job = ?1 AND number = ?2",
               integer(seq), integer(c->task->number)) &&
           usage_note_delivery(d, c->id, c->task->frame, now, e);
}

bool queue_note_copied(queue *q, const char *id, const queue_task *task, const error *fault, const char *name,
                       error *e)
{
    copied_change c = {.change.apply = note_copied, .id = id, .name = name, .task = task, .fault = fault};
    return database_change(q->database, &c.change, e);
}

static bool end_copying(database *d, change *asked)
{
    const copied_change *c = (copied_change *)asked;
    error *e = &asked->fault;
    job_state j;
    bool found = false;
    if (!job_state_load(d, c->id, &j, &found, e) || !found) return asked->fault.code == ERROR_NONE;
    const job_state before = j;
    return RUN(d, e,
               "UPDATE job SET (copy_code, copy_message) = (SELECT copy_code, copy_message FROM task"
               " WHERE job = ?1 AND copy_code IS NOT NULL ORDER BY number LIMIT 1) WHERE seq = ?1",
               integer(j.seq)) &&
           RUN(d, e,
               "UPDATE job SET copy_state = iif(copy_code IS NULL, 'delivered', 'failed'), copy_from = NULL"
               " WHERE seq = ?1",
               integer(j.seq)) &&
           job_save(d, &before, &j, clock_wall_ms(), e) &&
           job_state_add_event(d, j.seq, QUEUE_EVENT_EDITED, j.state, QUEUE_NO_OUTCOME, QUEUE_NO_FRAME, 0,
                               clock_wall_ms(), e);
}

bool queue_end_copying(queue *q, const char *id, error *e)
{
    copied_change c = {.change.apply = end_copying, .id = id};
    return database_change(q->database, &c.change, e);
}

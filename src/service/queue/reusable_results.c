// SPDX-License-Identifier: Apache-2.0
/* Lookup of reusable results. */
#include <stdio.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "service/queue/members.h"

bool queue_recall(queue *q, const char *key, char id[ULID_SIZE], char **inputs, bool *found, error *e)
{
    char *read = NULL;
    bool ok = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s =
        ASK(d, e,
            "SELECT id, inputs FROM cache JOIN job ON seq = job WHERE cache.key = ?1 AND state = 'succeeded'",
            text(key));
    char maker[ULID_SIZE] = "";
    while (database_next(d, s, &ok, e)) {
        snprintf(maker, sizeof maker, "%s", (const char *)sqlite3_column_text(s, 0));
        read = database_text(s, 1);
    }
    database_end_read(d);
    if (!ok) {
        free(read);
        return false;
    }
    *found = read != NULL;
    if (read) {
        snprintf(id, ULID_SIZE, "%s", maker);
        *inputs = read;
    }
    return true;
}

void queue_reused_free(queue_reused *jobs, size_t count)
{
    for (size_t i = 0; i < count; i++) free(jobs[i].spec);
    free(jobs);
}

bool queue_list_reused(queue *q, int64_t after, int limit, queue_reused **jobs, size_t *count, error *e)
{
    queue_reused *read = mem_alloc((size_t)limit * sizeof *read);
    size_t used = 0;
    bool ok = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = ASK(d, e,
                          "SELECT seq, id, cached_from, spec FROM job JOIN spec ON spec.job = seq"
                          " WHERE seq > ?1 AND cached_from IS NOT NULL AND state = 'succeeded'"
                          " ORDER BY seq LIMIT ?2",
                          integer(after), integer(limit));
    while (database_next(d, s, &ok, e)) {
        queue_reused *r = &read[used++];
        r->seq = sqlite3_column_int64(s, 0);
        snprintf(r->id, sizeof r->id, "%s", (const char *)sqlite3_column_text(s, 1));
        snprintf(r->from, sizeof r->from, "%s", (const char *)sqlite3_column_text(s, 2));
        r->spec = database_text(s, 3);
    }
    database_end_read(d);
    if (!ok) {
        queue_reused_free(read, used);
        return false;
    }
    *jobs = read;
    *count = used;
    return true;
}

bool queue_has_linked_reports(queue *q, bool *has, error *e)
{
    int64_t linked = 0;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = database_ask(d, "SELECT linked_reports FROM service", NULL, 0, e);
    bool ok = database_read_integer(d, s, &linked, e);
    database_end_read(d);
    if (ok) *has = linked != 0;
    return ok;
}

static bool note_own_reports(database *d, change *asked)
{
    return database_run(d, "UPDATE service SET linked_reports = 0", NULL, 0, &asked->fault);
}

bool queue_note_own_reports(queue *q, error *e)
{
    change c = {.apply = note_own_reports};
    return database_change(q->database, &c, e);
}

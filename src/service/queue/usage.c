// SPDX-License-Identifier: Apache-2.0
#include "service/queue/usage.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "service/database/schema.h"

void queue_bound(queue *q, const queue_bounds *bounds)
{
    q->bounds = *bounds;
}

static bool is_met(const queue_sum *sum, const queue_sum *bound)
{
    return sum->bytes >= bound->bytes || sum->results >= bound->results;
}

static bool read_sum(database *d, sqlite3_stmt *s, queue_sum *sum, error *e)
{
    bool ok = false;
    *sum = (queue_sum){0};
    while (database_next(d, s, &ok, e))
        *sum = (queue_sum){sqlite3_column_int64(s, 0), sqlite3_column_int64(s, 1)};
    return ok;
}

static bool read_total(database *d, queue_sum *sum, error *e)
{
    static const char sql[] = "SELECT result_bytes, results FROM service";
    return read_sum(d, database_ask(d, sql, NULL, 0, e), sum, e);
}

bool usage_is_met(queue *q, database *d, bool *met, error *e)
{
    queue_sum sum;
    if (!read_total(d, &sum, e)) return false;
    *met = is_met(&sum, &q->bounds.all);
    return true;
}

#define LEAVING                                                     \
    " FROM job WHERE " SCHEMA_KEPT " AND (delivered_ms IS NULL) <=" \
    " ?1"
#define FIRST_LEAVING " ORDER BY (delivered_ms IS NULL), coalesce(delivered_ms, finished_ms) LIMIT 1"

/* Finds the job to delete first, of all users or (owner not NULL) of one; *seq 0: none may be deleted. */
static bool find_leaving(queue *q, database *d, const char *owner, int64_t *seq, error *e)
{
    value undelivered = integer(q->bounds.undelivered);
    sqlite3_stmt *s =
        owner ? ASK(d, e, "SELECT seq" LEAVING " AND owner = ?2" FIRST_LEAVING, undelivered, text(owner))
              : ASK(d, e, "SELECT seq" LEAVING FIRST_LEAVING, undelivered);
    return database_read_integer(d, s, seq, e);
}

bool usage_check(queue *q, database *d, const char *owner, usage_level *level, error *e)
{
    queue_sum sum;
    int64_t leaving = 1;
    bool met;
    if (!usage_is_met(q, d, &met, e) || (met && !find_leaving(q, d, NULL, &leaving, e))) return false;
    *level = leaving ? USAGE_BELOW_BOUNDS : USAGE_FULL;
    if (!leaving || !owner) return true;
    if (!read_sum(d, ASK(d, e, "SELECT bytes, results FROM usage WHERE owner = ?1", text(owner)), &sum, e))
        return false;
    if (is_met(&sum, &q->bounds.user) && !find_leaving(q, d, owner, &leaving, e)) return false;
    if (!leaving) *level = USAGE_USER_FULL;
    return true;
}

/* Finds the first job to delete of a user who has reached a bound. */
static bool find_leaving_of_users(queue *q, database *d, int64_t *seq, error *e)
{
    char **owner = NULL;
    size_t count = 0;
    bool ok = false;
    sqlite3_stmt *s = ASK(d, e, "SELECT owner FROM usage WHERE bytes >= ?1 OR results >= ?2",
                          integer(q->bounds.user.bytes), integer(q->bounds.user.results));
    while (database_next(d, s, &ok, e)) mem_add_text(&owner, &count, database_text(s, 0));
    for (size_t i = 0; ok && i < count && !*seq; i++) ok = find_leaving(q, d, owner[i], seq, e);
    mem_free_texts(owner, count);
    return ok;
}

static bool read_id(database *d, int64_t seq, char id[ULID_SIZE], error *e)
{
    bool ok = false;
    sqlite3_stmt *s = ASK(d, e, "SELECT id FROM job WHERE seq = ?1", integer(seq));
    while (database_next(d, s, &ok, e))
        snprintf(id, ULID_SIZE, "%s", (const char *)sqlite3_column_text(s, 0));
    return ok;
}

bool queue_next_leaving(queue *q, char id[ULID_SIZE], bool *found, error *e)
{
    int64_t seq = 0;
    bool met = false;
    database *d = database_begin_read(q->database);
    bool ok = usage_is_met(q, d, &met, e) && (!met || find_leaving(q, d, NULL, &seq, e)) &&
              (seq || find_leaving_of_users(q, d, &seq, e)) && (!seq || read_id(d, seq, id, e));
    database_end_read(d);
    if (ok) *found = seq != 0;
    return ok;
}

bool queue_get_usage(queue *q, queue_usage *usage, error *e)
{
    static const char sql[] =
        "SELECT owner, bytes, results FROM usage WHERE bytes > 0 OR results > 0 ORDER BY bytes DESC, owner";
    queue_usage read = {0};
    usage_level level = USAGE_BELOW_BOUNDS;
    size_t capacity = 0;
    bool ok = false;
    database *d = database_begin_read(q->database);
    read.bounds = q->bounds;
    sqlite3_stmt *s = database_ask(d, sql, NULL, 0, e);
    while (database_next(d, s, &ok, e)) {
        if (read.count == capacity)
            read.user = mem_resize(read.user, (capacity = capacity * 2 + 16) * sizeof *read.user);
        queue_user_sum *u = &read.user[read.count++];
        snprintf(u->name, sizeof u->name, "%s", (const char *)sqlite3_column_text(s, 0));
        u->sum = (queue_sum){sqlite3_column_int64(s, 1), sqlite3_column_int64(s, 2)};
    }
    ok = ok && read_total(d, &read.all, e) && usage_check(q, d, NULL, &level, e);
    read.full = level == USAGE_FULL;
    database_end_read(d);
    if (ok)
        *usage = read;
    else
        free(read.user);
    return ok;
}

/* ---- deliveries and measured space */

typedef struct usage_change {
    change change;
    const char *id;
    int frame;
    int64_t number; /* time of the delivery, or bytes */
} usage_change;

bool usage_note_delivery(database *d, const char *id, int frame, int64_t wall_ms, error *e)
{
    bool array = frame != QUEUE_NO_FRAME;
    if (!RUN(d, e,
             "UPDATE task SET is_delivered = 1 WHERE job = (SELECT seq FROM job WHERE id = ?1)"
             " AND frame IS ?2 AND state = 'succeeded' AND is_delivered = 0",
             text(id), integer_if(frame, array)))
        return false;
    return !database_changes(d) ||
           RUN(d, e,
               "UPDATE job SET delivered = delivered + 1, delivered_ms ="
               " iif(finished_ms IS NOT NULL AND delivered + 1 >= succeeded, ?2, NULL) WHERE id = ?1",
               text(id), integer(wall_ms));
}

static bool note_delivery(database *d, change *asked)
{
    const usage_change *n = (usage_change *)asked;
    return usage_note_delivery(d, n->id, n->frame, n->number, &asked->fault);
}

bool queue_note_delivery(queue *q, const char *id, int frame, int64_t wall_ms, error *e)
{
    usage_change n = {.change.apply = note_delivery, .id = id, .frame = frame, .number = wall_ms};
    return database_change(q->database, &n.change, e);
}

static bool note_bytes(database *d, change *asked)
{
    const usage_change *n = (usage_change *)asked;
    return RUN(d, &asked->fault, "UPDATE job SET result_bytes = ?2 WHERE id = ?1 AND result_bytes IS NULL",
               text(n->id), integer(n->number));
}

bool queue_note_bytes(queue *q, const char *id, int64_t bytes, error *e)
{
    usage_change n = {.change.apply = note_bytes, .id = id, .number = bytes};
    return database_change(q->database, &n.change, e);
}

bool queue_next_unmeasured(queue *q, char id[ULID_SIZE], bool *found, error *e)
{
    static const char sql[] = "SELECT id FROM job WHERE " SCHEMA_UNMEASURED " ORDER BY seq LIMIT 1";
    bool ok = false, any = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = database_ask(d, sql, NULL, 0, e);
    while (database_next(d, s, &ok, e)) {
        any = true;
        snprintf(id, ULID_SIZE, "%s", (const char *)sqlite3_column_text(s, 0));
    }
    database_end_read(d);
    if (ok) *found = any;
    return ok;
}

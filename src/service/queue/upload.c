// SPDX-License-Identifier: Apache-2.0
/* Which users hold uploaded files, and the names that they gave them. */
#include <stdio.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "service/database/schema.h"
#include "service/queue/members.h"

typedef struct upload_list {
    queue_upload *item;
    size_t count, capacity;
} upload_list;

/* Appends a row: hash, user, bytes, sent_ms. */
static void append(upload_list *l, sqlite3_stmt *s)
{
    if (l->count == l->capacity)
        l->item = mem_resize(l->item, (l->capacity = l->capacity * 2 + 16) * sizeof *l->item);
    queue_upload *u = &l->item[l->count++];
    const bool held = sqlite3_column_type(s, 3) != SQLITE_NULL;
    *u = (queue_upload){.bytes = sqlite3_column_int64(s, 2),
                        .sent_ms = held ? sqlite3_column_int64(s, 3) : QUEUE_NOT_HELD};
    snprintf(u->hash, sizeof u->hash, "%s", (const char *)sqlite3_column_text(s, 0));
    snprintf(u->user, sizeof u->user, "%s", (const char *)sqlite3_column_text(s, 1));
}

bool queue_find_upload(queue *q, const char *hash, const char *user, int64_t *sent_ms, char **name, error *e)
{
    bool ok = false;
    *sent_ms = QUEUE_NOT_HELD;
    *name = NULL;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s =
        ASK(d, e, "SELECT coalesce(sent_ms, ?3), name FROM upload WHERE hash = ?1 AND user = ?2", text(hash),
            text(user), integer(QUEUE_NOT_HELD));
    while (database_next(d, s, &ok, e)) {
        *sent_ms = sqlite3_column_int64(s, 0);
        *name = database_text(s, 1);
    }
    database_end_read(d);
    return ok;
}

bool queue_may_remove_upload(queue *q, const char *hash, bool is_over, bool *may, error *e)
{
    int64_t read = 0;
    database *d = database_begin_read(q->database);
    bool ok = database_read_integer(
        d,
        ASK(d, e,
            "SELECT (?2 OR EXISTS (SELECT 1 FROM upload WHERE hash = ?1 AND user = '') AND NOT EXISTS"
            " (SELECT 1 FROM upload WHERE hash = ?1 AND sent_ms IS NOT NULL)) AND NOT EXISTS (SELECT 1"
            " FROM input JOIN job ON seq = input.job WHERE input.name = 'sha256:' || ?1"
            " AND state NOT IN (" SCHEMA_FINAL_STATES "))",
            text(hash), integer(is_over)),
        &read, e);
    database_end_read(d);
    if (ok) *may = read;
    return ok;
}

bool queue_list_uploads(queue *q, const char *user, const queue_upload *after, int limit,
                        queue_upload **uploads, size_t *count, error *e)
{
    static const char of_user[] =
        "SELECT hash, user, bytes, sent_ms FROM upload WHERE user = ?1 AND sent_ms <= ?2"
        " AND (sent_ms < ?2 OR hash > ?3) ORDER BY sent_ms DESC, hash LIMIT ?4";
    static const char all[] = "SELECT hash, user, bytes, sent_ms FROM upload WHERE (hash, user) > (?1, ?2)"
                              " ORDER BY hash, user LIMIT ?3";
    upload_list l = {0};
    bool ok = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s =
        user ? ASK(d, e, of_user, text(user), integer(after->sent_ms), text(after->hash), integer(limit))
             : ASK(d, e, all, text(after->hash), text(after->user), integer(limit));
    while (database_next(d, s, &ok, e)) append(&l, s);
    database_end_read(d);
    *uploads = l.item;
    *count = l.count;
    return ok;
}

/* ---- changes */

typedef struct holding {
    change change;
    const queue_upload *uploads;
    size_t count, added;
} holding;

static bool hold(database *d, change *asked)
{
    holding *x = (holding *)asked;
    error *e = &asked->fault;
    bool ok = true;
    for (size_t i = 0; ok && i < x->count; i++) {
        const queue_upload *u = &x->uploads[i];
        const bool holds = u->sent_ms != QUEUE_NOT_HELD;
        int64_t held = 0; /* 1: by another name; 2: by this one, so that nothing changes */
        ok = database_read_integer(d,
                                   ASK(d, e,
                                       "SELECT 1 + (?3 IS NULL OR name IS ?3) FROM upload"
                                       " WHERE hash = ?1 AND user = ?2 AND sent_ms IS NOT NULL",
                                       text(u->hash), text(u->user), text(u->name)),
                                   &held, e);
        if (!ok || held == 2) continue;
        ok =
            RUN(d, e, "INSERT OR IGNORE INTO upload (hash, user, bytes) VALUES (?1, '', 0)", text(u->hash)) &&
            RUN(d, e,
                "INSERT INTO upload (hash, user, bytes, sent_ms, name) VALUES (?1, ?2, ?3, ?4, ?5)"
                " ON CONFLICT DO UPDATE SET bytes = iif(sent_ms IS NULL, excluded.bytes, bytes),"
                " sent_ms = coalesce(sent_ms, excluded.sent_ms), name = coalesce(excluded.name, name)",
                text(u->hash), text(u->user), integer(u->bytes), integer_if(u->sent_ms, holds),
                text(u->name));
        x->added += holds && !held;
    }
    return ok;
}

bool queue_hold_uploads(queue *q, const queue_upload *uploads, size_t count, size_t *added, error *e)
{
    holding x = {.change = {.apply = hold, .user = count > 1 ? "" : NULL, .wakes_none = true},
                 .uploads = uploads,
                 .count = count};
    bool ok = database_change(q->database, &x.change, e);
    if (ok) *added = x.added;
    return ok;
}

typedef struct forgetting {
    change change;
    const char *sql;
    const queue_upload *uploads;
    size_t count, done;
    upload_list ended;
} forgetting;

/* Changes at most DATABASE_PIECE_ROWS rows. */
static bool forget(database *d, change *asked)
{
    forgetting *x = (forgetting *)asked;
    bool ok = true;
    for (int rows = 0; ok && rows < DATABASE_PIECE_ROWS && x->done < x->count;) {
        const queue_upload *u = &x->uploads[x->done];
        const int before = rows, most = DATABASE_PIECE_ROWS - rows;
        sqlite3_stmt *s = ASK(d, &asked->fault, x->sql, text(u->hash), integer(most), text(u->user));
        for (; database_next(d, s, &ok, &asked->fault); rows++)
            if (sqlite3_column_type(s, 3) != SQLITE_NULL) append(&x->ended, s);
        x->done += rows - before < most;
    }
    return ok;
}

bool queue_forget_uploads(queue *q, queue_forgetting what, const queue_upload *uploads, size_t count,
                          queue_upload **ended, size_t *ended_count, error *e)
{
    static const char *const statements[] = {
        [QUEUE_FORGET_FILE] = "DELETE FROM upload WHERE hash = ?1 AND user IN"
                              " (SELECT user FROM upload WHERE hash = ?1 LIMIT ?2)"
                              " RETURNING hash, user, bytes, sent_ms",
        [QUEUE_FORGET_HOLDS] = "UPDATE upload SET sent_ms = NULL WHERE hash = ?1 AND user IN"
                               " (SELECT user FROM upload WHERE hash = ?1 AND sent_ms IS NOT NULL LIMIT ?2)"
                               " RETURNING hash, user, bytes, 0",
        [QUEUE_FORGET_USER] = "DELETE FROM upload WHERE hash = ?1 AND user = ?3"
                              " RETURNING hash, user, bytes, sent_ms",
    };
    forgetting x = {.change = {.apply = forget, .user = "", .wakes_none = true},
                    .sql = statements[what],
                    .uploads = uploads,
                    .count = count};
    bool ok = true;
    while (ok && x.done < count) {
        const size_t before = x.ended.count;
        ok = database_change(q->database, &x.change, e);
        if (!ok) x.ended.count = before;
    }
    *ended = x.ended.item;
    *ended_count = x.ended.count;
    return ok;
}

// SPDX-License-Identifier: Apache-2.0
/* Completion of changes of many rows (service/queue/pieces), a transaction for each piece. */
#include <stdio.h>

#include "base/core/clock.h"
#include "service/database/schema.h"
#include "service/queue/job_save.h"
#include "service/queue/members.h"
#include "service/queue/pieces.h"

typedef struct completion_change {
    change change;
    int64_t seq; /* of the job; 0: the next row of the table ended */
    bool any;    /* there are pieces */
} completion_change;

static bool complete_some(database *d, change *asked)
{
    completion_change *w = (completion_change *)asked;
    error *e = &asked->fault;
    const int64_t now = clock_wall_ms();
    job_state j = {0};
    if (!w->seq) return job_save_dependents(d, 0, now, e);
    if (!job_state_load_seq(d, w->seq, &j, e)) return false;
    if (j.seq != w->seq || (j.target == JOB_STATE_NO_TARGET && j.examine_from < 0)) return true;
    const job_state before = j;
    return pieces_next(d, &j, now, e) && job_save(d, &before, &j, now, e);
}

/* Reads the owner of the job, whether it has pieces, and its state. */
static bool look(queue *q, const char *id, completion_change *w, char owner[QUEUE_OWNER_SIZE],
                 queue_state *now, error *e)
{
    bool ok = false;
    w->any = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s =
        ASK(d, e, "SELECT seq, owner, " SCHEMA_HAS_PIECES ", state FROM job WHERE id = ?1 AND " SCHEMA_WHOLE,
            text(id));
    while (database_next(d, s, &ok, e)) {
        w->seq = sqlite3_column_int64(s, 0);
        snprintf(owner, QUEUE_OWNER_SIZE, "%s", (const char *)sqlite3_column_text(s, 1));
        w->any = sqlite3_column_int(s, 2);
        queue_state_from_name((const char *)sqlite3_column_text(s, 3), now);
    }
    database_end_read(d);
    return ok;
}

bool queue_complete(queue *q, const char *id, queue_state *now, error *e)
{
    char owner[QUEUE_OWNER_SIZE] = "";
    completion_change w = {.change = {.apply = complete_some, .user = owner}};
    bool ok = look(q, id, &w, owner, now, e);
    while (ok && w.any) ok = database_change(q->database, &w.change, e) && look(q, id, &w, owner, now, e);
    return ok;
}

/* Finds a job with pieces, of the next owner in alphabetical order, and whether the table ended has rows. */
static bool find_next(queue *q, int64_t *seq, bool *ended, error *e)
{
    int64_t rows = 0;
    database *d = database_begin_read(q->database);
    bool ok = database_read_integer(d, database_ask(d, "SELECT EXISTS (SELECT 1 FROM ended)", NULL, 0, e),
                                    &rows, e);
    *ended = rows != 0;
    for (int round = 0; ok && !*seq && round < 2; round++) {
        sqlite3_stmt *s = ASK(d, e,
                              "SELECT seq, owner FROM job INDEXED BY job_pieces WHERE " SCHEMA_HAS_PIECES
                              " AND (?2 OR owner > ?1) ORDER BY owner, seq LIMIT 1",
                              text(q->owner_of_piece), integer(round));
        while (database_next(d, s, &ok, e)) {
            *seq = sqlite3_column_int64(s, 0);
            snprintf(q->owner_of_piece, QUEUE_OWNER_SIZE, "%s", (const char *)sqlite3_column_text(s, 1));
        }
    }
    database_end_read(d);
    return ok;
}

bool queue_do_piece(queue *q, bool *more, error *e)
{
    completion_change ended = {.change = {.apply = complete_some, .user = ""}},
                      piece = {.change = {.apply = complete_some, .user = q->owner_of_piece}};
    if (!find_next(q, &piece.seq, &ended.any, e) ||
        (ended.any && !database_change(q->database, &ended.change, e)) ||
        (piece.seq && !database_change(q->database, &piece.change, e)))
        return false;
    *more = ended.any || piece.seq;
    return true;
}

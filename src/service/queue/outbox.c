// SPDX-License-Identifier: Apache-2.0
/* Pending notifications of ended jobs. */
#include <stdio.h>
#include <stdlib.h>

#include "base/core/clock.h"
#include "service/database/schema.h"
#include "service/queue/members.h"
#include "service/queue/job_row.h"

void queue_delivery_clear(queue_delivery *delivery)
{
    free(delivery->url);
    free(delivery->name);
    free(delivery->labels);
    free(delivery->trace);
    free(delivery->copy_state);
    free(delivery->copy_code);
    free(delivery->copy_message);
    *delivery = (queue_delivery){0};
}

bool queue_next_delivery(queue *q, const char *but, queue_delivery *delivery, bool *found, error *e)
{
    queue_delivery read = {0};
    bool ok = false, any = false;
    static const char sql[] =
        "SELECT number, id, outbox.webhook, outbox.state, outbox.outcome, tries, due_ms, event, ended_ms,"
        " name, labels, trace, copy_state, copy_code, copy_message FROM outbox"
        " JOIN job ON seq = job AND " SCHEMA_WHOLE " WHERE NOT EXISTS (SELECT 1 FROM json_each(?1)"
        " WHERE substr(outbox.webhook, 1, length(value)) = value) ORDER BY due_ms, number LIMIT 1";
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = ASK(d, e, sql, text(but));
    while (database_next(d, s, &ok, e)) {
        any = true;
        read.number = sqlite3_column_int64(s, 0);
        snprintf(read.id, sizeof read.id, "%s", (const char *)sqlite3_column_text(s, 1));
        read.url = database_text(s, 2);
        queue_state_from_name((const char *)sqlite3_column_text(s, 3), &read.state);
        read.outcome = job_row_outcome(s, 4);
        read.tries = sqlite3_column_int(s, 5);
        read.due_ms = sqlite3_column_int64(s, 6);
        snprintf(read.event, sizeof read.event, "%s", (const char *)sqlite3_column_text(s, 7));
        read.ended_ms = sqlite3_column_int64(s, 8);
        read.name = database_text(s, 9);
        read.labels = database_text(s, 10);
        read.trace = database_text(s, 11);
        read.copy_state = database_text(s, 12);
        read.copy_code = database_text(s, 13);
        read.copy_message = database_text(s, 14);
    }
    database_end_read(d);
    if (ok && any)
        *delivery = read;
    else
        queue_delivery_clear(&read);
    if (ok) *found = any;
    return ok;
}

typedef struct ending_delivery {
    change change;
    int64_t number, wait_ms;
} ending_delivery;

static bool end_delivery(database *d, change *asked)
{
    const ending_delivery *x = (ending_delivery *)asked;
    error *e = &asked->fault;
    if (x->wait_ms > 0)
        return RUN(d, e, "UPDATE outbox SET tries = tries + 1, due_ms = ?2, wait_ms = ?3 WHERE number = ?1",
                   integer(x->number), integer(clock_wall_ms() + x->wait_ms), integer(x->wait_ms));
    return RUN(d, e, "DELETE FROM outbox WHERE number = ?1", integer(x->number));
}

bool queue_end_delivery(queue *q, int64_t number, int64_t wait_ms, error *e)
{
    ending_delivery x = {.change.apply = end_delivery, .number = number, .wait_ms = wait_ms};
    return database_change(q->database, &x.change, e);
}

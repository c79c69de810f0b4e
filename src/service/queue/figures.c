// SPDX-License-Identifier: Apache-2.0
/* Figures for monitoring, whose cost does not depend on the number of jobs. */
#include <string.h>

#include "service/database/schema.h"
#include "service/queue/members.h"

bool queue_count(queue *q, int64_t count[QUEUE_STATE_COUNT], error *e)
{
    static const char sql[] = "SELECT state, jobs FROM state_count";
    int64_t read[QUEUE_STATE_COUNT] = {0};
    bool ok = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = database_ask(d, sql, NULL, 0, e);
    while (database_next(d, s, &ok, e)) {
        queue_state state = QUEUE_QUEUED;
        if (queue_state_from_name((const char *)sqlite3_column_text(s, 0), &state))
            read[state] = sqlite3_column_int64(s, 1);
    }
    database_end_read(d);
    if (ok) memcpy(count, read, sizeof read);
    return ok;
}

bool queue_get_figures(queue *q, queue_figures *figures, error *e)
{
    static const char sql[] =
        "SELECT (SELECT at_ms FROM event WHERE event.job = (SELECT min(seq) FROM job WHERE state = 'queued')"
        "  AND type = 'state' ORDER BY seq DESC LIMIT 1),"
        " (SELECT count(*) FROM outbox),"
        " (SELECT ended_ms FROM outbox WHERE number = (SELECT min(number) FROM outbox)),"
        " (SELECT count(*) FROM job WHERE " SCHEMA_UNDELIVERED "),"
        " (SELECT page_count * page_size FROM pragma_page_count, pragma_page_size)";
    queue_figures read = {0};
    bool ok = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = database_ask(d, sql, NULL, 0, e);
    while (database_next(d, s, &ok, e))
        read = (queue_figures){
            .waiting_since_ms = sqlite3_column_int64(s, 0),
            .deliveries = sqlite3_column_int64(s, 1),
            .delivery_since_ms = sqlite3_column_int64(s, 2),
            .undelivered = sqlite3_column_int64(s, 3),
            .database_bytes = sqlite3_column_int64(s, 4),
        };
    database_end_read(d);
    if (ok) *figures = read;
    return ok;
}

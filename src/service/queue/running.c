// SPDX-License-Identifier: Apache-2.0
/* Running periods of the daemon, and waits after the wall clock was set back. */
#include "base/core/clock.h"
#include "service/queue/members.h"

bool running_read(queue *q, running_period periods[RUNNING_PERIODS_MOST], size_t *count, error *e)
{
    static const char sql[] = "SELECT from_ms, length_ms FROM running ORDER BY number";
    size_t used = 0;
    bool ok = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = database_ask(d, sql, NULL, 0, e);
    while (database_next(d, s, &ok, e))
        if (used < RUNNING_PERIODS_MOST)
            periods[used++] = (running_period){sqlite3_column_int64(s, 0), sqlite3_column_int64(s, 1)};
    database_end_read(d);
    if (ok) *count = used;
    return ok;
}

typedef struct running_change {
    change change;
    running_period period[RUNNING_PERIODS_MOST];
    size_t count;
} running_change;

static bool store(database *d, change *asked)
{
    static const char forget[] = "DELETE FROM running";
    const running_change *s = (running_change *)asked;
    error *e = &asked->fault;
    bool ok = database_run(d, forget, NULL, 0, e);
    for (size_t i = 0; ok && i < s->count; i++)
        ok = RUN(d, e, "INSERT INTO running (number, from_ms, length_ms) VALUES (?1, ?2, ?3)",
                 integer((int64_t)i), integer(s->period[i].from_ms), integer(s->period[i].length_ms));
    return ok;
}

bool queue_store_running(queue *q, error *e)
{
    running_change s = {.change.apply = store};
    s.count = running_time_list(q->running, s.period);
    return database_change(q->database, &s.change, e);
}

typedef struct waits_change {
    change change;
    int64_t now;
    bool more;
} waits_change;

/* Shortens some waits. */
static bool shorten(database *d, change *asked)
{
    waits_change *s = (waits_change *)asked;
    error *e = &asked->fault;
    if (!RUN(d, e,
             "UPDATE task SET not_before_ms = ?1 + wait_ms WHERE (job, number) IN"
             " (SELECT job, number FROM task INDEXED BY task_delayed"
             "  WHERE state = 'delayed' AND not_before_ms > ?1 + wait_ms LIMIT ?2)",
             integer(s->now), integer(DATABASE_PIECE_ROWS)))
        return false;
    s->more = database_changes(d) > 0;
    if (!RUN(d, e,
             "UPDATE outbox SET due_ms = ?1 + wait_ms WHERE number IN"
             " (SELECT number FROM outbox INDEXED BY outbox_by_time WHERE due_ms > ?1 + wait_ms LIMIT ?2)",
             integer(s->now), integer(DATABASE_PIECE_ROWS)))
        return false;
    s->more |= database_changes(d) > 0;
    return true;
}

bool queue_shorten_waits(queue *q, error *e)
{
    waits_change s = {.change = {.apply = shorten, .user = ""}, .now = clock_wall_ms()};
    bool ok = true;
    for (s.more = true; ok && s.more;) ok = database_change(q->database, &s.change, e);
    return ok;
}

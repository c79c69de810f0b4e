// SPDX-License-Identifier: Apache-2.0
#include "service/queue/hold.h"

#include "service/queue/members.h"

typedef struct holding {
    change change;
    bool on;
} holding;

bool hold_read(database *d, bool *held, error *e)
{
    static const char sql[] = "SELECT is_held FROM service";
    int64_t read = 0;
    bool ok = database_read_integer(d, database_ask(d, sql, NULL, 0, e), &read, e);
    *held = read != 0;
    return ok;
}

static bool apply(database *d, change *asked)
{
    return RUN(d, &asked->fault, "UPDATE service SET is_held = ?1", integer(((holding *)asked)->on));
}

bool queue_hold(queue *q, bool on, error *e)
{
    holding h = {.change.apply = apply, .on = on};
    return database_change(q->database, &h.change, e);
}

bool queue_is_held(queue *q, bool *held, error *e)
{
    database *d = database_begin_read(q->database);
    bool ok = hold_read(d, held, e);
    database_end_read(d);
    return ok;
}

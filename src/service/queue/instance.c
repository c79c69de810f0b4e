// SPDX-License-Identifier: Apache-2.0
/* The service instance that owns the database. */
#include <stdio.h>

#include "service/queue/members.h"

bool queue_get_instance(queue *q, queue_instance *instance, bool *found, error *e)
{
    static const char sql[] = "SELECT id, boot_id FROM instance";
    queue_instance read = {0};
    bool ok = false, any = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = database_ask(d, sql, NULL, 0, e);
    while (database_next(d, s, &ok, e)) {
        any = true;
        snprintf(read.id, sizeof read.id, "%s", (const char *)sqlite3_column_text(s, 0));
        snprintf(read.boot_id, sizeof read.boot_id, "%s", (const char *)sqlite3_column_text(s, 1));
    }
    database_end_read(d);
    if (!ok) return false;
    *instance = read;
    *found = any;
    return true;
}

typedef struct instance_change {
    change change;
    const queue_instance *instance;
} instance_change;

static bool name(database *d, change *asked)
{
    static const char forget[] = "DELETE FROM instance";
    const instance_change *n = (instance_change *)asked;
    error *e = &asked->fault;
    return database_run(d, forget, NULL, 0, e) &&
           RUN(d, e, "INSERT INTO instance (id, boot_id) VALUES (?1, ?2)", text(n->instance->id),
               text(n->instance->boot_id));
}

bool queue_set_instance(queue *q, const queue_instance *instance, error *e)
{
    instance_change n = {.change.apply = name, .instance = instance};
    return database_change(q->database, &n.change, e);
}

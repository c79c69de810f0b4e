/* The lookup of results that can be reused. */
#include <stdio.h>
#include <stdlib.h>

#include "queue/members.h"

bool queue_recall(queue *q, const char *key, char id[ULID_SIZE], char **inputs, bool *found, error *e)
{
    char *read = NULL;
    bool ok = false;
    database_lock(q->database);
    sqlite3_stmt *s =
        ASK(q->database, e,
            "SELECT id, inputs FROM cache JOIN job ON seq = job WHERE cache.key = ?1 AND state = 'succeeded'",
            text(key));
    char maker[ULID_SIZE] = "";
    while (database_next(q->database, s, &ok, e)) {
        snprintf(maker, sizeof maker, "%s", (const char *)sqlite3_column_text(s, 0));
        read = database_text(s, 1);
    }
    database_unlock(q->database);
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

#include "queue/copy.h"

#include <stdlib.h>

#include "base/memory.h"
#include "queue/members.h"

typedef struct noting {
    change change;
    const char *directory, *name; /* directory NULL: delete the note */
} noting;

bool copy_forget(database *d, const char *name, error *e)
{
    return RUN(d, e, "DELETE FROM copy WHERE name = ?1", text(name));
}

static bool apply(database *d, change *asked)
{
    const noting *n = (noting *)asked;
    error *e = &asked->fault;
    if (!n->directory) return copy_forget(d, n->name, e);
    return RUN(d, e, "INSERT OR REPLACE INTO copy (name, directory) VALUES (?1, ?2)", text(n->name),
               text(n->directory));
}

bool queue_note_copy(queue *q, const char *directory, const char *name, error *e)
{
    noting n = {.change.apply = apply, .directory = directory, .name = name};
    return database_change(q->database, &n.change, e);
}

bool queue_forget_copy(queue *q, const char *name, error *e)
{
    noting n = {.change.apply = apply, .name = name};
    return database_change(q->database, &n.change, e);
}

bool queue_list_copies(queue *q, queue_copy **copies, size_t *count, error *e)
{
    queue_copy *read = NULL;
    size_t used = 0, room = 0;
    bool ok = false;
    database_lock(q->database);
    sqlite3_stmt *s = database_ask(q->database, "SELECT directory, name FROM copy ORDER BY name", NULL, 0, e);
    while (database_next(q->database, s, &ok, e)) {
        if (used == room) read = mem_resize(read, (room = room * 2 + 16) * sizeof *read);
        read[used++] = (queue_copy){database_text(s, 0), database_text(s, 1)};
    }
    database_unlock(q->database);
    if (!ok) {
        queue_copies_free(read, used);
        return false;
    }
    *copies = read;
    *count = used;
    return true;
}

void queue_copies_free(queue_copy *copies, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        free(copies[i].directory);
        free(copies[i].name);
    }
    free(copies);
}

/* health: what is known of the database's soundness: the damage that was found, and the last check.
 *
 * Private to src/queue. Any thread. A database that is damaged is not written to any more, since a change that follows
 * a wrong page may spoil others. A fault of reading counts as damage until a check has read all of the database.
 */
#ifndef HEXAD_QUEUE_HEALTH_H
#define HEXAD_QUEUE_HEALTH_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/error.h"
#include "queue/queue.h"

/* What an operator is told to do about damage. */
#define HEALTH_WAY_OUT                                                                                      \
    "stop hexad, move queue.db* away and put a backup (hexad --backup) in its place, or start with --adopt" \
    " without one; doc/operations.md says how"

typedef struct health health;

health *health_new(void);
void health_free(health *h); /* accepts NULL */

/* Damage was found, by "statement", "quick_check" or "integrity_check"; the first is logged and kept. A doubt, which is
 * a fault of reading, is taken back by a check that finds none. */
void health_note_damage(health *h, const char *found_by, const char *what, bool doubt);

/* False when it is damaged: then the error (database_damaged) says how and what to do. */
bool health_allows_changes(health *h, error *e);

void health_begin_check(health *h);
/* `what` is NULL when nothing was found; `done` false: it could not be made. */
void health_end_check(health *h, const char *name, bool done, const char *what);

void health_get(health *h, queue_health *known);

/* Waits until the time (monotonic), or until there is a doubt that wants a check: then *doubt is true. False: to end. */
bool health_wait(health *h, int64_t until_ms, bool *doubt);
void health_stop(health *h); /* ends health_wait */
const atomic_bool *health_stop_flag(const health *h);

#endif

/* usage: the space that results take, its bounds, and which job goes first when a bound is met.
 *
 * Private to src/queue; the public functions are in queue.h. Call these inside a change or under the lock. Triggers keep
 * the sums, of all jobs in the table service and of each user's in the table usage.
 */
#ifndef HEXAD_QUEUE_USAGE_H
#define HEXAD_QUEUE_USAGE_H

#include "queue/members.h"

/* What has met a bound while no job may be deleted to make room. */
typedef enum usage_verdict { USAGE_ROOM, USAGE_FULL, USAGE_USER_FULL } usage_verdict;

/* Looks at the results of all jobs and, unless `owner` is NULL, at those of this user. */
bool usage_judge(queue *q, database *d, const char *owner, usage_verdict *verdict, error *e);

/* Whether the results of all jobs have met a bound: then no task is started. */
bool usage_is_met(queue *q, database *d, bool *met, error *e);

/* SQL condition on a row of owner: this user's results are below the bounds of a user, ?6 for the bytes and ?7 for the
 * number. */
#define USAGE_BELOW                                                                                       \
    "(min(?6, ?7) = " USAGE_NO_BOUND " OR NOT EXISTS (SELECT 1 FROM usage WHERE usage.owner = owner.name" \
    " AND (bytes >= ?6 OR results >= ?7)))"
#define USAGE_NO_BOUND "9223372036854775807"

/* As queue_note_delivery, inside a change. */
bool usage_note_delivery(database *d, const char *id, int frame, int64_t wall_ms, error *e);

#endif

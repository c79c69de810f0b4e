// SPDX-License-Identifier: Apache-2.0
/* usage: the disk space of results, its bounds, and the job to delete when a bound is reached.
 *
 * Private to src/service/queue; queue.h has the public functions. Call these inside a change or under the
 * lock. Triggers maintain the sums: of all jobs in the table service, of each user in the table usage.
 */
#ifndef HEXAD_SERVICE_QUEUE_USAGE_H
#define HEXAD_SERVICE_QUEUE_USAGE_H

#include "service/queue/members.h"

/* The bound that is reached while no job may be deleted. */
typedef enum usage_level { USAGE_BELOW_BOUNDS, USAGE_FULL, USAGE_USER_FULL } usage_level;

/* Checks the results of all jobs and, unless `owner` is NULL, the results of this user. */
bool usage_check(queue *q, database *d, const char *owner, usage_level *level, error *e);

/* Whether the results of all jobs have reached a bound; no task is started then. */
bool usage_is_met(queue *q, database *d, bool *met, error *e);

/* SQL condition on a row of owner: this user's results are below the user bounds, ?6 for bytes and ?7 for the
 * number of results. */
#define USAGE_BELOW                                                                                       \
    "(min(?6, ?7) = " USAGE_NO_BOUND " OR NOT EXISTS (SELECT 1 FROM usage WHERE usage.owner = owner.name" \
    " AND (bytes >= ?6 OR results >= ?7)))"
#define USAGE_NO_BOUND "9223372036854775807"

/* queue_note_delivery inside a change. */
bool usage_note_delivery(database *d, const char *id, int frame, int64_t wall_ms, error *e);

#endif

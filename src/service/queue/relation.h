// SPDX-License-Identifier: Apache-2.0
/* relation: what the owner of a job may learn of another job to which the queue relates it: one for which it
 * waits, or whose result it reuses.
 *
 * If both jobs have the same owner: everything. Otherwise only whether the other job succeeded as required,
 * and not how it ended, which frames it has, or that it exists where the owner did not name it. This file
 * alone decides that. What it decides is stored, so every view of the job has it; service/api/job_json adds
 * what administrators see.
 *
 * Private to src/service/queue. Call the function inside a change (service/database/database).
 */
#ifndef HEXAD_SERVICE_QUEUE_RELATION_H
#define HEXAD_SERVICE_QUEUE_RELATION_H

#include "service/database/database.h"

/* SQL: whether the owner with the expression `mine` may learn of a job of the owner `other`. */
#define RELATION_IS_SHOWN(mine, other) "(" mine " = " other ")"

/* SQL: the rest of a sentence about the job `need`, which has not succeeded as required, for the owner `mine`
 * of the waiting job. `entry`: the row of job or task with its state and outcome. */
#define RELATION_FAILURE(mine, need, entry)                                                    \
    "CASE WHEN NOT " RELATION_IS_SHOWN(mine, need ".owner") RELATION_FAILURE_OF_OTHERS         \
        " WHEN " entry ".state = 'succeeded'"                                                  \
        " THEN 'has the outcome ' || " entry ".outcome || ', which its queue.accept excludes'" \
        " ELSE 'is ' || " entry ".state || ': retry that job first' END"
#define RELATION_FAILURE_OF_OTHERS " THEN 'did not succeed as required: ask its owner'"

/* The message for the owner of the job `seq`, which fails because the job `need` has not succeeded as
 * required. To be freed. */
bool relation_describe_failure(database *d, int64_t seq, int64_t need, char **message, error *e);

#endif

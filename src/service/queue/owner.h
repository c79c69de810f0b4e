// SPDX-License-Identifier: Apache-2.0
/* owner: users with unfinished jobs, and the order of their turns.
 *
 * Private to src/service/queue. Call every function inside a change (service/database/database).
 *
 * Users take turns within a priority (stride scheduling: Waldspurger and Weihl 1995). The `pass` of a user
 * determines the user's next turn; each claim of one of the user's tasks increases it by 1 / weight. The next
 * turn goes to the user with the lowest pass among those whose first job has the highest priority.
 * `service.turn` is the highest pass that has had a turn. Turns do not accumulate: a new user starts at that
 * turn, and a user who had no jobs or was skipped (by priority, by a limit) continues from there. Debts do
 * not expire: the row of a user without jobs remains until the turn has reached the user's pass, or until no
 * user has jobs.
 *
 * A row has the priority and the seq of the user's first job that may be claimed, so that a claim reads one
 * index in order, whatever the number of jobs and users.
 */
#ifndef HEXAD_SERVICE_QUEUE_OWNER_H
#define HEXAD_SERVICE_QUEUE_OWNER_H

#include "service/queue/members.h"

/* Updates the owner of the job `seq` after a change of the job: adds to the numbers of unfinished jobs, of
 * unfinished tasks and of running tasks, and finds the first job. */
bool owner_update(database *d, int64_t seq, int unfinished, int tasks, int running, error *e);

/* Records a turn of the owner of the job. `weights` may be NULL. */
bool owner_take_turn(database *d, int64_t seq, const user_numbers *weights, error *e);

/* Whether another task of the job, of which a task runs, may be claimed: the job and its owner are below
 * their limits, and it fits into the free resources. */
bool owner_may_continue(queue *q, int64_t seq, const queue_resources *resources, bool *may, error *e);

/* Chooses the job to claim from; *seq 0: none. Others may overtake a job that does not fit, at most
 * QUEUE_OVERTAKE_MOST times. */
bool owner_choose(queue *q, const queue_resources *resources, int64_t *seq, error *e);

#endif

/* owner: the users who have unfinished jobs, and whose turn it is.
 *
 * Private to src/queue. Call every function inside a change (database/database).
 *
 * Users take turns within a priority (stride scheduling: Waldspurger and Weihl 1995). A user's `pass` tells when his
 * next turn is, and each claim of one of his tasks moves it on by 1 / weight. Of the users whose first job has the
 * highest priority, the one with the lowest pass is next. `service.turn` is the highest pass that had a turn so far.
 * Nobody saves up turns: who comes begins at that turn, and who was away or was passed by (by priority, by a limit)
 * continues from there. Nobody loses a debt by going away: the row of a user without jobs stays until the turn has
 * reached his pass, or no user has jobs.
 *
 * A row has the priority and the seq of the first job that its user may have claimed, so that a claim reads one index
 * in order, whatever the number of jobs and users.
 */
#ifndef HEXAD_QUEUE_OWNER_H
#define HEXAD_QUEUE_OWNER_H

#include "queue/members.h"

/* Updates the owner of the job `seq` after a change of the job: adds to the counts of unfinished jobs and running tasks,
 * and finds the first job. */
bool owner_update(database *d, int64_t seq, int unfinished, int running, error *e);

/* The owner of the job has had a turn. `weights` may be NULL. */
bool owner_take_turn(database *d, int64_t seq, const user_numbers *weights, error *e);

/* Chooses the job to claim from; 0: none. Others may overtake a job that does not fit, but only QUEUE_OVERTAKE_MOST
 * times. */
bool owner_choose(queue *q, const queue_room *room, int64_t *seq, error *e);

#endif

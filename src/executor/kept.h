/* kept: results whose copy could not be made, since the disk of output.directory was full or failed.
 *
 * Such a result stays in the directory of its attempt, and the next attempt takes it over instead of making it again.
 */
#ifndef HEXAD_EXECUTOR_KEPT_H
#define HEXAD_EXECUTOR_KEPT_H

#include "queue/queue.h"

/* Renames the result that an attempt before has left to `directory`; false when there is none. */
bool kept_take(const char *state_dir, const queue_claimed *claimed, const char *directory);

/* Removes those of the tasks of a job that were cancelled. */
void kept_remove(queue *q, const char *state_dir, const char *id);

#endif

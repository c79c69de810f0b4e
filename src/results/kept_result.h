/* kept_result: results that could not be copied to output.directory because its disk was full or failed.
 *
 * Such a result stays in the directory of its attempt. The next attempt takes it over instead of computing it again.
 */
#ifndef HEXAD_RESULTS_KEPT_RESULT_H
#define HEXAD_RESULTS_KEPT_RESULT_H

#include "queue/queue.h"

/* Renames the result that an earlier attempt left to `directory`. False when there is none. */
bool kept_result_take(const char *work_dir, const queue_claimed *claimed, const char *directory);

/* Removes the kept results of those tasks of the job that were cancelled. */
void kept_result_remove(queue *q, const char *work_dir, const char *id);

#endif

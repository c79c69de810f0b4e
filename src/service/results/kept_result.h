// SPDX-License-Identifier: Apache-2.0
/* kept_result: results that could not be copied to output.directory because its disk was full or failed.
 *
 * Such a result stays in the directory of its attempt. The next attempt uses it instead of computing it
 * again.
 */
#ifndef HEXAD_SERVICE_RESULTS_KEPT_RESULT_H
#define HEXAD_SERVICE_RESULTS_KEPT_RESULT_H

#include "service/queue/queue.h"

/* Renames the complete result of the latest earlier attempt that has one to `directory`, which must not
 * exist. False if no attempt has one, or if the renaming fails. */
bool kept_result_take(const char *work_dir, const queue_claimed *claimed, const char *directory);

/* Removes the kept results of all cancelled tasks of the job. Their logs stay. Failures are logged or
 * ignored. */
void kept_result_remove(queue *q, const char *work_dir, const char *id);

#endif

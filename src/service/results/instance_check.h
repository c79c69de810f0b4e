// SPDX-License-Identifier: Apache-2.0
/* instance_check: checks that the queue's database and the state directory belong together.
 *
 * Both contain the same random id: the database in a table, the directory in the file `instance`. A new
 * database, or the database of another instance, contains none of the jobs whose results are in the
 * directory. Therefore a start with such a database fails unless the administrator passes --adopt. A restored
 * backup of the same instance has the same id. Called by one thread, at a start.
 */
#ifndef HEXAD_SERVICE_RESULTS_INSTANCE_CHECK_H
#define HEXAD_SERVICE_RESULTS_INSTANCE_CHECK_H

#include <stdbool.h>

#include "base/core/error.h"
#include "service/queue/queue.h"

#define INSTANCE_CHECK_FILE_NAME "instance" /* in work_dir; holds the id and a line end */

/* Opens the queue like queue_open, and checks that the database in state_dir belongs to work_dir, which holds
 * the results. Without `adopt` the call fails (internal), and changes nothing, if
 *     - results exist, and the database is missing or empty or belongs to no instance yet,
 *     - the database has another id than the directory, or none although the directory has one,
 *     - the file `instance` does not contain an id. */
queue *instance_check_open_queue(const char *state_dir, const char *work_dir, bool adopt, error *e);

/* Gives the database and the directory the same id (the directory's, else the database's, else a new one) and
 * stores the present boot id of the host. Call it after the inventory: if an adoption is interrupted before
 * this call, the next start refuses the database or repeats the adoption. If the file cannot be written, logs
 * a warning and succeeds. Errors: those of queue_get_instance and queue_set_instance. */
bool instance_check_join(queue *q, const char *work_dir, const char *boot_id, error *e);

#endif

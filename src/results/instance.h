/* instance: checks that the queue's database and the state directory belong together.
 *
 * Both contain the same random id: the database in a table, the directory in the file `instance`. With a new
 * database, or that of another service, no result in the directory would be known. So a start with such a database is
 * refused, unless the administrator accepts it (--adopt). A restored backup of the same service has the same id.
 * Called by one thread, at a start.
 */
#ifndef HEXAD_RESULTS_INSTANCE_H
#define HEXAD_RESULTS_INSTANCE_H

#include <stdbool.h>

#include "base/error.h"
#include "queue/queue.h"

#define INSTANCE_FILE_NAME "instance"

/* Like queue_open, and checks that the database in state_dir belongs to work_dir, where the results are. Without `adopt` it refuses
 *     no database, or an empty one, when there are results,
 *     a database whose id differs from that of the directory, or is missing while the directory has one.
 * After a refusal nothing has changed. */
queue *instance_open_queue(const char *state_dir, const char *work_dir, bool adopt, error *e);

/* Gives the database and the directory the same id, if they do not have it yet, and stores the present boot id of the
 * host. Call it after the inventory: an adoption that is interrupted before is refused or repeated at the next start.
 * When the file cannot be written, a warning is logged. */
bool instance_join(queue *q, const char *work_dir, const char *boot_id, error *e);

#endif

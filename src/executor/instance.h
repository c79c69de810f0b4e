/* instance: whether the queue's database and the state directory belong together.
 *
 * Both hold the same random id: the database in a table, the directory in the file `instance`. A database that was
 * lost and made anew, or that is another service's, would make strangers of all results; so a start with one is
 * refused, unless the administrator says that it is to be taken (--adopt). An older database of the same service,
 * a backup that was put back, has the same id. Called by one thread, at a start.
 */
#ifndef HEXAD_EXECUTOR_INSTANCE_H
#define HEXAD_EXECUTOR_INSTANCE_H

#include <stdbool.h>

#include "base/error.h"
#include "queue/queue.h"

#define INSTANCE_FILE_NAME "instance"

/* As queue_open, of a database that belongs to the directory, or that is to be taken for it whatever it is:
 * refused without `adopt` are
 *     no database, or an empty one, where there are results,
 *     a database with another id than the directory, or with none where the directory has one.
 * A refusal leaves everything as it is. */
queue *instance_open_queue(const char *state_dir, bool adopt, error *e);

/* The database and the directory are given the same id, if they have not got it, and the database the host's
 * present boot id. To be called when all that was found in the directory is known to the queue, or put away: what
 * is cut short before that is refused again, or done again. That the file cannot be written is a warning. */
bool instance_join(queue *q, const char *state_dir, const char *boot_id, error *e);

#endif

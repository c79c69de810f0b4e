/* hold: whether the queue is held, so that no tasks are started.
 *
 * Private to src/queue. queue.h has the public functions.
 */
#ifndef HEXAD_QUEUE_HOLD_H
#define HEXAD_QUEUE_HOLD_H

#include "database/database.h"

/* Call it inside a change. */
bool hold_read(database *d, bool *held, error *e);

#endif

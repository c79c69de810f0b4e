/* hold: whether tasks are started at all.
 *
 * Private to src/queue. The public functions are in queue.h.
 */
#ifndef HEXAD_QUEUE_HOLD_H
#define HEXAD_QUEUE_HOLD_H

#include "database/database.h"

/* Call it inside a change. */
bool hold_read(database *d, bool *held, error *e);

#endif

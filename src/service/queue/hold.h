// SPDX-License-Identifier: Apache-2.0
/* hold: whether the queue is held, so that no tasks are started.
 *
 * Private to src/service/queue. queue.h has the public functions.
 */
#ifndef HEXAD_SERVICE_QUEUE_HOLD_H
#define HEXAD_SERVICE_QUEUE_HOLD_H

#include "service/database/database.h"

/* Call it inside a change. */
bool hold_read(database *d, bool *held, error *e);

#endif

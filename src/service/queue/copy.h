// SPDX-License-Identifier: Apache-2.0
/* copy: records of the temporary files of result copies. A record is stored before its file is created.
 *
 * Private to src/service/queue. queue.h has the public functions.
 */
#ifndef HEXAD_SERVICE_QUEUE_COPY_H
#define HEXAD_SERVICE_QUEUE_COPY_H

#include "service/database/database.h"

/* Deletes the record. Call it inside a change. */
bool copy_forget(database *d, const char *name, error *e);

#endif

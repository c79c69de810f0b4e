/* copy: records of the temporary files of result copies. A record is stored before its file is created.
 *
 * Private to src/queue. queue.h has the public functions.
 */
#ifndef HEXAD_QUEUE_COPY_H
#define HEXAD_QUEUE_COPY_H

#include "database/database.h"

/* Deletes the record. Call it inside a change. */
bool copy_forget(database *d, const char *name, error *e);

#endif

/* copy: notes of the temporary files of result copies. A note is stored before its file is created.
 *
 * Private to src/queue. The public functions are in queue.h.
 */
#ifndef HEXAD_QUEUE_COPY_H
#define HEXAD_QUEUE_COPY_H

#include "database/database.h"

/* Deletes the note. Call it inside a change. */
bool copy_forget(database *d, const char *name, error *e);

#endif

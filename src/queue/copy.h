/* copy: the temporary files of copies of results, written down before they are made.
 *
 * Private to src/queue; queue.h has what others call.
 */
#ifndef HEXAD_QUEUE_COPY_H
#define HEXAD_QUEUE_COPY_H

#include "queue/database.h"

/* Part of a transaction. */
bool copy_forget(database *d, const char *name, error *e);

#endif

/* checker: the thread that looks for damage in the database.
 *
 * It copies the database and checks the copy, so that the queue is held for moments only and what is checked does not
 * change. A quick check comes at once; a full one every `interval_s` seconds, put off while the queue is busy, for that long
 * again at most. A fault of reading is followed by a full check at once. What is found stands in queue_get_health.
 */
#ifndef HEXAD_QUEUE_CHECKER_H
#define HEXAD_QUEUE_CHECKER_H

#include <stdint.h>

#include "base/error.h"
#include "queue/queue.h"

typedef struct checker checker;

/* interval_s 0: no check but the first, and those after faults. A copy leaves so many bytes of the disk free, or is not
 * made. The queue must outlive the checker. */
checker *checker_start(queue *q, double interval_s, int64_t free_bytes, error *e);
void checker_stop(
    checker *c); /* accepts NULL; a check under way is broken off between two steps of its copy */

#endif

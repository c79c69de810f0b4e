/* redelivery: copies results to output.directory again, after their jobs have ended.
 *
 * A thread works off the jobs that the queue has marked (QUEUE_DELIVER), one after the other, also after a restart.
 */
#ifndef HEXAD_RESULTS_REDELIVERY_H
#define HEXAD_RESULTS_REDELIVERY_H

#include "results/output_place.h"

typedef struct redelivery redelivery;

/* The queue and the place must outlive it. */
redelivery *redelivery_start(queue *q, output_place *outputs, const char *work_dir, error *e);
/* Waits for the copy under way. Accepts NULL. */
void redelivery_stop(redelivery *r);

/* The queue has marked a job. */
void redelivery_wake(redelivery *r);

#endif

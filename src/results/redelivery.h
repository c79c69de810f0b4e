/* redelivery: copies results to output.directory again, after their jobs have ended.
 *
 * Some threads work off the jobs that the queue has marked (QUEUE_DELIVER), also after a restart. The jobs of one user are
 * delivered one after the other, so a file system that hangs delays those of its users only.
 */
#ifndef HEXAD_RESULTS_REDELIVERY_H
#define HEXAD_RESULTS_REDELIVERY_H

#include "results/output_place.h"

typedef struct redelivery redelivery;

/* The queue and the place must outlive it. */
redelivery *redelivery_start(queue *q, output_place *outputs, const char *work_dir, error *e);
/* Waits for the copies under way. Accepts NULL. */
void redelivery_stop(redelivery *r);

/* The queue has marked a job. */
void redelivery_wake(redelivery *r);

#endif

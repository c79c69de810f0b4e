/* herald: tells who waits in the lounge what has happened to which job.
 *
 * One thread waits for the queue, reads what is new of its events and of the progress of attempts, once for all
 * who listen, and wakes those who wait for one of the jobs concerned, or for jobs of its owner; the topic of a job is
 * its id.
 */
#ifndef HEXAD_HTTP_HERALD_H
#define HEXAD_HTTP_HERALD_H

#include "executor/executor.h"
#include "http/lounge.h"
#include "http/reply.h"
#include "queue/queue.h"

typedef struct herald herald;

/* All three outlive it. */
herald *herald_start(queue *q, executor *x, lounge *l, error *e);
void herald_stop(herald *h); /* accepts NULL */

/* The topic of all that happens to jobs of a user. */
void herald_name_topic(const char *owner, char topic[REPLY_TOPIC_SIZE]);

#endif

/* notifier: wakes the connections in the wait list when something happened to the jobs that they wait for.
 *
 * One thread waits for the queue. It reads the new events and the new lines of progress once for all
 * connections, and wakes those that wait for one of these jobs, or for the jobs of one of their owners. The
 * topic of a job is its id.
 */
#ifndef HEXAD_API_NOTIFIER_H
#define HEXAD_API_NOTIFIER_H

#include "executor/executor.h"
#include "http/reply.h"
#include "http/wait_list.h"
#include "queue/queue.h"

typedef struct notifier notifier;

/* Queue, executor and wait list outlive the notifier. */
notifier *notifier_start(queue *q, executor *x, wait_list *l, error *e);
void notifier_stop(notifier *n); /* accepts NULL */

/* The topic of all jobs of a user. */
void notifier_name_topic(const char *owner, char topic[REPLY_TOPIC_SIZE]);

#endif

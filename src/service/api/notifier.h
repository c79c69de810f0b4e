// SPDX-License-Identifier: Apache-2.0
/* notifier: wakes connections in the wait list when their jobs have new events or progress lines.
 *
 * One task waits for the queue. It reads the new events and progress lines once for all connections, and
 * wakes the connections that wait for the topic of one of these jobs or of its owner. The topic of a job is
 * its id.
 */
#ifndef HEXAD_SERVICE_API_NOTIFIER_H
#define HEXAD_SERVICE_API_NOTIFIER_H

#include "service/executor/executor.h"
#include "service/http/reply.h"
#include "service/http/wait_list.h"
#include "service/queue/queue.h"

typedef struct notifier notifier;

/* Adds the task to the runner. Queue, executor and wait list must outlive the notifier. NULL on failure:
 * errors of the queue. */
notifier *notifier_add(runner *to, queue *q, executor *x, wait_list *l, error *e);
/* After runner_stop. Accepts NULL. */
void notifier_free(notifier *n);

/* The topic of all jobs of a user. Any thread. */
void notifier_name_topic(const char *owner, char topic[REPLY_TOPIC_SIZE]);

#endif

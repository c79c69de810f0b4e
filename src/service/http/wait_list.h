// SPDX-License-Identifier: Apache-2.0
/* wait_list: suspended connections that wait for an event: event streams, and answers that the client asked
 * to delay.
 *
 * A waiting connection occupies memory but no thread. It waits for a topic (the id of a job) or for any
 * topic, and at most until a deadline. wait_list_wake resumes the connections that wait for a topic. To miss
 * no event, the caller calls wait_list_seen before it looks for news, and passes the number to wait_list_add.
 * If there was a wake-up in between, the connection does not wait. Any thread may call all functions.
 */
#ifndef HEXAD_SERVICE_HTTP_WAIT_LIST_H
#define HEXAD_SERVICE_HTTP_WAIT_LIST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/runner.h"
#include "service/http/loop.h"

typedef struct wait_list wait_list;

/* Adds a task to the runner that resumes connections at their deadlines. */
wait_list *wait_list_new(runner *to);

/* Resumes all connections. Afterwards no connection waits. */
void wait_list_dismiss(wait_list *l);
void wait_list_free(
    wait_list *l); /* after wait_list_dismiss, or if no connection waited, and runner_stop; accepts NULL */
bool wait_list_is_dismissed(wait_list *l);

/* The current number of wake-ups. */
uint64_t wait_list_seen(wait_list *l);

/* Resumes the suspended connection, which `served_by` serves, when the topic ("": any) is woken or the
 * deadline (monotonic clock) has passed. False, without an effect, if there was a wake-up since `seen`, or
 * after a dismissal. */
bool wait_list_add(wait_list *l, loop *served_by, struct MHD_Connection *connection, uint64_t seen,
                   const char *topic, int64_t until_ms);

/* Resumes the connections that wait for one of the topics or for any. */
void wait_list_wake(wait_list *l, const char *const *topics, size_t count);

#endif

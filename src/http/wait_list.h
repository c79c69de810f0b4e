/* wait_list: suspended connections that wait for something to happen: event streams, and answers that the
 * client asked to delay.
 *
 * A waiting connection costs memory but no thread. It waits for a topic (the id of a job) or for any topic,
 * and until a deadline. wait_list_wake resumes the connections that wait for a topic. To miss nothing, the
 * caller asks for wait_list_seen before it looks for news, and passes that number to wait_list_wait: when
 * something happened in between, the connection does not wait. All functions may be called from any thread.
 */
#ifndef HEXAD_HTTP_WAIT_LIST_H
#define HEXAD_HTTP_WAIT_LIST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "http/loop.h"

typedef struct wait_list wait_list;

/* Starts a thread that resumes connections at their deadlines. */
wait_list *wait_list_open(error *e);

/* Resumes all connections. From now on wait_list_wait suspends none. */
void wait_list_dismiss(wait_list *l);
void wait_list_close(wait_list *l); /* dismisses first; accepts NULL */
bool wait_list_is_dismissed(wait_list *l);

/* The number of wake-ups so far; see above. */
uint64_t wait_list_seen(wait_list *l);

/* Suspends the connection, which `served_by` serves, until the topic ("": any) is woken or the deadline
 * (monotonic) has passed. Returns false, without suspending it, when there was a wake-up since `seen`, or
 * after a dismissal. */
bool wait_list_wait(wait_list *l, loop *served_by, struct MHD_Connection *connection, uint64_t seen,
                    const char *topic, int64_t until_ms);

/* As wait_list_wait, for a connection that is suspended already: it stays so. */
bool wait_list_add(wait_list *l, loop *served_by, struct MHD_Connection *connection, uint64_t seen,
                   const char *topic, int64_t until_ms);

/* Resumes the connections that wait for one of the topics or for any. */
void wait_list_wake(wait_list *l, const char *const *topics, size_t count);

#endif

/* lounge: connections that wait for something to happen: event streams, and answers that were asked to wait.
 *
 * They cost no thread, only memory. Each waits for a topic (the id of a job) or for anything, and for a time. What
 * happens is told by lounge_wake, which lets those who wait for it go on; a guest that looked before that and
 * sits down after it is not let wait (`seen`), so that nothing is missed. Any thread.
 */
#ifndef HEXAD_HTTP_LOUNGE_H
#define HEXAD_HTTP_LOUNGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "http/loop.h"

typedef struct lounge lounge;

/* A thread of its own lets go those whose time has come. */
lounge *lounge_open(error *e);

/* From now on nobody waits any more: those who do are let go, and others are not let in. */
void lounge_dismiss(lounge *l);
void lounge_close(lounge *l); /* dismisses; accepts NULL */
bool lounge_is_dismissed(lounge *l);

/* To be asked for before looking whether there is something to do. */
uint64_t lounge_seen(lounge *l);

/* Suspends the connection, which the loop serves, until the topic ("": any) is woken or the time (monotonic) has
 * come. False, and not suspended, when something happened since `seen`. */
bool lounge_wait(lounge *l, loop *served_by, struct MHD_Connection *connection, uint64_t seen,
                 const char *topic, int64_t until_ms);

/* Lets go who waits for one of the topics or for any. */
void lounge_wake(lounge *l, const char *const *topics, size_t count);

#endif

/* events: the handlers of the events of jobs: pages of JSON, or a stream of Server-Sent Events when the
 * client accepts text/event-stream.
 *
 * The events are those of the queue; the number of an event is its id in the stream. Without Last-Event-ID
 * and without the parameter `after`, the events of one job begin with its first one, since they are few.
 * Those of all jobs begin now, so that a new reader costs the same however long the history is.
 *
 * A stream of all jobs begins with an event `position`, whose id and `seq` are the number after which it
 * continues. Another one follows when a filter skipped many events, so that a client that reconnects need not
 * wait for them again, and when events are missing. In it, `removed_up_to` means: unsent events up to that
 * number were removed with their jobs. `reset` means: the client named a number that the database has not
 * reached, because it was restored from an older backup; the stream continues after `seq`. Pages of JSON have
 * `position` and both members, too.
 *
 * With the parameter `all` the events are those of the jobs of all users: they tell what lists and GET /v1/workers tell
 * everyone.
 *
 * The stream of one job also has events `progress`, one for each progress line of a worker; another stream has them with
 * the parameter `progress`. They are not stored, and a slow client misses some. The stream of one job ends with it.
 */
#ifndef HEXAD_API_EVENTS_H
#define HEXAD_API_EVENTS_H

#include "api/context.h"

http_handler events_of_job, events_of_all;

#endif

/* events: the handlers of what happened to jobs: pages of JSON, or a stream of Server-Sent Events where the client
 * accepts text/event-stream.
 *
 * The events are those of the queue, with their number as the id of the stream. Without Last-Event-ID and without the
 * query's `after`, the events of one job begin at its beginning, since they are few and belong together; those of all
 * jobs begin now, so that a new follower costs the same however long the history is.
 *
 * A stream of all jobs begins with an event `position`, whose id and `seq` say where: what follows has higher numbers.
 * It comes again when a filter left out many events, so that a client that comes again need not wait for them twice,
 * and when events are missing. `removed_up_to` in it: events up to that number, not told yet, were removed with their
 * jobs. `reset`: the client asked for a number that was not given yet, since the database is an older one than that it
 * was following (a restored backup); what follows begins at `seq`. Pages of JSON have `position` and both members, too.
 *
 * A job's stream has, between its events, events `progress`, one for each line of progress of a worker as long as there
 * is one: these have no id, are not stored, and a client that reads slowly misses some. It ends with the job.
 */
#ifndef HEXAD_API_EVENTS_H
#define HEXAD_API_EVENTS_H

#include "api/context.h"

http_handler events_of_job, events_of_all;

#endif

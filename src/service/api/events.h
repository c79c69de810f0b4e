// SPDX-License-Identifier: Apache-2.0
/* events: the handlers that send the events of jobs: pages of JSON, or a stream of Server-Sent Events if the
 * client accepts text/event-stream.
 *
 * The events are stored in the queue; the number of an event is its id in the stream. A request can name the
 * last event that the client has, by Last-Event-ID or the parameter `after`. Otherwise the events of one job
 * begin with its first event, since a job has few. The events of all jobs then begin with the next new event,
 * so that the cost of a new client does not grow with the history.
 *
 * A stream of all jobs begins with an event `position`, whose id and `seq` are the number after which the
 * stream continues. A further `position` follows
 *     - when a filter has skipped many events, so that a client that reconnects need not wait for them again,
 *     - when events are missing. `removed_up_to`: unsent events up to this number were removed with their
 *       jobs. `reset`: the client named a number that the database has not reached, because it was restored
 *       from an older backup; the stream continues after `seq`.
 * Pages of JSON have `position` and the same two members.
 *
 * With the parameter `all`, the events are those of the jobs of all users. They contain only what lists of
 * jobs and GET /v1/workers show to every reader.
 *
 * The stream of one job has also events `progress`, one for each progress line of a worker; a stream of all
 * jobs has them with the parameter `progress`. They are not stored, so a slow client may not receive all. The
 * stream of one job ends with the event of its end.
 */
#ifndef HEXAD_SERVICE_API_EVENTS_H
#define HEXAD_SERVICE_API_EVENTS_H

#include "service/api/context.h"

http_handler events_of_job, events_of_all;

#endif

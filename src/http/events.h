/* events: the handlers of what happened to jobs: pages of JSON, or a stream of Server-Sent Events where the client
 * accepts text/event-stream.
 *
 * A stream begins behind the event that Last-Event-ID names (or the query's `after`; without either at the
 * beginning), and goes on with what comes. Its events are those of the queue, with the number as their id; between them
 * stand events `progress`, one for each line of progress of a worker as long as there is one: these have no id,
 * are not stored, and a client that reads slowly misses some. A job's stream ends with its end.
 */
#ifndef HEXAD_HTTP_EVENTS_H
#define HEXAD_HTTP_EVENTS_H

#include "http/handler.h"

http_handler events_of_job, events_of_all;

#endif

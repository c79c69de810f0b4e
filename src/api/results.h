/* results: the handlers of a job's results.
 *
 * A result never changes, so its ETag is its SHA-256 and a client may keep it; a part is sent where one range of
 * bytes is asked for (several are answered with the whole, as RFC 9110 allows).
 */
#ifndef HEXAD_API_RESULTS_H
#define HEXAD_API_RESULTS_H

#include "api/context.h"

http_handler results_list, results_send;

#endif

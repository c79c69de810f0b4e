/* results: the handlers of the results of a job.
 *
 * A result never changes, so its ETag is its SHA-256 and clients may cache it. A request for one range of
 * bytes gets that part; a request for several ranges gets the whole file, as RFC 9110 allows.
 */
#ifndef HEXAD_API_RESULTS_H
#define HEXAD_API_RESULTS_H

#include "api/context.h"

http_handler results_list, results_send, results_send_thumbnail;

#endif

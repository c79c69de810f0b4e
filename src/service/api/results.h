/* results: the handlers that list and send the files of the result of a job.
 *
 * A file of a result never changes, so its ETag is its SHA-256 and clients may cache it. A request for one range of
 * bytes is answered with that range; a request for several ranges with the whole file, as RFC 9110 allows.
 */
#ifndef HEXAD_SERVICE_API_RESULTS_H
#define HEXAD_SERVICE_API_RESULTS_H

#include "service/api/context.h"

http_handler results_list, results_send, results_send_thumbnail;

#endif

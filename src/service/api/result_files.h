// SPDX-License-Identifier: Apache-2.0
/* result_files: the handlers that list and send the files of the result of a job.
 *
 * A file of a result never changes, so its ETag is its SHA-256 and clients may cache it. A request for one
 * range of bytes is answered with that range; a request for several ranges with the whole file, as RFC 9110
 * allows.
 */
#ifndef HEXAD_SERVICE_API_RESULT_FILES_H
#define HEXAD_SERVICE_API_RESULT_FILES_H

#include "service/api/context.h"

http_handler result_files_list, result_files_send, result_files_send_thumbnail;

/* Answers the removed route of contact sheets with 410. */
http_handler result_files_refuse_contact_sheet;

#endif

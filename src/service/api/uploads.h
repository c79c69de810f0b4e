// SPDX-License-Identifier: Apache-2.0
/* uploads: the handlers of /v1/inputs, the files that clients upload for their jobs
 * (service/uploads/upload_store.h). */
#ifndef HEXAD_SERVICE_API_UPLOADS_H
#define HEXAD_SERVICE_API_UPLOADS_H

#include "service/api/context.h"

/* Whether jobs of the caller may read the uploaded file of this hash: the caller has uploaded it, has not deleted it,
 * and it exists; the caller is an administrator, or share_inputs is set. In the last two cases the file need not
 * exist. Any thread. */
bool uploads_may_use(const http_context *c, const access_caller *caller, const char *hex);

/* Whether the file, or the directory of an image of many files, at this path (without a frame pattern) exists
 * and jobs of the caller may read it. For an uploaded file, the call counts as a use, so that it is kept
 * longer. Errors: input_missing; those of store_open_place. Any thread. */
bool uploads_check(const http_context *c, const access_caller *caller, const char *path, error *e);

http_opener uploads_begin; /* the opener of PUT; uploads_put finishes its sink */
http_handler uploads_put, uploads_list, uploads_show, uploads_delete, uploads_inspect;

#endif

// SPDX-License-Identifier: Apache-2.0
/* thumbnail_process: the thumbnail of a result's preview, made by another process (io/pictures/thumbnail).
 * Any thread. */
#ifndef HEXAD_SERVICE_API_THUMBNAIL_PROCESS_H
#define HEXAD_SERVICE_API_THUMBNAIL_PROCESS_H

#include "service/api/context.h"
#include "io/pictures/thumbnail.h"

/* Reads the preview in the directory of a result. Error limit_time: at `until_ms` (monotonic), after
 * thumbnail_timeout_s, or when the service stops, whichever is first. Other errors: those of result_open_file
 * and of thumbnail_read. */
bool thumbnail_process_read(const http_context *c, const char *directory, int64_t until_ms, thumbnail *out,
                            error *e);

#endif

/* preview: the preview of a result as a thumbnail, which another process makes (formats/thumbnail). */
#ifndef HEXAD_API_PREVIEW_H
#define HEXAD_API_PREVIEW_H

#include "api/context.h"
#include "formats/thumbnail.h"

/* Reads the preview in the directory of a result. Returns at `until_ms` (clock_monotonic_ms) at the latest, and earlier after
 * thumbnail_timeout_s or when the service stops: error limit_time. Other errors: not_found of results/result.h, those of
 * thumbnail_read. */
bool preview_read_thumbnail(const http_context *c, const char *directory, int64_t until_ms, thumbnail *out,
                            error *e);

#endif

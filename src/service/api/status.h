// SPDX-License-Identifier: Apache-2.0
/* status: the handlers that report the state of the service, and those that drain and hold it. */
#ifndef HEXAD_SERVICE_API_STATUS_H
#define HEXAD_SERVICE_API_STATUS_H

#include "service/api/context.h"

http_handler status_health, status_ready, status_version, status_workers, status_usage, status_tokens;

/* Drained, the service accepts no jobs and starts no attempts; running attempts continue. It lasts until
 * status_resume or a restart. */
http_handler status_drain, status_resume;

/* Held, the service accepts jobs but starts no attempts; running attempts continue. It lasts until
 * status_release, also over a restart. */
http_handler status_hold, status_release;

#endif

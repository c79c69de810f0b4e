/* status: the handlers that report on the service itself. */
#ifndef HEXAD_API_STATUS_H
#define HEXAD_API_STATUS_H

#include "api/context.h"

http_handler status_health, status_ready, status_version, status_workers, status_usage;

/* Drain: the service accepts no jobs and starts no attempts; running ones continue. Resume ends that, and so
 * does a restart. */
http_handler status_drain, status_resume;

/* Hold: the service accepts jobs but starts no attempts; running ones continue. Lasts until the release, also over a
 * restart. */
http_handler status_hold, status_release;

#endif

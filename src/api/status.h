/* status: the handlers that tell of the service itself. */
#ifndef HEXAD_API_STATUS_H
#define HEXAD_API_STATUS_H

#include "api/context.h"

http_handler status_health, status_ready, status_metrics, status_version, status_workers;

/* No job is taken and no attempt started, what runs goes on; and the end of that. Not kept over a restart. */
http_handler status_drain, status_resume;

#endif

// SPDX-License-Identifier: Apache-2.0
/* metrics: the handler of GET /metrics: measurements of the service in the text format of Prometheus. */
#ifndef HEXAD_SERVICE_API_METRICS_H
#define HEXAD_SERVICE_API_METRICS_H

#include "service/api/context.h"

http_handler metrics_show;

#endif

/* metrics: the handler of GET /metrics: measurements of the service in the text format of Prometheus. */
#ifndef HEXAD_API_METRICS_H
#define HEXAD_API_METRICS_H

#include "api/context.h"

http_handler metrics_show;

#endif

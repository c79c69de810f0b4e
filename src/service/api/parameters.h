// SPDX-License-Identifier: Apache-2.0
/* parameters: the table of the parameters in paths and queries and of the headers of all routes: types,
 * ranges, texts of the OpenAPI document. Constant data; any thread. */
#ifndef HEXAD_SERVICE_API_PARAMETERS_H
#define HEXAD_SERVICE_API_PARAMETERS_H

#include "service/http/parameter.h"
#include "service/queue/queue.h"

extern const parameter_table api_parameters;

/* Reads the parameter `sort`, which must have been checked, into the order of a list and its direction.
 * Without the parameter: QUEUE_BY_AGE, with the newest job first. Returns its word. */
const char *parameters_read_order(const http_request *request, queue_order *order, bool *rising);

#endif

// SPDX-License-Identifier: Apache-2.0
/* openapi: the OpenAPI 3.1 document of the interface.
 *
 * It is made from the tables that the server uses: the routes (service/api/routes.h), the parameters
 * (service/api/parameters.h), the problems (service/http/reply.h) and the job spec (spec/json_schema.h). The
 * schemas of answers are in openapi_schemas.json and examples of them in openapi_examples.json, both compiled
 * in; tests compare every answer with them. Schemas of requests are closed: unknown members are errors.
 * Schemas of answers are open, because later versions may add members. A schema whose objects have further
 * members now has `additionalProperties`. The documents are made once, at the start of the service,
 * because they take milliseconds. Any thread. */
#ifndef HEXAD_SERVICE_API_OPENAPI_H
#define HEXAD_SERVICE_API_OPENAPI_H

#include "service/api/constant_document.h"
#include "service/api/context.h"

typedef struct openapi {
    constant_document document, spec_schema;
} openapi;

openapi *openapi_new(void);
void openapi_free(openapi *o); /* accepts NULL */

http_handler openapi_show, openapi_show_schema;

#endif

/* openapi: the OpenAPI 3.1 document of the interface. It is made from the tables that also answer requests:
 * the routes (api/routes.h), the parameters (api/parameters.h), the problems (http/reply.h) and the job spec
 * (spec/schema.h). The schemas of answers are in openapi_schemas.json and examples of them in openapi_examples.json, both
 * compiled in; the tests compare every answer with them. Requests have closed schemas. Those of answers are open, since
 * later versions have more members; one that has further members today says so by `additionalProperties`. */
#ifndef HEXAD_API_OPENAPI_H
#define HEXAD_API_OPENAPI_H

#include "api/context.h"

http_handler openapi_show, openapi_show_schema;

json *openapi_new(void);

#endif

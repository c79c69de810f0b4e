/* openapi: the OpenAPI 3.1 document of the interface, made of the tables that requests are answered by: the routes
 * (api/routes.h), the parameters (api/parameters.h), the problems (http/reply.h) and the job's spec (spec/schema.h).
 * What answers look like is in openapi_schemas.json, which is compiled in; the tests compare every answer with it. */
#ifndef HEXAD_API_OPENAPI_H
#define HEXAD_API_OPENAPI_H

#include "api/context.h"

http_handler openapi_show;

json *openapi_new(void);

#endif

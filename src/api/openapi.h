/* openapi: the OpenAPI 3.1 document of the interface, made of the tables that requests are answered by: the routes
 * (api/routes.h), the parameters (api/parameters.h), the problems (http/reply.h) and the job's spec (spec/schema.h).
 * What answers look like is the table in openapi_schemas.c, which the tests hold every answer against. */
#ifndef HEXAD_API_OPENAPI_H
#define HEXAD_API_OPENAPI_H

#include "api/context.h"

http_handler openapi_show;

json *openapi_new(void);

typedef struct openapi_schema {
    const char *name;
    const char *text; /* JSON with ' for " */
} openapi_schema;

extern const openapi_schema openapi_schemas[];
extern const size_t openapi_schema_count;

#endif

/* parameter: the parameters of queries and paths: one table gives their checking and their place in the OpenAPI
 * document. Constant data; any thread. */
#ifndef HEXAD_HTTP_PARAMETER_H
#define HEXAD_HTTP_PARAMETER_H

#include <stdbool.h>
#include <stdint.h>

#include "http/handler.h"

/* Checks the query of a request against the names that its route takes ("state limit"): none unknown, none twice,
 * none with a value that it may not have. Answers what is wrong. */
bool parameter_check_query(const char *names, const http_request *request, reply *r);

/* The value of a query's parameter that was checked; `otherwise` when it is not given. */
const char *parameter_text(const http_request *request, const char *name, const char *otherwise);
int64_t parameter_integer(const http_request *request, const char *name, int64_t otherwise);

/* The OpenAPI object of a parameter; `in` is "query", "path" or "header". */
json *parameter_describe(const char *name, const char *in);

#endif

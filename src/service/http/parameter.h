// SPDX-License-Identifier: Apache-2.0
/* parameter: checks the parameters of queries and paths by a table, and describes them in the OpenAPI
 * document. Constant data; any thread.
 */
#ifndef HEXAD_SERVICE_HTTP_PARAMETER_H
#define HEXAD_SERVICE_HTTP_PARAMETER_H

#include <stdbool.h>
#include <stdint.h>

#include "service/http/handler.h"

typedef enum parameter_type {
    PARAMETER_TEXT,
    PARAMETER_INTEGER,
    PARAMETER_TIME, /* RFC 3339 */
    PARAMETER_WORD, /* one of a list of words */
    PARAMETER_WORDS /* one or more words of a list, separated by commas */
} parameter_type;

/* A row of the table. */
typedef struct parameter {
    const char *name;
    parameter_type type;
    int64_t low, high;                 /* range of a number, inclusive; of a text its length in bytes */
    const char *(*word)(size_t index); /* the word with this index; NULL after the last */
    /* of PARAMETER_WORDS: the schema of the OpenAPI document that lists them */
    const char *schema;
    /* for the message about a value that is not permitted, after the permitted values; NULL: none */
    const char *remark;
    const char *otherwise; /* the default of a number or a word; NULL: none */
    const char *pattern;   /* of a text, for the document; NULL: none */
    const char *example;   /* of a text, for the document; NULL: none */
    const char *prose;
} parameter;

typedef struct parameter_table {
    const parameter *row;
    size_t count;
} parameter_table;

/* Checks the query of a request against the names that the route accepts, such as "state limit" (NULL: none).
 * Each name must be known and given at most once, with a permitted value. Otherwise returns false and
 * fills the reply. */
bool parameter_check_query(const parameter_table *table, const char *names, const http_request *request,
                           reply *r);

/* The value of a checked query parameter; `otherwise` if it is not given. */
const char *parameter_text(const http_request *request, const char *name, const char *otherwise);
int64_t parameter_integer(const http_request *request, const char *name, int64_t otherwise);
/* Milliseconds since 1970; 0: not given. */
int64_t parameter_time(const http_request *request, const char *name);

/* The OpenAPI object of a parameter; `in` is "query", "path" or "header". */
json *parameter_describe(const parameter_table *table, const char *name, const char *in);

#endif

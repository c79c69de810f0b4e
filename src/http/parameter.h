/* parameter: the parameters of queries and paths. A table of them gives their checking and their description
 * in the OpenAPI document. Constant data; any thread. */
#ifndef HEXAD_HTTP_PARAMETER_H
#define HEXAD_HTTP_PARAMETER_H

#include <stdbool.h>
#include <stdint.h>

#include "http/handler.h"

typedef enum parameter_type {
    PARAMETER_TEXT,
    PARAMETER_INTEGER,
    PARAMETER_TIME, /* RFC 3339 */
    PARAMETER_WORD, /* one of a list of words */
    PARAMETER_WORDS /* one or more of them, with commas between them */
} parameter_type;

/* A row of the table. */
typedef struct parameter {
    const char *name;
    parameter_type type;
    int64_t low, high;                 /* of a number, inclusive; of a text its length in bytes */
    const char *(*word)(size_t index); /* of words: the index-th, NULL behind the last */
    const char *schema;                /* of PARAMETER_WORDS: where the OpenAPI document lists them */
    const char *otherwise;             /* the default of a number or a word; NULL: none */
    const char *pattern;               /* of a text, for the document; NULL: none */
    const char *example;               /* of a text, for the document; NULL: none */
    const char *prose;
} parameter;

typedef struct parameter_table {
    const parameter *row;
    size_t count;
} parameter_table;

/* Checks the query of a request against the names that its route takes ("state limit"; NULL: none): none
 * unknown, none twice, none with a value that it may not have. When one is wrong the reply says which. */
bool parameter_check_query(const parameter_table *table, const char *names, const http_request *request,
                           reply *r);

/* The value of a query's parameter that was checked; `otherwise` when it is not given. */
const char *parameter_text(const http_request *request, const char *name, const char *otherwise);
int64_t parameter_integer(const http_request *request, const char *name, int64_t otherwise);
int64_t parameter_time(const http_request *request,
                       const char *name); /* in milliseconds since 1970; 0: not given */

/* The OpenAPI object of a parameter; `in` is "query", "path" or "header". */
json *parameter_describe(const parameter_table *table, const char *name, const char *in);

#endif

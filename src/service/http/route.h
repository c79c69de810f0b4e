// SPDX-License-Identifier: Apache-2.0
/* route: finds the handler for a method and a path in a table of routes. The header Allow and the OpenAPI
 * document (service/api/openapi.h) are derived from the same table. Constant data; any thread.
 */
#ifndef HEXAD_SERVICE_HTTP_ROUTE_H
#define HEXAD_SERVICE_HTTP_ROUTE_H

#include <stdbool.h>

#include "service/http/handler.h"
#include "service/http/parameter.h"

#define ROUTE_PATH_BYTES 1024
/* The body of a PATCH may have this type, as well as application/json. */
#define ROUTE_MERGE_PATCH "application/merge-patch+json"

/* The thread that runs the handler of a route. Keepers, openers, their sinks and the copying of the bytes of
 * a stream always run in the serving thread. No call there may take more than .2 ms of processor time, since
 * it delays all clients; measurements/isolation/README.md has the times. */
typedef enum route_thread {
    ROUTE_UNDECLARED,     /* refused when the server starts */
    ROUTE_SERVING_THREAD, /* the handler only reads memory */
    ROUTE_POOL,           /* the handler may wait for a disk or run long */
    ROUTE_HEAVY_POOL,     /* the handler takes milliseconds of processor time; few run at the same time */
    ROUTE_PICTURE_POOL /* the handler waits for a process that decodes pictures; few run at the same time */
} route_thread;

/* A row of the table. Words of a list are separated by blanks; NULL is the empty list. */
typedef struct route {
    const char *method, *pattern;
    http_handler *handler;
    unsigned scope; /* the scope that a caller needs; 0: none */
    route_thread runs_in;
    bool streams;           /* the handler may answer with a source */
    http_keeper *kept;      /* of a route of a pool: answers from memory, without the pool; NULL: none */
    http_handler *awaiting; /* of a route with provisional answers */
    http_opener *opener;    /* of a route with a long body; NULL: none */
    const char *name;       /* of the operation in the OpenAPI document */
    const char *tag;        /* the group of the operation in documents of the interface */
    const char *summary;
    const char *query;   /* list: the parameters of the query */
    const char *headers; /* list: the headers that affect the answer */
    const char *body;    /* schema of the body, "file" for a long one; NULL: no body */
    const char *example; /* of the body; NULL: none */
    /* list of "STATUS:SCHEMA"; the schema "-" means no body, "file" and "text" mean a body that is not
     * JSON */
    const char *answers;
    const char *problems; /* list: codes, in addition to the codes that every route may return */
} route;

typedef struct route_table {
    const route *row;
    size_t count;
    const parameter_table *parameters; /* the parameters that the rows name */
} route_table;

typedef struct route_match {
    bool known;                                 /* the path exists, for at least one method */
    const route *found;                         /* NULL: the path does not have this method */
    char allow[48];                             /* for 405: "GET, HEAD" */
    char path[ROUTE_PATH_BYTES];                /* holds the parameters' text */
    const char *parameter[HTTP_MAX_PARAMETERS]; /* into `path` */
} route_match;

/* HEAD is treated as GET. A path that is too long is unknown. */
void route_find(const route_table *table, const char *method, const char *path, route_match *match);

#endif

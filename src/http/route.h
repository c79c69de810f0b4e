/* route: which handler answers a method and a path, by a table of routes. The header Allow and the OpenAPI
 * document (api/openapi.h) are made from the same table. Constant data; any thread. */
#ifndef HEXAD_HTTP_ROUTE_H
#define HEXAD_HTTP_ROUTE_H

#include <stdbool.h>

#include "http/handler.h"
#include "http/parameter.h"

#define ROUTE_PATH_BYTES 1024
/* The body of a PATCH may have this type, as well as application/json. */
#define ROUTE_MERGE_PATCH "application/merge-patch+json"

/* A row of the table. Lists have blanks between their words; NULL is the empty list. */
typedef struct route {
    const char *method, *pattern;
    http_handler *handler;
    unsigned scope;         /* that a caller must have; 0: open to all */
    bool waits;             /* the handler may wait for a disk or run long: a thread pool runs it */
    bool heavy;             /* the handler takes milliseconds of processor time: few run at once */
    bool draws;             /* the handler waits for a process that decodes pictures: few run at once */
    http_keeper *kept;      /* of a route with `waits`: answers from memory, without the pool; NULL: none */
    http_handler *awaiting; /* of a route whose answers may be provisional */
    http_opener *opener;    /* of a long body; NULL: it has none */
    const char *name;       /* of the operation in the OpenAPI document */
    const char *tag;        /* the group that documents of the interface show it in */
    const char *summary;
    const char *query;    /* list: the parameters of the query */
    const char *headers;  /* list: the headers that make a difference */
    const char *body;     /* schema of the body, "file" for a long one; NULL: it takes none */
    const char *example;  /* of the body; NULL: none */
    const char *answers;  /* list of "STATUS:SCHEMA"; the schema is "-" for none, "file" or "text" */
    const char *problems; /* list: codes, besides those that any route may answer */
} route;

typedef struct route_table {
    const route *row;
    size_t count;
    const parameter_table *parameters; /* that the rows name */
} route_table;

typedef struct route_match {
    bool known;                                 /* the path exists, for some method */
    const route *found;                         /* NULL: not for this method */
    char allow[48];                             /* for 405: "GET, HEAD" */
    char path[ROUTE_PATH_BYTES];                /* holds the parameters' text */
    const char *parameter[HTTP_MAX_PARAMETERS]; /* into `path` */
} route_match;

/* HEAD is handled as GET. A path that is too long is unknown. */
void route_find(const route_table *table, const char *method, const char *path, route_match *match);

#endif

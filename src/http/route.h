/* route: which handler answers a method and a path. One table, also of what Allow says. */
#ifndef HEXAD_HTTP_ROUTE_H
#define HEXAD_HTTP_ROUTE_H

#include <stdbool.h>

#include "http/handler.h"

#define ROUTE_PATH_BYTES 1024

/* A row of the table. */
typedef struct route {
    const char *method, *pattern;
    http_handler *handler;
    unsigned scope;      /* that a caller must have; 0: open to all */
    bool waits;          /* for a disk, or long: run by the crew */
    http_opener *opener; /* of a long body; NULL: it has none */
    const char *name, *summary;
    const char *query;    /* parameters, blanks between */
    const char *headers;  /* those that make a difference, blanks between */
    const char *body;     /* schema, "file" for a long one; NULL: it takes none */
    const char *example;  /* of the body; NULL: none */
    const char *answers;  /* "STATUS:SCHEMA ..."; the schema "-" for none, "file", "text" */
    const char *problems; /* codes, besides those that any route may answer */
} route;

const route *route_at(size_t index); /* NULL behind the last */

typedef struct route_match {
    bool known;                                 /* some method answers at this path */
    const route *found;                         /* NULL: not this method */
    char allow[48];                             /* for 405: "GET, HEAD" */
    char path[ROUTE_PATH_BYTES];                /* holds the parameters' text */
    const char *parameter[HTTP_MAX_PARAMETERS]; /* into `path` */
} route_match;

/* HEAD goes where GET goes. A path that is too long is not known. */
void route_find(const char *method, const char *path, route_match *match);

#endif

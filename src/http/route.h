/* route: which handler answers a method and a path. One table, also of what Allow says. */
#ifndef HEXAD_HTTP_ROUTE_H
#define HEXAD_HTTP_ROUTE_H

#include <stdbool.h>

#include "http/jobs.h"

#define ROUTE_PATH_BYTES 1024

typedef struct route_match {
    bool known;            /* some method answers at this path */
    jobs_handler *handler; /* NULL: not this method */
    bool takes_body;
    char allow[32];                             /* for 405: "GET, HEAD" */
    char path[ROUTE_PATH_BYTES];                /* holds the parameters' text */
    const char *parameter[JOBS_MAX_PARAMETERS]; /* into `path` */
} route_match;

/* HEAD goes where GET goes. A path that is too long is not known. */
void route_find(const char *method, const char *path, route_match *match);

#endif

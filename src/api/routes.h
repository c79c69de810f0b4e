/* routes: the routes of the service, one table. It gives what requests are answered by, Allow, and the
 * OpenAPI document. Constant data; any thread. */
#ifndef HEXAD_API_ROUTES_H
#define HEXAD_API_ROUTES_H

#include "http/route.h"

extern const route_table api_routes;

#endif

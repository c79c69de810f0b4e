// SPDX-License-Identifier: Apache-2.0
/* routes: the table of the routes of the service: handlers, scopes, parameters and answers. The server, the
 * header Allow and the OpenAPI document use it. Constant data; any thread. */
#ifndef HEXAD_SERVICE_API_ROUTES_H
#define HEXAD_SERVICE_API_ROUTES_H

#include "service/http/route.h"

extern const route_table api_routes;

#endif

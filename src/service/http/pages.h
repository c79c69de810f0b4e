// SPDX-License-Identifier: Apache-2.0
/* pages: decides which web pages may send requests to a port that requires no token.
 *
 * A page in a browser on this machine can send requests to a loopback port. It can even read the answers if
 * the name of its own host is made to resolve to this machine (DNS rebinding). The browser sends the
 * requested host in Host, and the page's origin in Origin and Sec-Fetch-Site. Requests for other hosts and
 * from other pages are refused. Constant data; any thread.
 */
#ifndef HEXAD_SERVICE_HTTP_PAGES_H
#define HEXAD_SERVICE_HTTP_PAGES_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"

typedef struct pages pages;

/* Pages of `origins` may send requests. Error spec_invalid names a text that is not an origin (scheme://host
 * or scheme://host:port). */
pages *pages_new(const char *const *origins, size_t count, error *e);
/* Adds an address of the service: `listen` as the setting names it, `served` the resulting address. */
void pages_add(pages *p, const char *listen, const char *served);
void pages_free(pages *p); /* accepts NULL */

/* Whether the value of Host is this service: the served address, localhost or a loopback address with its
 * port, or the host of a listed origin. */
bool pages_is_host(const pages *p, const char *host);

/* Whether pages of this origin may send requests: its host is this service, or the origin is listed. */
bool pages_is_permitted(const pages *p, const char *origin);

/* Whether the setting lists the origin. The answers then need headers that let its pages read them. */
bool pages_is_listed(const pages *p, const char *origin);
bool pages_has_listed(const pages *p);

#endif

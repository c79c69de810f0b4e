/* pages: which web pages may send requests to a port that asks for no token.
 *
 * A page that is open in a browser on this machine can send requests to a loopback port, and read the answers when the
 * name of its own host is made to lead to this machine. The browser says in Host which name it asked for and in Origin
 * and Sec-Fetch-Site whose page asks. Requests for another host and of other pages are refused. Constant data; any
 * thread.
 */
#ifndef HEXAD_HTTP_PAGES_H
#define HEXAD_HTTP_PAGES_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"

typedef struct pages pages;

/* `listen` is the setting, `served` the address that came of it; `origins` are those of further pages that may ask. An
 * error (spec_invalid) that names what is no origin: scheme://host, or with :port. */
pages *pages_new(const char *listen, const char *served, const char *const *origins, size_t count, error *e);
void pages_free(pages *p); /* accepts NULL */

/* Whether the value of Host is this service's: the address that it serves, with localhost or a loopback address for
 * the host, or the host of a named origin. */
bool pages_is_host(const pages *p, const char *host);

/* Whether a page of the origin may ask: one of this service's hosts, or a named one. */
bool pages_is_welcome(const pages *p, const char *origin);

/* Whether the setting names the origin, so that the browser is to be told that its pages may read answers. */
bool pages_is_named(const pages *p, const char *origin);
bool pages_has_named(const pages *p);

#endif

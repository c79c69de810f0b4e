// SPDX-License-Identifier: Apache-2.0
/* forwarded: finds the client of a request behind proxies, from the header Forwarded (RFC 7239).
 *
 * Each proxy appends the address that sent it the request. The header is read from its right end, as far as
 * trusted proxies wrote it. The first address that is not a trusted proxy is the client. Elements further
 * left are claims of the client and are ignored.
 */
#ifndef HEXAD_SERVICE_HTTP_FORWARDED_H
#define HEXAD_SERVICE_HTTP_FORWARDED_H

#include "service/http/address.h"

/* Returns the client of a request that arrived from `peer`. `values` are the values of the headers Forwarded
 * in their order. The client is the peer if the peer is not a trusted proxy, if there are no values, or if a
 * value is malformed. If a trusted proxy gives no address ("unknown", "_name"), the client is this proxy. */
address forwarded_client(const address *peer, const address_ranges *trusted, const char *const *values,
                         size_t count);

#endif

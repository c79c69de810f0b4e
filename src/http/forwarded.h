/* forwarded: the client behind proxies, as the header Forwarded (RFC 7239) tells.
 *
 * Each proxy appends from whom it had the request, so the header is read from its right end, and only as far
 * as trusted proxies wrote it: the first address that is none of theirs is the client. What stands further left is the
 * client's own word and is not looked at.
 */
#ifndef HEXAD_HTTP_FORWARDED_H
#define HEXAD_HTTP_FORWARDED_H

#include "http/address.h"

/* The client of a request that came from `peer`, in whose headers Forwarded has these values, in their order. It is
 * the peer itself when that is no trusted proxy, when there are no values, and when one of them is not as the RFC
 * says. Where a trusted proxy does not tell an address ("unknown", "_name"), it is that proxy. */
address forwarded_client(const address *peer, const address_ranges *trusted, const char *const *values,
                         size_t count);

#endif

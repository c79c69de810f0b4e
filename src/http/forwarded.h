/* forwarded: the client behind proxies, from the header Forwarded (RFC 7239).
 *
 * Each proxy appends the address from which it got the request. So the header is read from its right end, and
 * only as far as trusted proxies wrote it: the first address that is not a trusted proxy is the client. The
 * rest, further left, is what the client itself claims, and is ignored.
 */
#ifndef HEXAD_HTTP_FORWARDED_H
#define HEXAD_HTTP_FORWARDED_H

#include "http/address.h"

/* Returns the client of a request that arrived from `peer`; `values` are those of the headers Forwarded, in
 * their order. The client is the peer when the peer is not a trusted proxy, when there are no values, or when
 * one is malformed. When a trusted proxy names no address ("unknown", "_name"), that proxy counts as the
 * client. */
address forwarded_client(const address *peer, const address_ranges *trusted, const char *const *values,
                         size_t count);

#endif

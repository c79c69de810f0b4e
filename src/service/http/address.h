// SPDX-License-Identifier: Apache-2.0
/* address: network addresses of clients, and ranges of addresses. Constant data; any thread. */
#ifndef HEXAD_SERVICE_HTTP_ADDRESS_H
#define HEXAD_SERVICE_HTTP_ADDRESS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"

#define ADDRESS_TEXT_SIZE 46

/* A version 4 address uses the first 4 bytes. A mapped address (::ffff:192.0.2.1) is converted to version
 * 4. */
typedef struct address {
    uint8_t version; /* 4 or 6; 0: none */
    uint8_t bytes[16];
} address;

/* The remote address of a connected socket; version 0 if it is not a TCP socket. */
address address_of_peer(int fd);

/* Parses "192.0.2.1" or "2001:db8::1", without brackets and port. False, with *a unchanged, for any other
 * text. */
bool address_parse(const char *text, address *a);

/* Writes the address to `text` and returns it; "-" for version 0. */
const char *address_print(const address *a, char text[ADDRESS_TEXT_SIZE]);

typedef struct address_range {
    address base;
    unsigned bits; /* length of the prefix */
} address_range;

typedef struct address_ranges {
    address_range *item;
    size_t count;
} address_ranges;

/* Parses texts such as "192.0.2.1", "10.0.0.0/8" or "2001:db8::/32". Error spec_invalid, with the text that
 * has another form. The caller releases the ranges with address_ranges_clear, also after an error. */
bool address_ranges_read(const char *const *text, size_t count, address_ranges *r, error *e);
void address_ranges_clear(address_ranges *r);
bool address_ranges_hold(const address_ranges *r, const address *a);

#endif

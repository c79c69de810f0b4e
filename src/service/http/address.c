// SPDX-License-Identifier: Apache-2.0
#include "service/http/address.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#include "base/core/memory.h"

static address of_v6(const struct in6_addr *v6)
{
    address a = {.version = 6};
    if (IN6_IS_ADDR_V4MAPPED(v6)) {
        a.version = 4;
        memcpy(a.bytes, v6->s6_addr + 12, 4);
    } else {
        memcpy(a.bytes, v6->s6_addr, 16);
    }
    return a;
}

static address of_v4(const struct in_addr *v4)
{
    address a = {.version = 4};
    memcpy(a.bytes, v4, 4);
    return a;
}

address address_of_peer(int fd)
{
    union {
        struct sockaddr any;
        struct sockaddr_in v4;
        struct sockaddr_in6 v6;
        struct sockaddr_storage storage;
    } from = {0};
    socklen_t size = sizeof from;
    if (getpeername(fd, &from.any, &size) != 0) return (address){0};
    if (from.any.sa_family == AF_INET) return of_v4(&from.v4.sin_addr);
    return from.any.sa_family == AF_INET6 ? of_v6(&from.v6.sin6_addr) : (address){0};
}

bool address_parse(const char *text, address *a)
{
    struct in_addr v4;
    struct in6_addr v6;
    if (inet_pton(AF_INET, text, &v4) == 1)
        *a = of_v4(&v4);
    else if (inet_pton(AF_INET6, text, &v6) == 1)
        *a = of_v6(&v6);
    else
        return false;
    return true;
}

const char *address_print(const address *a, char text[ADDRESS_TEXT_SIZE])
{
    if (!a->version || !inet_ntop(a->version == 4 ? AF_INET : AF_INET6, a->bytes, text, ADDRESS_TEXT_SIZE))
        strcpy(text, "-");
    return text;
}

static bool read_range(const char *text, address_range *r)
{
    char base[ADDRESS_TEXT_SIZE], *end = NULL;
    size_t length = strcspn(text, "/");
    if (length >= sizeof base) return false;
    snprintf(base, sizeof base, "%.*s", (int)length, text);
    if (!address_parse(base, &r->base)) return false;
    unsigned most = r->base.version == 4 ? 32 : 128;
    r->bits = most;
    if (!text[length]) return true;
    const char *bits = text + length + 1;
    if (!*bits || strspn(bits, "0123456789") != strlen(bits)) return false;
    unsigned long number = strtoul(bits, &end, 10);
    r->bits = number <= most ? (unsigned)number : 0;
    return number <= most;
}

bool address_ranges_read(const char *const *text, size_t count, address_ranges *r, error *e)
{
    r->item = mem_alloc(count * sizeof *r->item);
    for (r->count = 0; r->count < count; r->count++)
        if (!read_range(text[r->count], &r->item[r->count]))
            return error_set(e, ERROR_SPEC_INVALID,
                             "must be an address or a range of addresses, such as 10.0.0.0/8 (given %s)",
                             text[r->count]);
    return true;
}

void address_ranges_clear(address_ranges *r)
{
    free(r->item);
    *r = (address_ranges){0};
}

static bool is_in(const address_range *r, const address *a)
{
    unsigned whole = r->bits / 8, rest = r->bits % 8;
    if (r->base.version != a->version || memcmp(r->base.bytes, a->bytes, whole) != 0) return false;
    return !rest || (r->base.bytes[whole] ^ a->bytes[whole]) >> (8 - rest) == 0;
}

bool address_ranges_hold(const address_ranges *r, const address *a)
{
    for (size_t i = 0; i < r->count; i++)
        if (is_in(&r->item[i], a)) return true;
    return false;
}

// SPDX-License-Identifier: Apache-2.0
/* fields: the headers of a request that the server itself reads. The serving thread calls all functions. */
#ifndef HEXAD_SERVICE_HTTP_FIELDS_H
#define HEXAD_SERVICE_HTTP_FIELDS_H

#include <stdbool.h>
#include <stddef.h>

struct MHD_Connection;

/* Maximum number of Forwarded headers. Each proxy extends a header or adds one. */
#define FIELDS_MOST_FORWARDED 16

/* The texts remain valid as long as the request. NULL: not sent. A header without a value is "" if an empty
 * header differs from a missing one. */
typedef struct fields {
    int lengths, codings, authorizations, hosts, origins; /* number of times that each was sent */
    bool coded;                                           /* Content-Encoding names a coding */
    bool chunked;
    const char *length, *authorization, *host, *origin;
    const char *site, *destination; /* Sec-Fetch-Site and Sec-Fetch-Dest, which browsers send */
    const char *forwarded[FIELDS_MOST_FORWARDED];
    size_t forwarded_count; /* may exceed the array; then no header is trusted */
} fields;

fields fields_read(struct MHD_Connection *connection);

/* Whether the value of Content-Type is this media type, with or without parameters; `type` may be NULL. */
bool fields_is_media_type(const char *type, const char *wanted);

#endif

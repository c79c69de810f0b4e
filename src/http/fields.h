/* fields: the headers of a request that the server itself reads. The serving thread calls all functions. */
#ifndef HEXAD_HTTP_FIELDS_H
#define HEXAD_HTTP_FIELDS_H

#include <stdbool.h>
#include <stddef.h>

struct MHD_Connection;

/* The number of Forwarded headers; each proxy extends one or adds one. */
#define FIELDS_MOST_FORWARDED 16

/* The texts live as long as the request; NULL: not sent, except that a header without a value is "" where an empty
 * one counts. */
typedef struct fields {
    int lengths, codings, authorizations, hosts, origins; /* how often each was sent */
    bool coded;                                           /* Content-Encoding names one */
    bool chunked;
    const char *length, *authorization, *host, *origin;
    const char *site, *destination; /* Sec-Fetch-Site, Sec-Fetch-Dest: what browsers say of a request */
    const char *forwarded[FIELDS_MOST_FORWARDED];
    size_t forwarded_count; /* may exceed the array; then none is trusted */
} fields;

fields fields_read(struct MHD_Connection *connection);

/* Whether the value of Content-Type is this media type, perhaps with parameters; `type` may be NULL. */
bool fields_is_media_type(const char *type, const char *wanted);

#endif

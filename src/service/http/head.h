// SPDX-License-Identifier: Apache-2.0
/* head: checks the request line and the headers of a request against the received bytes: framing and repeated
 * fields.
 *
 * The library (0.9.75) accepts lines that end with LF alone, headers over several lines, blanks before a
 * colon, and texts that end at a NUL. A proxy may interpret such bytes differently and take two requests for
 * one. The library leaves the received bytes in place and replaces CR and LF by NUL. The positions of the
 * names and values therefore show the bytes between them. One case is ambiguous: NUL and LF at the end of a
 * line look like CR and LF. Version 1.0 of the library does not leave the bytes in place. In its strict mode
 * (service/http/server) it refuses all these cases, with an answer in HTML.
 *
 * The serving thread calls all functions.
 */
#ifndef HEXAD_SERVICE_HTTP_HEAD_H
#define HEXAD_SERVICE_HTTP_HEAD_H

#include <stdbool.h>
#include <string.h>

#include "service/http/reply.h"

struct MHD_Connection;

/* Whether a byte may be part of a token (RFC 9110, 5.6.2), such as the name of a header. */
static inline bool head_is_token_byte(char byte)
{
    return (byte >= 'a' && byte <= 'z') || (byte >= 'A' && byte <= 'Z') || (byte >= '0' && byte <= '9') ||
           byte == '-' || (byte && strchr("!#$%&'*+.^_`|~", byte));
}

/* The path and query of a request line after it has arrived. No header has been read yet. */
typedef struct head_target {
    const char *start, *end;
    bool plain;                   /* without blanks and control bytes */
    bool has_too_many_parameters; /* more than HTTP_MAX_QUERY parameters */
} head_target;

/* Reads the request line. `uri` is the text that the library passes to MHD_OPTION_URI_LOG_CALLBACK. A query
 * with too many parameters is discarded: the library allocates memory for each parameter and stops answering
 * if there is none. */
head_target head_look(const char *uri);

/* Refuses a head that the library refuses without calling a handler. These are a head with a Content-Length
 * that is not a number of bytes, and a head whose cookies do not fit into the library's memory for headers.
 * The caller has noticed that the library logged a message. True if *r was filled with the refusal. False if
 * the head has not arrived or has no such fault. */
bool head_refuse_unread(struct MHD_Connection *connection, reply *r);

/* Call it when all headers have arrived. Refuses a head that does not consist of NAME: VALUE lines that end
 * with CR LF. `method` and `version` are the library's own texts. True if *r was filled with the refusal. */
bool head_refuse(struct MHD_Connection *connection, const char *method, const char *version,
                 const head_target *target, reply *r);

#endif

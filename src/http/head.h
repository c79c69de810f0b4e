/* head: our own check of the request line and headers of a request against the bytes that came: framing, repeated fields.
 *
 * The library (0.9.75) takes lines that end with LF alone, headers over several lines, blanks before a colon,
 * and texts that end at a NUL. A proxy in front may read such bytes otherwise, and take for one request what
 * are two here. The library leaves the bytes where they came and puts NUL in place of CR and LF, so the places
 * of the names and values show what was between them. One case is ambiguous: NUL and LF at the end of
 * a line look like CR and LF. Version 1.0 of the library leaves the bytes otherwise. It refuses all this itself,
 * with an answer in HTML, when its strict mode is set (http/server).
 *
 * The serving thread calls all functions.
 */
#ifndef HEXAD_HTTP_HEAD_H
#define HEXAD_HTTP_HEAD_H

#include <stdbool.h>
#include <string.h>

#include "http/reply.h"

struct MHD_Connection;

/* Whether a byte may be part of a token (RFC 9110, 5.6.2), as names of headers are. */
static inline bool head_is_token_byte(char byte)
{
    return (byte >= 'a' && byte <= 'z') || (byte >= 'A' && byte <= 'Z') || (byte >= '0' && byte <= '9') ||
           byte == '-' || (byte && strchr("!#$%&'*+.^_`|~", byte));
}

/* The path and query of a request line, when it has arrived; no header has been read then. */
typedef struct head_target {
    const char *start, *end;
    bool plain;   /* without blanks and control bytes */
    bool crowded; /* more than HTTP_MAX_QUERY parameters */
} head_target;

/* `uri` is what the library passes to MHD_OPTION_URI_LOG_CALLBACK. A query with too many parameters is discarded: the
 * library would take memory for each parameter, and answers no more when it has none. */
head_target head_look(const char *uri);

/* Refuses a head that the library refuses by itself, before a handler is called: one with a Content-Length that is not a number of
 * bytes, and one whose cookies have no room beside it. The function checks the header fields that came; the caller has seen
 * that the library reports something. False when the head has not arrived, or has no such fault. True when *r says what is
 * wrong. */
bool head_refuse_unread(struct MHD_Connection *connection, reply *r);

/* When all headers have arrived: refuses a head that is not NAME: VALUE with CR LF after each line. `method`
 * and `version` are the library's own. True when *r says what is wrong. */
bool head_refuse(struct MHD_Connection *connection, const char *method, const char *version,
                 const head_target *target, reply *r);

#endif

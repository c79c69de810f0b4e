/* reply: what a handler answers, apart from how it is sent; and the problem documents (RFC 9457).
 *
 * A problem is `application/problem+json` with type, title, status, detail, the stable `code`, and
 * `errors`, an array of {pointer, detail} where the pointer (RFC 6901) leads into the request body.
 * Codes: those of the job contract (base/error.h) and the ones below. The table in reply.c gives
 * each its status and title.
 *
 *     json_invalid 400            the body is not one JSON value
 *     request_invalid 400         framing, or a query parameter
 *     not_found 404               no such job, file or path
 *     method_not_allowed 405      Allow says which are
 *     conflict 409                the job's state does not admit it
 *     body_too_large 413          over body_limit_bytes
 *     media_type_unsupported 415  a body that is not application/json
 *     unavailable 503             draining, or the queue cannot store; Retry-After says when to come again
 */
#ifndef HEXAD_HTTP_REPLY_H
#define HEXAD_HTTP_REPLY_H

#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "json/json.h"

#define REPLY_MAX_HEADERS 4

typedef struct reply {
    int status;
    const char *content_type;
    char *body; /* NULL: the file */
    size_t length;
    int fd; /* -1: the body */
    int64_t fd_bytes;
    size_t header_count;
    struct {
        const char *name; /* a constant */
        char *value;
    } header[REPLY_MAX_HEADERS];
} reply;

void reply_clear(reply *r); /* frees and closes what it holds; accepts an empty one with fd -1 */

/* At most REPLY_MAX_HEADERS of them. */
void reply_add_header(reply *r, const char *name, const char *value);

/* Takes the document over. */
void reply_set_json(reply *r, int status, json *document);

/* Takes the descriptor over. `content_type` is a constant. */
void reply_set_file(reply *r, const char *content_type, int fd, int64_t bytes);

/* `code` is one of the table; `errors` is an array that is taken over, or NULL. */
void reply_set_problem(reply *r, const char *code, json *errors, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
void reply_set_error(reply *r, const error *e, json *errors);

#endif

/* reply: the answer of a handler, independent of how it is sent; and the problem documents (RFC 9457).
 *
 * A problem is `application/problem+json` with type, title, status, detail, the stable `code`, and `errors`,
 * an array of {pointer, detail} where the pointer (RFC 6901) leads into the request body. The codes are those
 * of jobs (base/error.h) and the ones below. The table in reply.c has the status and the title of each.
 *
 *     json_invalid 400            the body is not a JSON value
 *     request_invalid 400         the framing of the request, a header or a query parameter is wrong
 *     unauthorized 401            the caller or the token is unknown; with WWW-Authenticate
 *     forbidden 403               the caller lacks the scope
 *     origin_forbidden 403        page_origins does not list the page, on a port without tokens
 *     not_found 404               the job, file or path does not exist
 *     method_not_allowed 405      Allow lists the allowed ones
 *     conflict 409                the state of the job does not allow it
 *     precondition_failed 412     If-Match names another revision
 *     body_too_large 413          longer than body_limit_bytes; of an input, than upload_limit_bytes
 *     media_type_unsupported 415  the body is not application/json, or is compressed
 *     range_not_satisfiable 416   the range begins beyond the end; Content-Range has the length
 *     misdirected_request 421     Host names another host, on a port without tokens
 *     idempotency_mismatch 422    the Idempotency-Key was used with another body
 *     digest_mismatch 422         the bytes of an input do not have the announced hash
 *     storage_full 507            the disk is full, with Retry-After; or there is no room for an input, without
 *     results_full 507            results have met a bound, and none may be deleted; with Retry-After
 *     too_many_jobs 429           of one user; with Retry-After
 *     too_many_submissions 429    of one user in an hour; with Retry-After
 *     priority_forbidden 403      user_priorities or the token allows less
 *     too_many_requests 429       too many connections of one client or user, or too much memory for bodies or answers of one user;
 *                                 with Retry-After
 *     database_damaged 503        nothing can be changed until an operator has repaired it
 *     unavailable 503             draining, the queue cannot store, or too many connections in all; with Retry-After. Or no
 *                                 file is looked into; with Retry-After when others are being looked into
 */
#ifndef HEXAD_HTTP_REPLY_H
#define HEXAD_HTTP_REPLY_H

#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#include "base/error.h"
#include "json/json.h"

#define REPLY_MAX_HEADERS 8

typedef struct reply_problem {
    const char *code;
    int status;
    const char *title;
} reply_problem;

/* The rows of the table by index, NULL after the last; and by code, the row `internal` for an unlisted code. */
const reply_problem *reply_problem_at(size_t index);
const reply_problem *reply_find_problem(const char *code);

/* The title of a code of an answer or of a job. */
const char *reply_title(const char *code);

/* A body that is produced while it is sent. The serving thread calls it, one call at a time. */
typedef struct reply_source {
    /* Writes up to `size` bytes and returns their number; 0: nothing yet; -1: the end. */
    ssize_t (*read)(struct reply_source *source, char *buffer, size_t size);
    void (*free)(struct reply_source *source);
} reply_source;

/* Notifies the creator of an answer of its end. */
typedef struct reply_receipt {
    /* Called once. `sent`: the client was sent the whole answer, with its body. The serving thread calls it. */
    void (*end)(struct reply_receipt *receipt, bool sent);
} reply_receipt;

#define REPLY_TOPIC_SIZE 32

typedef struct reply {
    /* 0: no answer yet; the handler is called again when the topic is woken, or at `again_ms`. Only of a route with `waits`. */
    int status;
    const char *content_type;  /* a constant; NULL: none */
    const char *cache_control; /* a constant; NULL: caches must not store it */
    char *body;                /* NULL: the file */
    size_t length;
    int fd; /* -1: the body */
    int64_t fd_offset, fd_bytes;
    reply_source *source;         /* NULL: body or file */
    reply_receipt *receipt;       /* NULL: none */
    char topic[REPLY_TOPIC_SIZE]; /* of a source or a waiting answer: what it waits for; "": anything */
    int64_t again_ms;             /* monotonic */
    /* A whole answer that waits as well: the route's `awaiting` replaces it by a later one, or clears this member. */
    bool provisional;
    size_t header_count;
    struct {
        const char *name; /* a constant */
        char *value;
    } header[REPLY_MAX_HEADERS];
} reply;

void reply_clear(reply *r); /* frees and closes its contents; accepts an empty one with fd -1 */

/* At most REPLY_MAX_HEADERS of them. */
void reply_add_header(reply *r, const char *name, const char *value);

/* Takes the document over. */
void reply_set_json(reply *r, int status, json *document);

/* Takes the text over. `content_type` is a constant. */
void reply_set_text(reply *r, const char *content_type, char *text);

/* Takes the source over. `content_type` is a constant. */
void reply_set_source(reply *r, const char *content_type, const char *topic, reply_source *source);

/* The answer waits for the topic, until that time. */
void reply_set_waiting(reply *r, const char *topic, int64_t again_ms);

void reply_set_empty(reply *r, int status);

/* Takes the descriptor over. `content_type` is a constant. */
void reply_set_file(reply *r, const char *content_type, int fd, int64_t bytes);

/* Appends a fault to the `errors` of a problem: where (a JSON Pointer) and what. */
void reply_append_fault(json *errors, const char *pointer, const char *detail);

/* `code` is one of the table; `errors` is an array that is taken over, or NULL. */
void reply_set_problem(reply *r, const char *code, json *errors, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
/* Adds a member to the document that was set. Takes the value over. */
void reply_add_member(reply *r, const char *name, json *value);
/* Adds Retry-After with a second: what is missing is there soon. */
void reply_ask_again(reply *r);
/* `unavailable`, with Retry-After. */
void reply_set_unavailable(reply *r, const char *why);
/* `storage_full`, with Retry-After. */
void reply_set_storage_full(reply *r, const char *why);
void reply_set_error(reply *r, const error *e, json *errors);

#endif

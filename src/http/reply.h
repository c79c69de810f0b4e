/* reply: what a handler answers, apart from how it is sent; and the problem documents (RFC 9457).
 *
 * A problem is `application/problem+json` with type, title, status, detail, the stable `code`, and
 * `errors`, an array of {pointer, detail} where the pointer (RFC 6901) leads into the request body.
 * Codes: those of the job contract (base/error.h) and the ones below. The table in reply.c gives
 * each its status and title.
 *
 *     json_invalid 400            the body is not one JSON value
 *     request_invalid 400         framing, or a query parameter
 *     unauthorized 401            a stranger, or a token that is not known; WWW-Authenticate
 *     forbidden 403               the caller has not the scope
 *     origin_forbidden 403        a page that page_origins does not name, on a port without tokens
 *     not_found 404               no such job, file or path
 *     method_not_allowed 405      Allow says which are
 *     conflict 409                the job's state does not admit it
 *     precondition_failed 412     If-Match names another revision
 *     body_too_large 413          over body_limit_bytes; of an input, over upload_limit_bytes
 *     media_type_unsupported 415  a body that is not application/json
 *     range_not_satisfiable 416   the range begins behind the end; Content-Range says where that is
 *     misdirected_request 421     the Host of another, on a port without tokens
 *     idempotency_mismatch 422    an Idempotency-Key that came with another body
 *     digest_mismatch 422         an input of which other bytes came
 *     storage_full 507            no room on the disk, or for an input; Retry-After but for the latter
 *     too_many_jobs 429           of one user; Retry-After
 *     too_many_requests 429       too many connections of one client or user; Retry-After
 *     database_damaged 503        nothing is changed any more until an operator has seen to it
 *     unavailable 503             draining, the queue cannot store, or too many connections of all; Retry-After
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

/* The table's rows, NULL behind the last; and that of a code, `internal` for one that is not listed. */
const reply_problem *reply_problem_at(size_t index);
const reply_problem *reply_find_problem(const char *code);

/* What is sent while it comes to be. Called by the serving thread, one call at a time. */
typedef struct reply_source {
    /* Writes up to `size` bytes and returns how many; 0: there is nothing at the moment; -1: that was all. */
    ssize_t (*read)(struct reply_source *source, char *buffer, size_t size);
    void (*free)(struct reply_source *source);
} reply_source;

#define REPLY_TOPIC_SIZE 32

typedef struct reply {
    int status; /* 0: not yet, ask the handler again when the topic is woken, or at `again_ms` */
    const char *content_type;  /* a constant; NULL: none */
    const char *cache_control; /* a constant; NULL: it is not to be stored */
    char *body;                /* NULL: the file */
    size_t length;
    int fd; /* -1: the body */
    int64_t fd_offset, fd_bytes;
    reply_source *source;         /* NULL: body or file */
    char topic[REPLY_TOPIC_SIZE]; /* of a source, or of an answer that waits: what wakes it; "": anything */
    int64_t again_ms;             /* monotonic */
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

/* Takes the text over. `content_type` is a constant. */
void reply_set_text(reply *r, const char *content_type, char *text);

/* Takes the source over. `content_type` is a constant. */
void reply_set_source(reply *r, const char *content_type, const char *topic, reply_source *source);

/* The answer has to wait for the topic, until the time. */
void reply_set_waiting(reply *r, const char *topic, int64_t again_ms);

void reply_set_empty(reply *r, int status);

/* Takes the descriptor over. `content_type` is a constant. */
void reply_set_file(reply *r, const char *content_type, int fd, int64_t bytes);

/* Appends a fault to the `errors` of a problem: where (a JSON Pointer) and what. */
void reply_append_fault(json *errors, const char *pointer, const char *detail);

/* `code` is one of the table; `errors` is an array that is taken over, or NULL. */
void reply_set_problem(reply *r, const char *code, json *errors, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
/* To a document that was set. Takes the value over. */
void reply_add_member(reply *r, const char *name, json *value);
/* `unavailable`, with Retry-After. */
void reply_set_unavailable(reply *r, const char *why);
/* `storage_full`, with Retry-After. */
void reply_set_storage_full(reply *r, const char *why);
void reply_set_error(reply *r, const error *e, json *errors);

#endif

// SPDX-License-Identifier: Apache-2.0
/* reply: the answer of a handler, independent of the transport, and problem documents (RFC 9457).
 *
 * A problem is `application/problem+json` with type, title, status, detail, the stable `code`, and `errors`.
 * `errors` is an array of {pointer, detail}; the pointer (RFC 6901) refers to the request body. The codes are
 * those of jobs (base/core/error.h) and the following ones. The table in reply.c has the status and the title
 * of each code.
 *
 *     json_invalid 400            the body is not a JSON value
 *     request_invalid 400         the framing of the request, a header or a query parameter is wrong
 *     unauthorized 401            the caller or the token is unknown; with WWW-Authenticate
 *     forbidden 403               the caller lacks the scope
 *     origin_forbidden 403        page_origins does not list the page, on a port without tokens
 *     not_found 404               the job, file or path does not exist
 *     method_not_allowed 405      Allow lists the allowed methods
 *     conflict 409                the state of the job does not allow it
 *     gone 410                    the route was removed; the detail names another one
 *     precondition_failed 412     If-Match names another revision
 *     body_too_large 413          longer than body_limit_bytes; for an input, longer than upload_limit_bytes
 *     media_type_unsupported 415  the body is not application/json, or is compressed
 *     range_not_satisfiable 416   the range begins beyond the end; Content-Range has the length
 *     misdirected_request 421     Host names another host, on a port without tokens
 *     idempotency_mismatch 422    the Idempotency-Key was used with another body
 *     digest_mismatch 422         the bytes of an input do not have the announced hash
 *     storage_full 507            the disk is full, with Retry-After; or no space for an input, without
 *                                 Retry-After
 *     results_full 507            results have reached a limit, and none may be deleted; with Retry-After
 *     too_many_jobs 429           of one user; with Retry-After
 *     too_many_tasks 429          of one user; with Retry-After
 *     too_many_submissions 429    of one user in an hour; with Retry-After
 *     priority_forbidden 403      user_priorities or the token permits only lower priorities
 *     too_many_requests 429       too many connections of one client or user, or too much memory for bodies
 *                                 or answers of one user; with Retry-After
 *     database_damaged 503        changes are impossible until an operator has repaired the database
 *     state_lost 503              changes are impossible until the state directory is at its path again
 *     unavailable 503             draining, the queue cannot store, or too many connections in total; with
 *                                 Retry-After. Or input files are not checked; with Retry-After if all checks
 *                                 are busy
 */
#ifndef HEXAD_SERVICE_HTTP_REPLY_H
#define HEXAD_SERVICE_HTTP_REPLY_H

#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#include "base/core/error.h"
#include "base/json/json.h"
#include "service/ledger/ledger.h"

#define REPLY_MAX_HEADERS 8

typedef struct reply_problem {
    const char *code;
    int status;
    const char *title;
} reply_problem;

/* reply_problem_at: the rows of the table by index, NULL after the last. reply_find_problem: the row of a
 * code; the row `internal` for an unlisted code. */
const reply_problem *reply_problem_at(size_t index);
const reply_problem *reply_find_problem(const char *code);

/* The title of a code of an answer or of a job. */
const char *reply_title(const char *code);

/* A body that is produced while it is sent, piece by piece. The calls come one at a time. */
typedef struct reply_source {
    /* Produces the next piece and returns the number of its bytes; 0: nothing yet; -1: the end. The piece is
     * valid until the next call. A pool of threads makes the call. */
    ssize_t (*produce)(struct reply_source *source, const char **piece);
    void (*free)(struct reply_source *source); /* by the serving thread */
} reply_source;

/* Notifies the creator of an answer of its end. */
typedef struct reply_receipt {
    /* Called once, by any thread. `sent`: the whole answer, with its body, was sent to the client. */
    void (*end)(struct reply_receipt *receipt, bool sent);
} reply_receipt;

#define REPLY_TOPIC_SIZE 32

typedef struct reply {
    /* 0: no answer yet; the handler is called again when the topic is woken, or at `again_ms`. Only for a
     * route of a pool. */
    int status;
    const char *content_type;  /* a constant; NULL: none */
    const char *cache_control; /* a constant; NULL: caches must not store it */
    char *body;                /* NULL: the constant bytes, or the file */
    const char *constant;      /* bytes that outlive the server; NULL: the file */
    size_t length;             /* of body or constant */
    int fd;                    /* -1: the body */
    int64_t fd_offset, fd_bytes;
    reply_source *source;   /* NULL: body, constant or file */
    reply_receipt *receipt; /* NULL: none */
    /* of a source or a waiting answer: the topic that it waits for; "": any topic */
    char topic[REPLY_TOPIC_SIZE];
    int64_t again_ms; /* monotonic */
    /* A complete answer that waits as well. The route's `awaiting` replaces it by a later answer, or clears
     * this member. */
    bool provisional;
    size_t header_count;
    struct {
        const char *name; /* a constant */
        char *value;
    } header[REPLY_MAX_HEADERS];
} reply;

void reply_clear(reply *r); /* frees and closes the contents; accepts an empty reply with fd -1 */

/* At most REPLY_MAX_HEADERS headers. */
void reply_add_header(reply *r, const char *name, const char *value);

/* Takes over the document. */
void reply_set_json(reply *r, int status, json *document);

/* Takes over the text. `content_type` is a constant. */
void reply_set_text(reply *r, const char *content_type, char *text);

/* Sets bytes that outlive the server and are not copied. `content_type` is a constant. */
void reply_set_constant(reply *r, const char *content_type, const char *bytes, size_t length);

/* Takes over the source. `content_type` is a constant. */
void reply_set_source(reply *r, const char *content_type, const char *topic, reply_source *source);

/* Makes the answer wait for the topic until the time `again_ms`. */
void reply_set_waiting(reply *r, const char *topic, int64_t again_ms);

void reply_set_empty(reply *r, int status);

/* Takes over the descriptor. `content_type` is a constant. */
void reply_set_file(reply *r, const char *content_type, int fd, int64_t bytes);

/* Appends a fault to the `errors` of a problem: its position (a JSON Pointer) and its description. */
void reply_append_fault(json *errors, const char *pointer, const char *detail);

/* Sets a problem. `code` is a code of the table. `errors` is an array, which is taken over, or NULL. */
void reply_set_problem(reply *r, const char *code, json *errors, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
/* Adds a member to the document that was set. Takes over the value. */
void reply_add_member(reply *r, const char *name, json *value);
/* Adds Retry-After of a second, for a shortage that ends soon. */
void reply_ask_again(reply *r);
/* Sets the problem of a limit that is reached, with Retry-After if a repetition may succeed. */
void reply_set_refusal(reply *r, ledger_refusal why);
/* Sets the problem `unavailable`, with Retry-After. */
void reply_set_unavailable(reply *r, const char *why);
/* Sets the problem `storage_full`, with Retry-After. */
void reply_set_storage_full(reply *r, const char *why);
void reply_set_error(reply *r, const error *e, json *errors);

#endif

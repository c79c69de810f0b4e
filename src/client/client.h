// SPDX-License-Identifier: Apache-2.0
/* client: requests to a hexad server. The only user of libcurl. One thread. */
#ifndef HEXAD_CLIENT_CLIENT_H
#define HEXAD_CLIENT_CLIENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "base/core/error.h"
#include "base/json/json.h"

typedef struct client client;

typedef struct client_reply {
    long status;
    json *document; /* NULL if the body is not JSON */
    bool local;     /* over a Unix socket */
    long again_s;   /* Retry-After; 0: the answer has none */
} client_reply;

/* `server` is unix:/path, http://HOST:PORT or https://HOST:PORT (of a proxy). `token` may be NULL.
 * Blanks and line ends around it, which a shell may leave, do not belong to it.
 * `authorities` is a file of certificates (PEM) that may sign the server's certificate; NULL: the
 * certificates of the system. Error spec_invalid: `server` has another form. */
client *client_open(const char *server, const char *token, const char *authorities, error *e);
void client_close(client *c); /* accepts NULL */
/* Sets the advice of the error that no server answers; a static text. The default advises to start hexad, or
 * to give its address with --server or HEXAD_SERVER. */
void client_set_advice(client *c, const char *advice);

/* Sends a request and returns its reply, whatever the status. `body` is JSON of `length` bytes, or NULL.
 * Fails only if there is no reply. The caller releases the reply with client_reply_clear. */
bool client_call(client *c, const char *method, const char *path, const char *body, size_t length,
                 client_reply *reply, error *e);
/* Sends a POST as client_call does, with a time limit for the whole call. */
bool client_post_within(client *c, const char *path, const char *body, size_t length, long within_ms,
                        client_reply *reply, error *e);
/* Sends a POST as client_call does, with the Idempotency-Key `key`; NULL: without one. The server acts once
 * on repeated requests with the same key. */
bool client_post_once(client *c, const char *path, const char *key, const char *body, size_t length,
                      client_reply *reply, error *e);
void client_reply_clear(client_reply *reply);

/* Escapes a text for use in a query; the caller frees it. */
char *client_escape(client *c, const char *text);

/* Reads an event stream (Server-Sent Events) until the server ends it. The first event is the one after
 * `*last`; 0:
 * from the beginning. Writes the data of each event, JSON, to `stream` as a line for terminals and sets *last
 * to its id. Status 204 of the reply: there are no more events. From status 300 the document has the
 * reason. Fails if the connection is lost. */
bool client_follow(client *c, const char *path, int64_t *last, FILE *stream, client_reply *reply, error *e);

/* Writes the body of a reply of status 200 to a stream. For other statuses *reply has the document. The
 * caller clears the reply. After a failure ferror(stream) is true if writing failed. */
bool client_download(client *c, const char *path, FILE *stream, client_reply *reply, error *e);

/* Confirms that the file `path` with this hash is stored on the client, by a conditional request whose answer
 * is
 * 304. The server counts it as a download by the owner. */
bool client_confirm(client *c, const char *path, const char *sha256, client_reply *reply, error *e);

/* Uploads `bytes` bytes of a stream with PUT; the reply is as in client_call. `always`: otherwise a server that already
 * has the file answers before the bytes are sent. After a failure ferror(stream) is true if reading failed. */
bool client_upload(client *c, const char *path, FILE *stream, int64_t bytes, bool always, client_reply *reply,
                   error *e);

#endif

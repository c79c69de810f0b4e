/* client: requests to a hexad server, over libcurl, whose only user this is. One thread. */
#ifndef HEXAD_CLIENT_CLIENT_H
#define HEXAD_CLIENT_CLIENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "base/error.h"
#include "json/json.h"

typedef struct client client;

typedef struct client_reply {
    long status;
    json *document; /* NULL when the body is not JSON */
    bool local;     /* over a Unix socket */
} client_reply;

/* `server` is unix:/path, http://HOST:PORT or https://HOST:PORT (of a proxy); an error (spec_invalid) for
 * anything else. `token` may be NULL. `authorities` is a file of the certificates (PEM) that the server's may be signed
 * with; NULL: those of the system. */
client *client_open(const char *server, const char *token, const char *authorities, error *e);
void client_close(client *c); /* accepts NULL */
/* Sets what the error advises when no server answers; a static text. Default: to start hexad, or to name its address with
 * --server or HEXAD_SERVER. */
void client_set_advice(client *c, const char *advice);

/* Sends a request and returns its reply, whatever the status. `body` is JSON of `length` bytes, or NULL.
 * Fails only when there is no reply. The caller clears the reply. */
bool client_call(client *c, const char *method, const char *path, const char *body, size_t length,
                 client_reply *reply, error *e);
/* client_call of a POST that is given up after this time. */
bool client_post_within(client *c, const char *path, const char *body, size_t length, long within_ms,
                        client_reply *reply, error *e);
/* client_call of a POST, with an Idempotency-Key unless `key` is NULL: when it is repeated, the server does it once. */
bool client_post_once(client *c, const char *path, const char *key, const char *body, size_t length,
                      client_reply *reply, error *e);
void client_reply_clear(client_reply *reply);

/* Escapes a text for use in a query; to be freed. */
char *client_escape(client *c, const char *text);

/* Reads an event stream (Server-Sent Events) after the event `*last` (0: from the beginning) until the server
 * ends it. It writes the data of each event to `stream`, as a line, and sets *last to the last id. The reply's status
 * 204: there are no more events; from 300 on its document says why. Fails when the connection is lost. */
bool client_follow(client *c, const char *path, int64_t *last, FILE *stream, client_reply *reply, error *e);

/* Writes the body of a reply of status 200 to a stream; of another status *reply has the document, to be cleared by the
 * caller. After a failure ferror(stream) is true if writing failed. */
bool client_download(client *c, const char *path, FILE *stream, client_reply *reply, error *e);

/* Confirms that the file with this hash, as `path` gives it, is stored here: a conditional request, which is answered
 * with 304. It counts as a download by its owner. */
bool client_confirm(client *c, const char *path, const char *sha256, client_reply *reply, error *e);

/* Puts `bytes` bytes of a stream, and takes the reply as client_call does. After a failure ferror(stream) is true if
 * reading failed. */
bool client_upload(client *c, const char *path, FILE *stream, int64_t bytes, client_reply *reply, error *e);

#endif

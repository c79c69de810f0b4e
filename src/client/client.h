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
} client_reply;

/* `server` is unix:/path, http://HOST:PORT or https://HOST:PORT (of a proxy); an error (spec_invalid) for anything
 * else. `token` may be NULL. */
client *client_open(const char *server, const char *token, error *e);
void client_close(client *c); /* accepts NULL */

/* Sends a request and takes its reply, whatever the status. `body` has `length` bytes and is meant
 * to be JSON, or is NULL for none. False and an error only when no reply came. The caller clears
 * the reply. */
bool client_call(client *c, const char *method, const char *path, const char *body, size_t length,
                 client_reply *reply, error *e);
void client_reply_clear(client_reply *reply);

/* A text as it stands for itself in a query; to be freed. */
char *client_escape(client *c, const char *text);

/* Reads an event stream (Server-Sent Events) from behind the event `last` (0: from the beginning) and writes the
 * data of each to `stream`, one a line, until the server ends it; *last is the last id that came. *status 204: there
 * was nothing more to tell. False and an error when the connection was lost. */
bool client_follow(client *c, const char *path, int64_t *last, FILE *stream, long *status, error *e);

/* Writes the body of a reply to a stream; *status tells whether it is what was asked for. When it
 * fails, ferror(stream) tells whether the stream was at fault. */
bool client_download(client *c, const char *path, FILE *stream, long *status, error *e);

#endif

// SPDX-License-Identifier: Apache-2.0
/* session: the value of the cookie that a browser presents instead of a token.
 *
 * A session is a text "ID.ENDS.MAC": the id of a token, the time of its end (seconds since 1970, wall clock),
 * and an HMAC-SHA256 of both and of the hash of the token, with a key of the service. The service stores no
 * sessions. A session ends when its time has passed, its token is revoked, or the key is removed. The key has
 * its own file, so the hashes of the tokens do not suffice to make a session. Constant data after
 * session_key_open; any thread.
 */
#ifndef HEXAD_SERVICE_AUTH_SESSION_H
#define HEXAD_SERVICE_AUTH_SESSION_H

#include "files/token.h"
#include "base/core/error.h"

#define SESSION_KEY_BYTES 32
#define SESSION_SIZE (TOKEN_ID_SIZE + 1 + 20 + 1 + 64)

typedef struct session_key {
    uint8_t bytes[SESSION_KEY_BYTES];
    /* Name of the cookie. It differs between services on one host: browsers do not distinguish cookies by
     * port. */
    char cookie[16];
} session_key;

/* Reads the key. If the file is missing, makes a key. Error spec_invalid: the file has another length, or
 * other users can access it. */
bool session_key_open(const char *path, session_key *key, error *e);

void session_begin(const session_key *key, const token *of, int64_t ends_ms, char text[SESSION_SIZE]);

/* The token of the session, and the time of its end. NULL if the text is not a session. The caller checks
 * whether the session has ended. */
const token *session_find(const session_key *key, const token_set *set, const char *text, int64_t *ends_ms);

#endif

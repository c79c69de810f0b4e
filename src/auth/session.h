/* session: what a browser shows instead of a token, in a cookie.
 *
 * A session is a text "ID.ENDS.MAC": the id of a token, the second of its end, and an HMAC-SHA256 over both and the hash
 * of the token, under a key of the service. Nothing is stored for it. It ends when its time has passed, when its token
 * is revoked, and when the key is removed. The key is in a file of its own, so the hashes of the tokens alone do not
 * suffice to make a session. Constant data after session_key_open; any thread.
 */
#ifndef HEXAD_AUTH_SESSION_H
#define HEXAD_AUTH_SESSION_H

#include "auth/token.h"
#include "base/error.h"

#define SESSION_KEY_BYTES 32
#define SESSION_SIZE (TOKEN_ID_SIZE + 1 + 20 + 1 + 64)

typedef struct session_key {
    uint8_t bytes[SESSION_KEY_BYTES];
    char cookie
        [16]; /* the name of the cookie. Services on one host have names of their own, as cookies know no port */
} session_key;

/* Reads the key, and makes one when the file is missing. Error spec_invalid: the file has another length, or others may
 * read it. */
bool session_key_open(const char *path, session_key *key, error *e);

void session_begin(const session_key *key, const token *of, int64_t ends_ms, char text[SESSION_SIZE]);

/* The token of the session, and when it ends; NULL when the text is not a session. The caller looks whether it is over. */
const token *session_find(const session_key *key, const token_set *set, const char *text, int64_t *ends_ms);

#endif

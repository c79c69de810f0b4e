/* token: bearer tokens, of which a file keeps the hashes.
 *
 * A token is TOKEN_PREFIX and 256 random bits in hexadecimal, so that a plain SHA-256 keeps it: there is
 * nothing to guess. The file has a line for each,
 *
 *     ID USER SCOPES SHA256 CREATED
 *
 * with ID the beginning of the hash, which is what people call a token by; `#` begins a comment. It belongs
 * to whoever runs the service, or to root, and nobody else may read or write it, but for the group of the service,
 * which may read a file of root: one that others can reach is refused (store_file_check_private). A set is immutable
 * and may be read by any thread.
 */
#ifndef HEXAD_AUTH_TOKEN_H
#define HEXAD_AUTH_TOKEN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/types.h>

#include "base/error.h"

#define TOKEN_PREFIX "hexad_"
#define TOKEN_SIZE (sizeof TOKEN_PREFIX + 64) /* of its text, with the terminator */
#define TOKEN_ID_SIZE 13
#define TOKEN_USER_SIZE 65

typedef struct token {
    char id[TOKEN_ID_SIZE];
    char user[TOKEN_USER_SIZE]; /* owner of the jobs that it submits */
    unsigned scopes;
    uint8_t hash[32];
    int64_t created_ms;
} token;

typedef struct token_set {
    token *item;
    size_t count;
} token_set;

/* Reads the file. Nothing there is an empty set; an error (spec_invalid) names the line that is wrong, or who
 * else may reach the file. The caller clears. */
bool token_set_read(const char *path, token_set *set, error *e);
void token_set_clear(token_set *set); /* accepts an empty one */

/* The token of which `text` is the secret, in a time that does not tell how much of it was right; NULL for none. */
const token *token_set_find(const token_set *set, const char *text);

/* Makes a token and adds it to the set; `text` is given its secret, which nothing else has. Errors
 * (spec_invalid) for a user that is no name: 1 to 64 letters, digits and "._@-". */
const token *token_set_add(token_set *set, const char *user, unsigned scopes, char text[TOKEN_SIZE],
                           error *e);

/* False when there is none of that id. */
bool token_set_remove(token_set *set, const char *id);

#define TOKEN_NO_GROUP ((gid_t)-1)

/* Writes the file, in the place of the old one. It belongs to the caller and has mode 0600; what root writes has mode
 * 0640, so that the service can read it as well, and the first group of these that is not root's: that of the old
 * file, `group`, that of the directory. */
bool token_set_write(const char *path, const token_set *set, gid_t group, error *e);

#endif

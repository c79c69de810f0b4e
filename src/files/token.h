// SPDX-License-Identifier: Apache-2.0
/* token: bearer tokens; a file stores their hashes.
 *
 * A token is TOKEN_PREFIX and 256 random bits in hexadecimal. 256 random bits cannot be guessed, so a plain
 * SHA-256 is a safe hash. The file has a line for each token:
 *
 *     ID USER SCOPES SHA256 CREATED [MAX_PRIORITY]
 *
 * ID is the beginning of the hash; it names the token in commands and messages. `#` begins a comment. A line
 * without MAX_PRIORITY permits all priorities. The file must belong to the user that runs the service, or to
 * root. Other users must not be able to read or write it; a file of root may be readable for the service's
 * group. Other files are refused (store_file_check_private). A set does not change after it was read, except
 * by token_set_add and token_set_remove. Any thread may read it.
 */
#ifndef HEXAD_FILES_TOKEN_H
#define HEXAD_FILES_TOKEN_H

#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/types.h>

#include "base/core/error.h"

#define TOKEN_PREFIX "hexad_"
#define TOKEN_SIZE (sizeof TOKEN_PREFIX + 64) /* of its text, with the final NUL */
#define TOKEN_ID_SIZE 13
#define TOKEN_USER_SIZE 65
#define TOKEN_ANY_PRIORITY INT_MAX
/* The token file of the service that systemd runs (systemd/hexad.service). */
#define TOKEN_SYSTEM_FILE "/etc/hexad/tokens"

typedef struct token {
    char id[TOKEN_ID_SIZE];
    char user[TOKEN_USER_SIZE]; /* owner of the jobs that it submits */
    unsigned scopes;
    uint8_t hash[32];
    int64_t created_ms;
    int max_priority; /* highest priority of the jobs that it submits or changes; or TOKEN_ANY_PRIORITY */
} token;

typedef struct token_set {
    token *item;
    size_t count;
} token_set;

/* Reads the file; a missing file is an empty set. Error spec_invalid: a line is not valid, other users can
 * access the file, or this process has no permission to read it. Error internal: another failure to read it.
 * The caller releases the set with token_set_clear. */
bool token_set_read(const char *path, token_set *set, error *e);

/* As token_set_read, for commands of an administrator: root may also read the file of another user, to which
 * only this user has access. */
bool token_set_read_of_any_owner(const char *path, token_set *set, error *e);
void token_set_clear(token_set *set); /* accepts an empty one */

/* Finds the token with this secret, in constant time. NULL: there is none. */
const token *token_set_find(const token_set *set, const char *text);

/* Creates a token, adds it to the set and writes its secret to `text`. The secret is not stored. Error
 * spec_invalid:
 * the user is not 1 to 64 letters, digits and "._@-", or is "." or "..". A file of an earlier version may
 * have tokens of such users, which stay valid. */
const token *token_set_add(token_set *set, const char *user, unsigned scopes, int max_priority,
                           char text[TOKEN_SIZE], error *e);

/* Parses a priority, -1000 to 1000. False for any other text. */
bool token_parse_priority(const char *text, int *priority);

/* Removes the token with this id. False: there is none. */
bool token_set_remove(token_set *set, const char *id);

#define TOKEN_NO_GROUP ((gid_t)-1)

/* Replaces the file. It belongs to the caller and has mode 0600. If the caller is root and the old file belongs
 * to another user, its owner, group and mode are kept. Otherwise the mode of a file of root is 0640, so
 * that the service can read the file. Its group is then the first of these that is not root: the group of the
 * old file, `group`, the group of the directory. */
bool token_set_write(const char *path, const token_set *set, gid_t group, error *e);

#endif

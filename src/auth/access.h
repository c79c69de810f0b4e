/* access: who a caller is, and what may be done by whom.
 *
 * A bearer token, where one is shown, says it all: its user and its scopes. Without one a caller on a Unix socket
 * is the user whose process connected, as the kernel tells: the service's own user, root and `admins` are
 * admins; `users` and members of `groups` may read, submit and cancel; anyone else is a stranger. A caller on
 * TCP without a token is a stranger too, unless `open_tcp` makes of all of them one user, ACCESS_ANYONE.
 *
 * The token file is read again when it has changed; while it cannot be read no token is known. Any thread.
 */
#ifndef HEXAD_AUTH_ACCESS_H
#define HEXAD_AUTH_ACCESS_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

#include "auth/scope.h"
#include "base/error.h"

#define ACCESS_USER_SIZE 65
#define ACCESS_ANYONE "anyone"

typedef struct access_control access_control;

typedef struct access_names {
    const char *const *item; /* names or numbers */
    size_t count;
} access_names;

typedef struct access_settings {
    access_names users, groups, admins;
    const char *token_file;
    bool open_tcp;
} access_settings;

/* An error (spec_invalid) for a user or group that is not known, and for a token file that token_set_read
 * refuses. Copies what it needs. */
access_control *access_open(const access_settings *settings, error *e);
void access_close(access_control *a); /* accepts NULL */

bool access_has_tokens(access_control *a);

/* What is known of a connection before it asks for anything. */
typedef struct access_peer {
    bool local;                  /* over a Unix socket, by `uid` */
    uid_t uid;                   /* (uid_t)-1: not known */
    unsigned scopes;             /* without a token */
    char user[ACCESS_USER_SIZE]; /* "" for a stranger */
} access_peer;

/* Asks the kernel about a connected socket. */
void access_look(access_control *a, int fd, access_peer *peer);

typedef struct access_caller {
    char user[ACCESS_USER_SIZE];
    unsigned scopes;
} access_caller;

/* `authorization` is the header's value or NULL. False for a stranger and for a token that is not known. */
bool access_identify(access_control *a, const access_peer *peer, const char *authorization,
                     access_caller *caller);

/* Whether the caller may have to do with what belongs to `owner`. */
bool access_is_owner(const access_caller *caller, const char *owner);

#endif

// SPDX-License-Identifier: Apache-2.0
/* access: identifies callers and returns their permissions.
 *
 * A bearer token determines its user, its scopes and the highest priority that the user may give. Without a
 * token, a caller on a Unix socket is the user of the connected process, as the kernel reports it. The
 * service's own user, root and `admins` are administrators. `users` and members of `groups` may read, submit
 * and cancel. All other users are unknown. A caller on TCP without a token is unknown, too; with `open_tcp`
 * all such callers are the user ACCESS_ANYONE.
 *
 * A browser presents its token once and receives a session (service/auth/session.h), which it presents over
 * TCP afterwards. A session has the permissions of its token and ends with it.
 *
 * access_change_users replaces users, groups and admins; the new names apply to new connections.
 *
 * The token file is read again after it has changed. While it cannot be read, all tokens are unknown. Any
 * thread.
 */
#ifndef HEXAD_SERVICE_AUTH_ACCESS_H
#define HEXAD_SERVICE_AUTH_ACCESS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/stat.h>
#include <sys/types.h>

#include "files/scope.h"
#include "service/auth/session.h"
#include "base/core/running_time.h"
#include "files/token.h"
#include "base/core/error.h"

#define ACCESS_USER_SIZE 65
#define ACCESS_ANYONE "anyone"
/* The refusal of a token, with the command for the administrator. */
#define ACCESS_TOKEN_UNKNOWN \
    "the token is unknown or revoked: ask the administrator to run `hexadctl token add USER` and use the new token"

typedef struct access_control access_control;

typedef struct access_names {
    const char *const *item; /* names or numbers */
    size_t count;
} access_names;

typedef struct access_settings {
    access_names users, groups, admins;
    const char *token_file;
    const char *session_key_file; /* NULL: no sessions */
    double session_s;             /* length of a session */
    running_time *running;        /* must outlive the access control; NULL only without sessions */
    bool open_tcp;
} access_settings;

/* Copies the settings. Users and groups that do not exist are ignored, with a warning in the log. Error
 * spec_invalid: token_set_read refuses the token file, or session_key_open the key file. */
access_control *access_open(const access_settings *settings, error *e);
void access_close(access_control *a); /* accepts NULL */

/* Users, groups and admins as in access_settings. */
void access_change_users(access_control *a, const access_names *users, const access_names *groups,
                         const access_names *admins);

/* Checks that the user or the group exists. A number is always accepted. Error: spec_invalid. */
bool access_check_name(const char *name, bool group, error *e);

/* The name of the user or group with this number; the caller frees it. NULL: `number` is not a number, or it
 * has no name. */
char *access_find_name(const char *number, bool group);

/* The item of `names` with the same number as `name`. NULL: there is none, or `name` does not exist. */
const char *access_find_same(const access_names *names, bool group, const char *name);
/* The item of `groups` that has the user as a member. NULL: there is none, or the user does not exist. */
const char *access_find_group_of(const access_names *groups, const char *user);

/* Whether the mode of the directory permits the user, or each member of the group, to search it. True if the
 * name does not exist. */
bool access_may_search(const char *name, bool group, const struct stat *directory);

bool access_has_tokens(access_control *a);
/* Whether the token file can be read and is valid; true without a file. Reads it again after a change. */
bool access_can_read_tokens(access_control *a);

/* Calls `show` for each token, in the order of the file, while no thread can change the tokens. */
void access_list_tokens(access_control *a, void (*show)(void *context, const token *t), void *context);

/* Properties of a connection before its first request. */
typedef struct access_peer {
    bool local;                  /* on a Unix socket; `uid` is valid */
    uid_t uid;                   /* (uid_t)-1: unknown */
    unsigned scopes;             /* of requests without a token */
    char user[ACCESS_USER_SIZE]; /* "" if unknown */
} access_peer;

/* Reads the user and the groups of the peer of a connected socket from the kernel. */
void access_look(access_control *a, int fd, access_peer *peer);

typedef struct access_caller {
    char user[ACCESS_USER_SIZE];
    unsigned scopes;
    int max_priority;        /* of the token; TOKEN_ANY_PRIORITY without one */
    int64_t session_ends_ms; /* wall clock; 0: the caller has no session */
    uint64_t generation;     /* of the tokens that identified the caller; 0: without a token */
} access_caller;

/* Identifies a caller. `authorization` is the value of the header and `session` the value of the cookie;
 * either may be NULL. False for an unknown caller or token. A session that has ended, or that is presented on
 * a Unix socket, is ignored. */
bool access_identify(access_control *a, const access_peer *peer, const char *authorization,
                     const char *session, access_caller *caller);

/* The generation of the tokens, which changes with the token file. A caller of an earlier generation may be
 * unknown now. */
uint64_t access_generation(access_control *a);

/* Begins a session of the token. False: the token is unknown or there are no sessions. */
bool access_begin_session(access_control *a, const char *token_text, char session[SESSION_SIZE],
                          access_caller *caller);

/* Whether the session that ends at this time has ended (base/core/running_time). False if the time is 0. */
bool access_session_is_over(access_control *a, int64_t session_ends_ms);

/* The name of the cookie; "" if there are no sessions. */
const char *access_session_cookie(const access_control *a);

/* Whether the caller is the owner or an administrator. */
bool access_is_owner(const access_caller *caller, const char *owner);

#endif

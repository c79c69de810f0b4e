/* access: identifies callers and tells what each may do.
 *
 * A bearer token determines its user, its scopes and the highest priority that it may give. Without one, a
 * caller on a Unix socket is the user whose process connected, as the kernel reports: the service's own user,
 * root and `admins` are administrators; `users` and members of `groups` may read, submit and cancel; everyone
 * else is unknown. A caller on TCP without a token is unknown too, unless `open_tcp` makes all of them one
 * user, ACCESS_ANYONE.
 *
 * A browser shows its token once and gets a session (auth/session.h), which it shows over TCP from then on. A session
 * may do what its token may do, and ends with it.
 *
 * access_change_users replaces users, groups and admins: new connections are looked up among these.
 *
 * The token file is read again when it has changed. While it cannot be read, all tokens are unknown. Any
 * thread.
 */
#ifndef HEXAD_AUTH_ACCESS_H
#define HEXAD_AUTH_ACCESS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/stat.h>
#include <sys/types.h>

#include "auth/scope.h"
#include "auth/session.h"
#include "base/running_time.h"
#include "auth/token.h"
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
    const char *session_key_file; /* NULL: there are no sessions */
    double session_s;             /* how long a session lasts */
    running_time *running;        /* must outlive the access control; NULL only without sessions */
    bool open_tcp;
} access_settings;

/* Copies the settings. Users and groups that do not exist are left out, with a warning in the log. Error spec_invalid: token_set_read
 * refuses the token file, or session_key_open that of the key. */
access_control *access_open(const access_settings *settings, error *e);
void access_close(access_control *a); /* accepts NULL */

/* Users, groups and admins as in access_settings. */
void access_change_users(access_control *a, const access_names *users, const access_names *groups,
                         const access_names *admins);

/* Whether the user or the group exists: a name, or any number. An error: spec_invalid. */
bool access_check_name(const char *name, bool group, error *e);

/* The name of the user or group with this number, to be freed; NULL: `number` is not a number, or it has no name. */
char *access_find_name(const char *number, bool group);

/* The item of `names` that is the same user or group as `name`, by number; NULL: none, or `name` does not exist. */
const char *access_find_same(const access_names *names, bool group, const char *name);
/* The item of `groups` that has the user as a member; NULL: none, or the user does not exist. */
const char *access_find_group_of(const access_names *groups, const char *user);

/* Whether the mode of the directory lets the user, or each member of the group, search it; true where the name does not
 * exist. */
bool access_may_search(const char *name, bool group, const struct stat *directory);

bool access_has_tokens(access_control *a);

/* What is known about a connection before its first request. */
typedef struct access_peer {
    bool local;                  /* over a Unix socket, by `uid` */
    uid_t uid;                   /* (uid_t)-1: unknown */
    unsigned scopes;             /* without a token */
    char user[ACCESS_USER_SIZE]; /* "" for an unknown one */
} access_peer;

/* Gets the user and groups of the peer of a connected socket from the kernel. */
void access_look(access_control *a, int fd, access_peer *peer);

typedef struct access_caller {
    char user[ACCESS_USER_SIZE];
    unsigned scopes;
    int max_priority;        /* of the token; TOKEN_ANY_PRIORITY without one */
    int64_t session_ends_ms; /* wall clock; 0: the caller has no session */
    uint64_t generation;     /* of the tokens, among which the caller's was; 0: the caller has none */
} access_caller;

/* `authorization` is the value of the header, `session` that of the cookie, or NULL. Returns false for an unknown
 * caller or token. A session that is over, or over a Unix socket, counts as none. */
bool access_identify(access_control *a, const access_peer *peer, const char *authorization,
                     const char *session, access_caller *caller);

/* Another number after each change of the token file: a caller that a token of an earlier one identified may be unknown now. */
uint64_t access_generation(access_control *a);

/* Begins a session of the token: false when the token is unknown or there are no sessions. */
bool access_begin_session(access_control *a, const char *token_text, char session[SESSION_SIZE],
                          access_caller *caller);

/* Whether the caller has a session and it is over (base/running_time). */
bool access_session_is_over(access_control *a, int64_t session_ends_ms);

/* The name of the cookie; "" when there are no sessions. */
const char *access_session_cookie(const access_control *a);

/* Whether the caller is the owner or an administrator. */
bool access_is_owner(const access_caller *caller, const char *owner);

#endif

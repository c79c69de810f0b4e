// SPDX-License-Identifier: Apache-2.0
#include "service/auth/access.h"

#include <ctype.h>
#include <errno.h>
#include <grp.h>
#include <pthread.h>
#include <pwd.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"

#define NAME_BYTES 16384 /* for the record of a user or a group; the record of a large group is long */

/* Maximum number of groups that are read of a user; below NGROUPS_MAX. A user with more groups is admitted by
 * unix_users only. */
enum { MOST_GROUPS = 1024 };

typedef struct numbers {
    unsigned *item;
    size_t count;
} numbers;

/* The users and groups that may use the Unix socket. */
typedef struct peers {
    numbers users, groups, admins;
} peers;

struct access_control {
    bool open_tcp;
    session_key key; /* the cookie's name is "" if there are no sessions */
    int64_t session_ms;
    running_time *running;
    char *token_file;
    pthread_mutex_t mutex; /* guards the members below */
    peers peers;
    token_set tokens;
    uint64_t generation;
    bool troubled;    /* the log has a message that the file cannot be read */
    bool unreadable;  /* the last attempt to read the file failed */
    struct stat seen; /* status of the file that the tokens were read from; zero: it did not exist */
};

static bool resolve_user(const char *name, unsigned *number)
{
    char buffer[NAME_BYTES];
    struct passwd record, *found = NULL;
    if (getpwnam_r(name, &record, buffer, sizeof buffer, &found) != 0 || !found) return false;
    *number = found->pw_uid;
    return true;
}

static bool resolve_group(const char *name, unsigned *number)
{
    char buffer[NAME_BYTES];
    struct group record, *found = NULL;
    if (getgrnam_r(name, &record, buffer, sizeof buffer, &found) != 0 || !found) return false;
    *number = found->gr_gid;
    return true;
}

static bool resolve(const char *name, bool group, unsigned *number, error *e)
{
    char *end = NULL;
    unsigned long read = strtoul(name, &end, 10);
    if (isdigit((unsigned char)*name) && !*end && read < (unsigned)-1) {
        *number = (unsigned)read;
        return true;
    }
    if ((group ? resolve_group : resolve_user)(name, number)) return true;
    return error_set(e, ERROR_SPEC_INVALID, "the %s %s does not exist: run `getent %s` for those that exist",
                     group ? "group" : "user", name, group ? "group" : "passwd");
}

/* Resolves names to numbers. Names that do not exist are ignored, with a warning. */
static void resolve_all(const access_names *names, bool group, const char *setting, numbers *out)
{
    out->item = mem_alloc(names->count * sizeof *out->item);
    for (size_t k = 0; k < names->count; k++) {
        error e = {0};
        if (resolve(names->item[k], group, &out->item[out->count], &e))
            out->count++;
        else
            log_write(LOG_LEVEL_WARNING, "setting %s: %s, or remove it from the setting", setting, e.message);
    }
}

static void peers_clear(peers *p)
{
    free(p->users.item);
    free(p->groups.item);
    free(p->admins.item);
}

static peers peers_read(const access_names *users, const access_names *groups, const access_names *admins)
{
    peers read = {0};
    resolve_all(users, false, "unix_users", &read.users);
    resolve_all(groups, true, "unix_groups", &read.groups);
    resolve_all(admins, false, "unix_admins", &read.admins);
    return read;
}

static bool holds(const numbers *n, unsigned number)
{
    for (size_t i = 0; i < n->count; i++)
        if (n->item[i] == number) return true;
    return false;
}

static bool is_same(const struct stat *a, const struct stat *b)
{
    return a->st_dev == b->st_dev && a->st_ino == b->st_ino && a->st_size == b->st_size &&
           a->st_ctim.tv_sec == b->st_ctim.tv_sec && a->st_ctim.tv_nsec == b->st_ctim.tv_nsec;
}

/* Reads the tokens if their file has changed. If it cannot be read at the moment (internal), the tokens are
 * kept, and the next call reads it again. If it is not a token file, no token is valid. The caller holds
 * the mutex. */
static bool refresh(access_control *a, error *e)
{
    struct stat now = {0};
    token_set read = {0};
    error why = {0};
    if (stat(a->token_file, &now) != 0) {
        a->unreadable = errno != ENOENT && errno != ENOTDIR;
        if (a->unreadable) return error_set(e, ERROR_INTERNAL, "%s: %s", a->token_file, strerror(errno));
        now = (struct stat){0};
    }
    if (is_same(&now, &a->seen)) return true;
    bool ok = token_set_read(a->token_file, &read, &why);
    a->unreadable = !ok;
    if (!ok && e) *e = why;
    if (!ok && why.code == ERROR_INTERNAL) return false;
    a->seen = now;
    a->generation++;
    token_set_clear(&a->tokens);
    a->tokens = read;
    return ok;
}

access_control *access_open(const access_settings *settings, error *e)
{
    access_control *a = mem_alloc(sizeof *a);
    pthread_mutex_init(&a->mutex, NULL);
    a->open_tcp = settings->open_tcp;
    a->session_ms = (int64_t)(settings->session_s * 1000);
    a->running = settings->running;
    a->token_file = mem_strdup(settings->token_file);
    a->peers = peers_read(&settings->users, &settings->groups, &settings->admins);
    if ((!settings->session_key_file || session_key_open(settings->session_key_file, &a->key, e)) &&
        refresh(a, e))
        return a;
    access_close(a);
    return NULL;
}

void access_close(access_control *a)
{
    if (!a) return;
    token_set_clear(&a->tokens);
    pthread_mutex_destroy(&a->mutex);
    peers_clear(&a->peers);
    free(a->token_file);
    free(a);
}

void access_change_users(access_control *a, const access_names *users, const access_names *groups,
                         const access_names *admins)
{
    peers fresh = peers_read(users, groups, admins);
    pthread_mutex_lock(&a->mutex);
    peers former = a->peers;
    a->peers = fresh;
    pthread_mutex_unlock(&a->mutex);
    peers_clear(&former);
}

bool access_check_name(const char *name, bool group, error *e)
{
    unsigned number;
    return resolve(name, group, &number, e);
}

char *access_find_name(const char *number, bool group)
{
    char buffer[NAME_BYTES], *end = NULL;
    unsigned long read = strtoul(number, &end, 10);
    if (!isdigit((unsigned char)*number) || *end || read >= (unsigned)-1) return NULL;
    if (group) {
        struct group record, *found = NULL;
        bool known = getgrgid_r((gid_t)read, &record, buffer, sizeof buffer, &found) == 0 && found;
        return known ? mem_strdup(found->gr_name) : NULL;
    }
    struct passwd record, *found = NULL;
    bool known = getpwuid_r((uid_t)read, &record, buffer, sizeof buffer, &found) == 0 && found;
    return known ? mem_strdup(found->pw_name) : NULL;
}

const char *access_find_same(const access_names *names, bool group, const char *name)
{
    unsigned wanted, number;
    if (!resolve(name, group, &wanted, NULL)) return NULL;
    for (size_t i = 0; i < names->count; i++)
        if (resolve(names->item[i], group, &number, NULL) && number == wanted) return names->item[i];
    return NULL;
}

/* Lists the groups of a user. Returns their number; 0 if the user does not exist or has more than
 * MOST_GROUPS. */
static int list_groups(unsigned uid, gid_t groups[MOST_GROUPS])
{
    char buffer[NAME_BYTES];
    struct passwd record, *found = NULL;
    int count = MOST_GROUPS;
    if (getpwuid_r(uid, &record, buffer, sizeof buffer, &found) != 0 || !found) return 0;
    return getgrouplist(found->pw_name, found->pw_gid, groups, &count) < 0 ? 0 : count;
}

const char *access_find_group_of(const access_names *groups, const char *user)
{
    gid_t of_user[MOST_GROUPS];
    unsigned uid, number;
    if (!resolve(user, false, &uid, NULL)) return NULL;
    int count = list_groups(uid, of_user);
    for (size_t i = 0; i < groups->count; i++)
        for (int k = 0; k < count; k++)
            if (resolve(groups->item[i], true, &number, NULL) && number == of_user[k]) return groups->item[i];
    return NULL;
}

bool access_may_search(const char *name, bool group, const struct stat *directory)
{
    gid_t groups[MOST_GROUPS];
    unsigned number;
    if (!resolve(name, group, &number, NULL)) return true;
    if (!group && number == 0) return true;
    if (!group && number == directory->st_uid) return directory->st_mode & S_IXUSR;
    int count = group ? 1 : list_groups(number, groups);
    if (group) groups[0] = number;
    for (int k = 0; k < count; k++)
        if (groups[k] == directory->st_gid) return directory->st_mode & S_IXGRP;
    return directory->st_mode & S_IXOTH;
}

bool access_has_tokens(access_control *a)
{
    pthread_mutex_lock(&a->mutex);
    bool some = a->tokens.count > 0;
    pthread_mutex_unlock(&a->mutex);
    return some;
}

/* Whether the connected process was in one of the groups. The caller holds the mutex. */
static bool in_groups(const access_control *a, int fd, gid_t primary)
{
    gid_t groups[MOST_GROUPS];
    socklen_t size = sizeof groups;
    const numbers *allowed = &a->peers.groups;
    if (holds(allowed, primary)) return true;
    if (!allowed->count || getsockopt(fd, SOL_SOCKET, SO_PEERGROUPS, groups, &size) != 0) return false;
    for (size_t i = 0; i < size / sizeof *groups; i++)
        if (holds(allowed, groups[i])) return true;
    return false;
}

/* The name of the user; uid:NUMBER if there is none. */
static void name_user(uid_t uid, char user[ACCESS_USER_SIZE])
{
    char buffer[NAME_BYTES];
    struct passwd record, *found = NULL;
    if (getpwuid_r(uid, &record, buffer, sizeof buffer, &found) == 0 && found &&
        strlen(found->pw_name) < ACCESS_USER_SIZE)
        strcpy(user, found->pw_name);
    else
        snprintf(user, ACCESS_USER_SIZE, "uid:%u", (unsigned)uid);
}

void access_look(access_control *a, int fd, access_peer *peer)
{
    struct ucred peer_process;
    socklen_t size = sizeof peer_process;
    struct sockaddr_storage address = {0};
    socklen_t length = sizeof address;
    *peer = (access_peer){.uid = (uid_t)-1};
    if (getsockname(fd, (struct sockaddr *)&address, &length) != 0) return;
    peer->local = address.ss_family == AF_UNIX;
    if (!peer->local) {
        if (!a->open_tcp) return;
        peer->scopes = SCOPE_USER;
        strcpy(peer->user, ACCESS_ANYONE);
        return;
    }
    if (getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer_process, &size) != 0) return;
    peer->uid = peer_process.uid;
    pthread_mutex_lock(&a->mutex);
    if (peer_process.uid == 0 || peer_process.uid == geteuid() || holds(&a->peers.admins, peer_process.uid))
        peer->scopes = SCOPE_ALL;
    else if (holds(&a->peers.users, peer_process.uid) || in_groups(a, fd, peer_process.gid))
        peer->scopes = SCOPE_USER;
    pthread_mutex_unlock(&a->mutex);
    if (peer->scopes) name_user(peer_process.uid, peer->user);
}

static void take_rights(const access_control *a, const token *t, access_caller *caller)
{
    caller->generation = a->generation;
    strcpy(caller->user, t->user);
    caller->scopes = t->scopes;
    caller->max_priority = t->max_priority;
}

/* Returns the current tokens and locks them until unlock_tokens. */
static const token_set *lock_tokens(access_control *a)
{
    error e = {0};
    pthread_mutex_lock(&a->mutex);
    bool ok = refresh(a, &e);
    if (!ok && !a->troubled)
        log_write(LOG_LEVEL_ERROR, "%s: %s",
                  e.code == ERROR_INTERNAL ? "cannot read the changed tokens; the previous ones remain valid"
                                           : "no token is valid",
                  e.message);
    a->troubled = !ok && e.code == ERROR_INTERNAL;
    return &a->tokens;
}

static void unlock_tokens(access_control *a)
{
    pthread_mutex_unlock(&a->mutex);
}

bool access_can_read_tokens(access_control *a)
{
    lock_tokens(a);
    bool readable = !a->unreadable;
    unlock_tokens(a);
    return readable;
}

void access_list_tokens(access_control *a, void (*show)(void *context, const token *t), void *context)
{
    const token_set *tokens = lock_tokens(a);
    for (size_t i = 0; i < tokens->count; i++) show(context, &tokens->item[i]);
    unlock_tokens(a);
}

uint64_t access_generation(access_control *a)
{
    lock_tokens(a);
    uint64_t generation = a->generation;
    unlock_tokens(a);
    return generation;
}

static bool identify_token(access_control *a, const char *authorization, access_caller *caller)
{
    static const char scheme[] = "Bearer ";
    if (strncasecmp(authorization, scheme, sizeof scheme - 1) != 0) return false;
    const char *text = authorization + sizeof scheme - 1 + strspn(authorization + sizeof scheme - 1, " ");
    const token *t = token_set_find(lock_tokens(a), text);
    if (t) take_rights(a, t, caller);
    unlock_tokens(a);
    return t != NULL;
}

static bool identify_session(access_control *a, const char *session, access_caller *caller)
{
    if (!*a->key.cookie) return false;
    int64_t ends_ms = 0;
    const token *t = session_find(&a->key, lock_tokens(a), session, &ends_ms);
    if (t && access_session_is_over(a, ends_ms)) t = NULL;
    if (t) take_rights(a, t, caller);
    unlock_tokens(a);
    caller->session_ends_ms = ends_ms;
    return t != NULL;
}

bool access_identify(access_control *a, const access_peer *peer, const char *authorization,
                     const char *session, access_caller *caller)
{
    *caller = (access_caller){.max_priority = TOKEN_ANY_PRIORITY};
    if (authorization) return identify_token(a, authorization, caller);
    if (session && !peer->local && identify_session(a, session, caller)) return true;
    if (!peer->scopes) return false;
    strcpy(caller->user, peer->user);
    caller->scopes = peer->scopes;
    return true;
}

bool access_begin_session(access_control *a, const char *token_text, char session[SESSION_SIZE],
                          access_caller *caller)
{
    if (!*a->key.cookie) return false;
    int64_t ends_ms = (clock_wall_ms() + a->session_ms) / 1000 * 1000;
    const token *t = token_set_find(lock_tokens(a), token_text);
    if (t) {
        *caller = (access_caller){.session_ends_ms = ends_ms};
        take_rights(a, t, caller);
        session_begin(&a->key, t, ends_ms, session);
    }
    unlock_tokens(a);
    return t != NULL;
}

bool access_session_is_over(access_control *a, int64_t session_ends_ms)
{
    int64_t lasts_ms = a->session_ms - 999; /* the end is rounded down to a second */
    return session_ends_ms && running_time_is_over(a->running, session_ends_ms - lasts_ms, lasts_ms);
}

const char *access_session_cookie(const access_control *a)
{
    return a->key.cookie;
}

bool access_is_owner(const access_caller *caller, const char *owner)
{
    return caller->scopes & SCOPE_ADMIN || (owner && strcmp(caller->user, owner) == 0);
}

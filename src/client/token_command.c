// SPDX-License-Identifier: Apache-2.0
/* token_command: the command token of hexadctl, which adds tokens to a token file, lists them and revokes
 * them. */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pwd.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "files/scope.h"
#include "files/token.h"
#include "base/core/clock.h"
#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "client/command.h"
#include "base/json/json.h"

#define TOKEN_ROW "%-12s  %-16s  %-25s  %-24s  %s\n"

/* Maximum time, in ms, of the wait for another command that changes token files, and the interval of the
 * tries. */
enum { LOCK_PATIENCE_MS = 10000, LOCK_TRY_MS = 20 };

static const char default_scopes[] = "read,submit,cancel";

static int fail(const error *e)
{
    terminal_text_print(stderr, "hexadctl: %s\n", e->message);
    return e->code == ERROR_SPEC_INVALID ? COMMAND_USAGE : COMMAND_FAILED;
}

/* The directory of the file, which the caller frees. */
static char *directory_of(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? mem_strndup(path, slash > path ? (size_t)(slash - path) : 1) : mem_strdup(".");
}

/* Whether the token file is denied to this user: it belongs to another user or, if it does not exist, its
 * directory is not writable. False for root. */
static bool is_denied(const char *path)
{
    struct stat info;
    if (geteuid() == 0) return false;
    if (stat(path, &info) == 0) return info.st_uid != geteuid();
    char *directory = directory_of(path);
    bool denied = access(directory, W_OK) != 0 && errno == EACCES;
    free(directory);
    return denied;
}

/* Prints the error about the token file. If this user is denied access, the error's own message is not
 * printed: its commands are for the administrator of a service that is denied access, and would take the
 * file away from the service. */
static int fail_at_file(const command_options *options, const error *e)
{
    if (!is_denied(options->file)) return fail(e);
    terminal_text_print(stderr,
                        "hexadctl: %s: access to the token file is denied. Run the same command with sudo.\n",
                        options->file);
    return COMMAND_USAGE;
}

static bool take_lock(int fd)
{
    const int64_t until_ms = clock_monotonic_ms() + LOCK_PATIENCE_MS;
    while (flock(fd, LOCK_EX | LOCK_NB) != 0) {
        if (errno != EWOULDBLOCK || clock_monotonic_ms() >= until_ms) return false;
        poll(NULL, 0, LOCK_TRY_MS);
    }
    return true;
}

/* Locks the directory of the file, so that of two concurrent changes none is lost; -1 and an error on
 * failure. The directory of the system service is made if it is missing. */
static int lock_file(const command_options *options, error *e)
{
    char *directory = directory_of(options->file);
    if (options->file_group != TOKEN_NO_GROUP && geteuid() == 0 && mkdir(directory, 0755) == 0)
        chmod(directory, 0755); /* independent of root's umask, because the service reads it. open reports
                                 * failures */
    int fd = open(directory, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0 || !take_lock(fd)) {
        if (fd >= 0 && errno == EWOULDBLOCK)
            error_set(
                e, ERROR_INTERNAL,
                "%s: another command changes the token files in this directory. End it, and run this command "
                "again.",
                directory);
        else
            error_set(e, ERROR_SPEC_INVALID, "%s: %s. %s the token file of the daemon with --file.",
                      directory, strerror(errno),
                      geteuid() == 0 ? "Give" : "Run the same command with sudo, or give");
        if (fd >= 0) close(fd);
        fd = -1;
    }
    free(directory);
    return fd;
}

/* A token may be for a user of another machine, so an unknown name is valid. */
static void warn_of_unknown_user(const token *t, const char *file)
{
    if (getpwnam(t->user)) return;
    terminal_text_print(
        stderr,
        "hexadctl: warning: this machine has no user %s. Clients with the token own the jobs of this name. If the "
        "name is misspelt, run \"hexadctl token revoke %s --file %s\" and add a token for the right name.\n",
        t->user, t->id, file);
}

int command_token_add(client *c, const char *argument, const command_options *options)
{
    (void)c;
    error e = {0};
    token_set set = {0};
    char text[TOKEN_SIZE];
    unsigned scopes = 0;
    int most = TOKEN_ANY_PRIORITY;
    const char *wanted = options->scopes ? options->scopes : default_scopes;
    if (!scope_parse(wanted, &scopes)) {
        error_set(&e, ERROR_SPEC_INVALID, "--scopes %s: must be a list of read, submit, cancel, admin",
                  wanted);
        return fail(&e);
    }
    if (options->max_priority && !token_parse_priority(options->max_priority, &most)) {
        error_set(&e, ERROR_SPEC_INVALID, "--max-priority %s: must be a whole number from -1000 to 1000",
                  options->max_priority);
        return fail(&e);
    }
    int lock = lock_file(options, &e);
    if (lock < 0) return fail_at_file(options, &e);
    const token *t = NULL;
    const bool read = token_set_read_of_any_owner(options->file, &set, &e);
    if (read) t = token_set_add(&set, argument, scopes, most, text, &e);
    bool ok = t && token_set_write(options->file, &set, options->file_group, &e);
    close(lock);
    if (ok) {
        terminal_text_print(stderr, "hexadctl: token %s of %s was added to %s; it is shown only once\n",
                            t->id, t->user, options->file);
        warn_of_unknown_user(t, options->file);
        puts(text);
    }
    token_set_clear(&set);
    if (ok) return COMMAND_OK;
    return read && !t ? fail(&e) : fail_at_file(options, &e);
}

static void put_token(json *list, const token *t, const char *scopes, const char *created)
{
    json *o = json_append_object(list);
    json_put_string(o, "id", t->id);
    json_put_string(o, "user", t->user);
    json_put_string(o, "scopes", scopes);
    json_put_string(o, "created", created);
    if (t->max_priority != TOKEN_ANY_PRIORITY) json_put_integer(o, "max_priority", t->max_priority);
}

int command_token_list(client *c, const char *argument, const command_options *options)
{
    (void)c;
    (void)argument;
    error e = {0};
    token_set set = {0};
    if (!token_set_read_of_any_owner(options->file, &set, &e)) return fail_at_file(options, &e);
    json *list = json_new_array();
    if (!options->json) printf(TOKEN_ROW, "ID", "USER", "SCOPES", "CREATED", "MAX_PRIORITY");
    for (size_t i = 0; i < set.count; i++) {
        const token *t = &set.item[i];
        char scopes[SCOPE_TEXT_SIZE], created[CLOCK_TEXT_SIZE], most[12] = "-";
        scope_print(t->scopes, scopes);
        clock_format_utc(t->created_ms, created);
        if (t->max_priority != TOKEN_ANY_PRIORITY) snprintf(most, sizeof most, "%d", t->max_priority);
        if (options->json)
            put_token(list, t, scopes, created);
        else
            printf(TOKEN_ROW, t->id, t->user, scopes, created, most);
    }
    if (options->json) {
        char *text = json_print_pretty(list);
        fputs(text, stdout);
        free(text);
    }
    if (set.count == 0)
        terminal_text_print(
            stderr,
            "hexadctl: %s contains no tokens: create one with \"sudo hexadctl token add USER\", or give the token "
            "file of another daemon with --file\n",
            options->file);
    json_free(list);
    token_set_clear(&set);
    return COMMAND_OK;
}

int command_token_revoke(client *c, const char *argument, const command_options *options)
{
    (void)c;
    error e = {0};
    token_set set = {0};
    int lock = lock_file(options, &e), code = COMMAND_FAILED;
    if (lock < 0) return fail_at_file(options, &e);
    if (!token_set_read_of_any_owner(options->file, &set, &e)) {
        code = fail_at_file(options, &e);
    } else if (!token_set_remove(&set, argument)) {
        terminal_text_print(
            stderr, "hexadctl: the token %s is not in %s: run hexadctl token list --file %s for the IDs\n",
            argument, options->file, options->file);
        code = COMMAND_MISSING;
    } else if (!token_set_write(options->file, &set, options->file_group, &e)) {
        code = fail_at_file(options, &e);
    } else {
        code = COMMAND_OK;
        if (set.count == 0)
            terminal_text_print(
                stderr,
                "hexadctl: %s contains no tokens now: a daemon that listens on a TCP port will not start "
                "again without a token. Create one, or remove the port from listen or tcp.conf\n",
                options->file);
    }
    close(lock);
    token_set_clear(&set);
    return code;
}

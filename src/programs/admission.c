// SPDX-License-Identifier: Apache-2.0
#include "programs/admission.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "programs/systemd_units.h"
#include "service/auth/access.h"
#include "files/token.h"
#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "service/config/config_edit.h"
#include "files/file.h"

#define DROP_IN_DIRECTORY "hexad.socket.d"
#define DROP_IN "allow.conf"
#define RUNTIME "/run/hexad"
#define BOOTED "/run/systemd/system" /* exists if systemd is the init system, see sd_booted(3) */

enum {
    FILE_LIMIT = 1 << 20, /* bytes of a settings file */
    UNIT_MODE = 0660,     /* mode of the socket in systemd/hexad.socket.in */
    OPEN_MODE = 0666,     /* mode for all users; hexad identifies callers itself */
    EXIT_WRONG = 2
};

static const char drop_in_text[] =
    "# Made by hexad --allow: all users may connect, and hexad serves those in unix_users and unix_groups.\n"
    "[Socket]\n"
    "SocketMode=0666\n";

typedef struct change {
    bool allow, group;
    const char *name, *key; /* the value, and the setting to which it belongs */
    char *found;            /* the name of the user or group whose number was given; otherwise NULL */
    char *file;             /* the settings file, with symbolic links resolved */
    bool units;             /* systemd runs the service with these settings */
    char *drop_in_directory, *drop_in;
    char *socket; /* NULL: the service has TCP ports only */
    char *tokens; /* the token file; NULL: the default of hexadctl */
} change;

/* ---- the setting */

static const config_list *list_of(const config *c, const change *w)
{
    return w->group ? &c->unix_groups : &c->unix_users;
}

static bool is_named(const config *c, const change *w)
{
    const config_list *list = list_of(c, w);
    for (size_t i = 0; i < list->count; i++)
        if (strcmp(list->item[i], w->name) == 0) return true;
    return false;
}

static bool read_settings(const char *file, config *c, error *e)
{
    char *argv[] = {"hexad", "--config", (char *)file};
    config_action action;
    return config_parse(3, argv, c, &action, e);
}

/* Whether the file now contains the value, or with --deny does not contain it. */
static bool check_edited(const char *file, const change *w, error *e)
{
    config edited = {0};
    if (!read_settings(file, &edited, e)) return false;
    bool ok = is_named(&edited, w) == w->allow ||
              error_set(e, ERROR_SPEC_INVALID,
                        "%s: %s of %s is in a continuation line or before a comment; %s it with an editor",
                        w->file, w->name, w->key, w->allow ? "add" : "remove");
    config_clear(&edited);
    return ok;
}

/* Sets the owner and then the mode of the file to those of another file. */
static bool copy_mode(FILE *stream, const char *from, error *e)
{
    struct stat info;
    if (stat(from, &info) == 0 && fchown(fileno(stream), info.st_uid, info.st_gid) == 0 &&
        fchmod(fileno(stream), info.st_mode & 07777) == 0)
        return true;
    return error_set(e, ERROR_INTERNAL, "%s cannot be replaced: %s", from, strerror(errno));
}

static bool write_setting(const change *w, const char *text, error *e)
{
    store_file file = {0};
    store_file_clear(w->file);   /* left by a killed process */
    mode_t former = umask(0077); /* private until copy_mode, since it may contain secrets */
    bool begun = store_file_begin(w->file, &file, e);
    umask(former);
    if (!begun) return false;
    bool ok = fputs(text, file.stream) >= 0 && fflush(file.stream) == 0;
    if (!ok) error_set(e, ERROR_INTERNAL, "%s cannot be written: %s", w->file, strerror(errno));
    ok = ok && check_edited(file.temporary, w, e) && copy_mode(file.stream, w->file, e);
    if (ok) return store_file_commit(&file, e);
    store_file_abort(&file);
    return false;
}

/* The text of the settings file, which the caller frees. */
static char *read_text(const char *file, error *e)
{
    size_t length = 0;
    char *text = store_file_read(file, FILE_LIMIT, &length, e);
    if (!text || strlen(text) == length) return text;
    error_set(e, ERROR_SPEC_INVALID, "%s: byte %zu is NUL: remove it", file, strlen(text));
    free(text);
    return NULL;
}

static bool edit_setting(const change *w, error *e)
{
    char *text = read_text(w->file, e);
    if (!text) return false;
    char *edited = (w->allow ? config_edit_add : config_edit_remove)(text, w->key, w->name);
    bool ok = write_setting(w, edited, e);
    if (ok)
        terminal_text_print(stdout, "%s: %s %s = %s\n", w->file, w->allow ? "added" : "removed", w->key,
                            w->name);
    free(text);
    free(edited);
    return ok;
}

/* If the file does not contain the given number, replaces the number by the name. */
static void find_name(change *w, const config *c)
{
    if (is_named(c, w)) return;
    w->found = access_find_name(w->name, w->group);
    if (w->found) w->name = w->found;
}

/* Adds or removes the value. A name in the file is removed even if the user no longer exists. */
static bool change_setting(change *w, error *e)
{
    config now = {0};
    if (!read_settings(w->file, &now, e)) return false;
    find_name(w, &now);
    bool named = is_named(&now, w), unchanged = named == w->allow;
    bool ok = (named && !w->allow) || access_check_name(w->name, w->group, e);
    config_clear(&now);
    if (!ok || !unchanged) return ok && edit_setting(w, e);
    terminal_text_print(stdout, "%s: %s is %s %s\n", w->file, w->name, w->allow ? "already in" : "not in",
                        w->key);
    return true;
}

static void warn_of(const change *w, const char *key, const char *item)
{
    if (!item) return;
    fflush(stdout);
    terminal_text_print(stderr, "hexad: warning: %s%s is still admitted by %s = %s; remove it from %s\n",
                        w->group ? "the group " : "", w->name, key, item, w->file);
}

/* Warns of settings that admit the denied user or group by another name or number. */
static void warn_of_other_grants(const change *w)
{
    config now = {0};
    if (!read_settings(w->file, &now, NULL)) return;
    access_names users = admission_names(&now.unix_users), groups = admission_names(&now.unix_groups),
                 admins = admission_names(&now.unix_admins);
    if (w->group) {
        warn_of(w, "unix_groups", access_find_same(&groups, true, w->name));
    } else {
        warn_of(w, "unix_users", access_find_same(&users, false, w->name));
        warn_of(w, "unix_groups", access_find_group_of(&groups, w->name));
        warn_of(w, "unix_admins", access_find_same(&admins, false, w->name));
    }
    config_clear(&now);
}

/* Warns of tokens of the denied user: they are valid on a TCP port and on the Unix socket. */
static void warn_of_tokens(const change *w)
{
    token_set set = {0};
    size_t count = 0;
    const char *path = w->tokens ? w->tokens : TOKEN_SYSTEM_FILE;
    if (!w->group && token_set_read_of_any_owner(path, &set, NULL))
        for (size_t k = 0; k < set.count; k++) count += strcmp(set.item[k].user, w->name) == 0;
    fflush(stdout);
    if (count > 0)
        terminal_text_print(
            stderr,
            "hexad: warning: %s still has %zu token%s in %s, which stay%s valid: `hexadctl token list` prints their IDs, "
            "`hexadctl token revoke ID` revokes one\n",
            w->name, count, count == 1 ? "" : "s", path, count == 1 ? "s" : "");
    token_set_clear(&set);
}

/* ---- the socket */

static bool has_drop_in(const change *w)
{
    size_t length = 0;
    char *text = store_file_read(w->drop_in, FILE_LIMIT, &length, NULL);
    bool same = text && strcmp(text, drop_in_text) == 0;
    free(text);
    return same;
}

static bool write_drop_in(const change *w, error *e)
{
    if (has_drop_in(w)) {
        terminal_text_print(stdout, "%s: exists already\n", w->drop_in);
        return true;
    }
    store_file_clear(w->drop_in);
    if (!store_directory_create(w->drop_in_directory, e) ||
        !store_file_write(w->drop_in, drop_in_text, strlen(drop_in_text), e))
        return false;
    if (chmod(w->drop_in, 0644) != 0)
        return error_set(e, ERROR_INTERNAL, "%s cannot be made readable: %s", w->drop_in, strerror(errno));
    terminal_text_print(stdout, "%s: written (SocketMode=0666)\n", w->drop_in);
    return true;
}

/* Removes the drop-in, and its directory if that is then empty. */
static bool remove_drop_in(const change *w, error *e)
{
    if (!store_remove(w->drop_in, e)) return false;
    rmdir(w->drop_in_directory);
    terminal_text_print(stdout, "%s: removed\n", w->drop_in);
    return true;
}

/* Sets the mode of the existing socket, because systemd applies the mode of the unit only when it creates a
 * socket. A symbolic link is not followed, because the directory may belong to the service's user. */
static bool set_socket_mode(const change *w, mode_t mode, error *e)
{
    struct stat info;
    if (!w->socket) return true;
    int fd = open(w->socket, O_PATH | O_NOFOLLOW | O_CLOEXEC);
    if (fd < 0 && errno == ENOENT) {
        terminal_text_print(stdout, "%s: does not exist yet; hexad.socket creates it with mode %04o\n",
                            w->socket, (unsigned)mode);
        return true;
    }
    char *path = mem_printf("/proc/self/fd/%d", fd);
    bool ok = fd >= 0 && fstat(fd, &info) == 0;
    if (ok && !S_ISSOCK(info.st_mode))
        ok =
            error_set(e, ERROR_INTERNAL, "%s is not a socket; remove it and restart hexad.socket", w->socket);
    else if (!ok || chmod(path, mode) != 0)
        ok = error_set(e, ERROR_INTERNAL, "%s: mode %04o cannot be set: %s", w->socket, (unsigned)mode,
                       strerror(errno));
    free(path);
    if (fd >= 0) close(fd);
    if (ok) terminal_text_print(stdout, "%s: mode %04o\n", w->socket, (unsigned)mode);
    return ok;
}

static bool change_socket(const change *w, error *e)
{
    config now = {0};
    if (!read_settings(w->file, &now, e)) return false;
    bool close = !config_shares_socket(&now) && has_drop_in(w);
    config_clear(&now);
    if (w->allow) return write_drop_in(w, e) && set_socket_mode(w, OPEN_MODE, e);
    return !close || (remove_drop_in(w, e) && set_socket_mode(w, UNIT_MODE, e));
}

/* ---- systemd */

/* The settings file of hexad.service: the first --config of its ExecStart=, with symbolic links resolved. The
 * caller frees it. NULL: there is none, or systemd does not answer. */
static char *find_file_of_unit(void)
{
    static const char option[] = "--config ";
    char *start = systemd_units_show("show --value --property ExecStart hexad.service");
    char *named = strstr(start, option), *path = NULL;
    if (named) {
        named += strlen(option);
        named[strcspn(named, " ;\n")] = '\0';
        path = realpath(named, NULL);
    }
    free(start);
    return path;
}

/* Whether the unit has TCP ports only, and no Unix socket. systemctl prints an address a line. */
static bool has_only_ports(void)
{
    char *listens = systemd_units_show("show --value --property Listen hexad.socket");
    bool only = *listens && *listens != '\n' && *listens != '/' && !strstr(listens, "\n/");
    free(listens);
    return only;
}

/* Makes the service read the settings, and systemd a drop-in that it has not read. If one command fails, the other is still
 * run. */
static bool reload_both(const change *w, bool unread, error *e)
{
    char *failed = mem_strdup("");
    systemd_units_obey("try-reload-or-restart hexad.service", &failed);
    if (unread) systemd_units_obey("daemon-reload", &failed);
    bool ok = !*failed;
    if (!ok && access(BOOTED, F_OK) != 0)
        error_set(e, ERROR_INTERNAL,
                  "%s is written, but systemd does not run here: %s failed. Send the daemon SIGHUP "
                  "(kill -HUP PID) or restart it.",
                  w->file, failed);
    else if (!ok)
        error_set(e, ERROR_INTERNAL,
                  "the files are written, but hexad or systemd did not load them: %s failed; restart hexad",
                  failed);
    free(failed);
    return ok;
}

/* ---- the whole change */

/* The Unix socket of the service, to be freed; NULL: it has TCP ports only. */
static char *find_socket(const change *w, const config *settings)
{
    const char *runtime = getenv("RUNTIME_DIRECTORY");
    if (w->units) return has_only_ports() ? NULL : mem_printf("%s/hexad.sock", runtime ? runtime : RUNTIME);
    const char *listen = config_unix_address(settings);
    if (!listen) return NULL;
    return listen[5] ? mem_strdup(listen + 5) : mem_printf("%s/hexad.sock", settings->state_dir);
}

/* Sets w->file to the file of --config, otherwise of the unit, otherwise the default. */
static bool find_file(change *w, const char *named, error *e)
{
    struct stat info;
    char *of_unit = find_file_of_unit();
    const char *file = named ? named : of_unit ? of_unit : CONFIG_FILE;
    w->file = realpath(file, NULL);
    w->units = !named || (w->file && of_unit && strcmp(w->file, of_unit) == 0);
    bool ok = w->file ||
              error_set(e, ERROR_SPEC_INVALID, "cannot read %s: %s. Give the settings file with --config.",
                        file, strerror(errno));
    /* a device would be replaced by a regular file */
    if (ok && (stat(w->file, &info) != 0 || !S_ISREG(info.st_mode)))
        ok = error_set(e, ERROR_SPEC_INVALID,
                       "%s is not a regular file: name the settings file with --config", w->file);
    free(of_unit);
    return ok;
}

static bool begin(change *w, const config *settings, config_action action, error *e)
{
    *w = (change){.allow = action == CONFIG_ALLOW, .group = *settings->admit == '@'};
    w->name = settings->admit + w->group;
    w->key = w->group ? "unix_groups" : "unix_users";
    if (!find_file(w, settings->file, e)) return false;
    char *units = systemd_units_directory();
    w->drop_in_directory = mem_printf("%s/" DROP_IN_DIRECTORY, units);
    w->drop_in = mem_printf("%s/" DROP_IN, w->drop_in_directory);
    w->socket = find_socket(w, settings);
    if (*settings->token_file || !w->units)
        w->tokens = *settings->token_file ? mem_strdup(settings->token_file)
                                          : mem_printf("%s/tokens", settings->state_dir);
    free(units);
    return true;
}

static void end(change *w)
{
    free(w->found);
    free(w->file);
    free(w->drop_in_directory);
    free(w->drop_in);
    free(w->socket);
    free(w->tokens);
}

/* Changes the drop-in and the mode of the existing socket, and makes systemd and the service apply them. */
static bool change_units(const change *w, error *e)
{
    bool ours = has_drop_in(w), set = change_socket(w, e),
         unread = w->allow || ours != has_drop_in(w) || systemd_units_are_unread();
    return reload_both(w, unread, set ? e : NULL) && set;
}

/* The first directory of the socket's path that the admitted user cannot search, which the caller frees;
 * NULL: there is none. */
static char *find_closed_directory(const change *w, mode_t *mode)
{
    struct stat info;
    for (const char *slash = strchr(w->socket, '/'); slash; slash = strchr(slash + 1, '/')) {
        char *directory = mem_strndup(w->socket, slash > w->socket ? (size_t)(slash - w->socket) : 1);
        *mode = stat(directory, &info) == 0 ? info.st_mode & 07777 : 0;
        if (*mode && !access_may_search(w->name, w->group, &info)) return directory;
        free(directory);
    }
    return NULL;
}

/* Prints where the user may connect, or a warning that the user still cannot connect. */
static void tell_reach(const change *w)
{
    const char *prefix = w->group ? "the members of " : "";
    mode_t mode = 0;
    char *closed = w->socket ? find_closed_directory(w, &mode) : NULL;
    fflush(stdout);
    if (!w->socket)
        terminal_text_print(stderr,
                            "hexad: warning: this service listens on a TCP port, where %s has no effect; run"
                            " `hexadctl token add %s%s%s`\n",
                            w->key, w->group ? "USER" : w->name, w->tokens ? " --file " : "",
                            w->tokens ? w->tokens : "");
    else if (closed)
        terminal_text_print(
            stderr,
            "hexad: warning: %s%s cannot enter %s (mode %04o), in which the socket %s lies; set listen ="
            " unix:/PATH, in a directory that all users can enter, and restart hexad\n",
            prefix, w->name, closed, (unsigned)mode, w->socket);
    else
        terminal_text_print(stdout, "%s%s%s may use unix:%s\n", w->units ? "" : "then ", prefix, w->name,
                            w->socket);
    free(closed);
}

/* Prints the error. What a user other than root may not do, such as writing the settings file, root may;
 * wrong names and settings (spec_invalid) stay wrong. */
static void print_failure(const config *settings, config_action action, const error *e)
{
    const size_t length = strlen(e->message);
    terminal_text_print(stderr, "hexad: %s", e->message);
    if (geteuid() != 0 && e->code != ERROR_SPEC_INVALID)
        terminal_text_print(stderr, "%s Run as root: sudo hexad %s%s%s--%s %s",
                            length && e->message[length - 1] == '.' ? "" : ".",
                            settings->file ? "--config " : "", settings->file ? settings->file : "",
                            settings->file ? " " : "", action == CONFIG_ALLOW ? "allow" : "deny",
                            settings->admit);
    fputc('\n', stderr);
}

int admission_change(const config *settings, config_action action)
{
    error e = {0};
    change w;
    umask(0022); /* systemd and the service read these files */
    bool ok = begin(&w, settings, action, &e) && change_setting(&w, &e);
    const bool denied = ok && !w.allow;
    if (ok && w.units)
        ok = change_units(&w, &e);
    else if (ok)
        terminal_text_print(
            stdout,
            "the daemon reads this file again at its next start, or by `kill -HUP $(cat %s/lock)`; units of systemd"
            " are unchanged\n",
            settings->state_dir);
    if (denied) warn_of_other_grants(&w);
    if (denied) warn_of_tokens(&w);
    if (ok && w.allow)
        tell_reach(&w);
    else if (ok)
        puts("open connections continue until they end");
    else
        print_failure(settings, action, &e);
    end(&w);
    return ok ? EXIT_SUCCESS : e.code == ERROR_SPEC_INVALID ? EXIT_WRONG : EXIT_FAILURE;
}

#include "programs/admission.h"

#include <errno.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "auth/access.h"
#include "base/memory.h"
#include "config/config_edit.h"
#include "store/file.h"

#define SETTINGS_FILE HEXAD_SYSCONFDIR "/hexad.conf"
#define UNITS "/etc/systemd/system"
#define DROP_IN_DIRECTORY "hexad.socket.d"
#define DROP_IN "allow.conf"
#define RUNTIME "/run/hexad"

enum {
    FILE_LIMIT = 1 << 20, /* bytes of a settings file */
    UNIT_MODE = 0660,     /* of the socket, as systemd/hexad.socket.in says */
    OPEN_MODE = 0666,     /* hexad tells callers apart by itself */
    EXIT_WRONG = 2
};

static const char drop_in_text[] =
    "# Made by hexad --allow: all users may connect, and hexad serves those in unix_users and unix_groups.\n"
    "[Socket]\n"
    "SocketMode=0666\n";

typedef struct change {
    bool allow, group;
    const char *name, *key; /* the value and the setting that gets it */
    char *file;             /* the settings, at the end of symbolic links */
    char *drop_in_directory, *drop_in, *socket;
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

/* Whether the file reads as wanted. */
static bool check_edited(const char *file, const change *w, error *e)
{
    config edited = {0};
    if (!read_settings(file, &edited, e)) return false;
    bool as_wanted = is_named(&edited, w) == w->allow;
    config_clear(&edited);
    return as_wanted ||
           error_set(e, ERROR_SPEC_INVALID, "%s: the lines of %s are not simple ones: %s %s there by hand",
                     w->file, w->key, w->allow ? "add" : "remove", w->name);
}

/* Gives the file the mode and owner of another. */
static bool copy_mode(FILE *stream, const char *from, error *e)
{
    struct stat info;
    if (stat(from, &info) == 0 && fchmod(fileno(stream), info.st_mode & 07777) == 0 &&
        fchown(fileno(stream), info.st_uid, info.st_gid) == 0)
        return true;
    return error_set(e, ERROR_INTERNAL, "%s cannot be replaced: %s", from, strerror(errno));
}

static bool write_setting(const change *w, const char *text, error *e)
{
    store_file file = {0};
    if (!store_file_begin(w->file, &file, e)) return false;
    bool ok = fputs(text, file.stream) >= 0 && fflush(file.stream) == 0;
    if (!ok) error_set(e, ERROR_INTERNAL, "%s cannot be written: %s", w->file, strerror(errno));
    ok = ok && check_edited(file.temporary, w, e) && copy_mode(file.stream, w->file, e);
    if (ok) return store_file_commit(&file, e);
    store_file_abort(&file);
    return false;
}

/* The text of the settings file, to be freed. */
static char *read_text(const char *file, error *e)
{
    size_t length = 0;
    char *text = store_file_read(file, FILE_LIMIT, &length, e);
    if (!text || strlen(text) == length) return text;
    error_set(e, ERROR_SPEC_INVALID, "%s: byte %zu is NUL: remove it", file, strlen(text));
    free(text);
    return NULL;
}

/* A name that the file has is removed even if the user does not exist any more. */
static bool change_setting(const change *w, error *e)
{
    config now = {0};
    if (!read_settings(w->file, &now, e)) return false;
    bool named = is_named(&now, w);
    config_clear(&now);
    if (!(named && !w->allow) && !access_check_name(w->name, w->group, e)) return false;
    if (named == w->allow) {
        printf("%s: %s is %s %s\n", w->file, w->name, w->allow ? "already in" : "not in", w->key);
        return true;
    }
    char *text = read_text(w->file, e);
    if (!text) return false;
    char *edited = (w->allow ? config_edit_add : config_edit_remove)(text, w->key, w->name);
    bool ok = write_setting(w, edited, e);
    if (ok) printf("%s: %s %s = %s\n", w->file, w->allow ? "added" : "removed", w->key, w->name);
    free(text);
    free(edited);
    return ok;
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
        printf("%s: already there\n", w->drop_in);
        return true;
    }
    if (!store_directory_create(w->drop_in_directory, e) ||
        !store_file_write(w->drop_in, drop_in_text, strlen(drop_in_text), e))
        return false;
    if (chmod(w->drop_in, 0644) != 0)
        return error_set(e, ERROR_INTERNAL, "%s cannot be made readable: %s", w->drop_in, strerror(errno));
    printf("%s: written (SocketMode=0666)\n", w->drop_in);
    return true;
}

/* The directory goes, too, if it is empty then. */
static bool remove_drop_in(const change *w, error *e)
{
    if (!store_remove(w->drop_in, e)) return false;
    rmdir(w->drop_in_directory);
    printf("%s: removed\n", w->drop_in);
    return true;
}

/* Of the socket that is there: systemd sets the mode of the unit only when it makes one. */
static bool set_socket_mode(const change *w, mode_t mode, error *e)
{
    if (chmod(w->socket, mode) == 0)
        printf("%s: mode %04o\n", w->socket, (unsigned)mode);
    else if (errno == ENOENT)
        printf("%s: not there; hexad.socket makes it with mode %04o\n", w->socket, (unsigned)mode);
    else
        return error_set(e, ERROR_INTERNAL, "%s cannot get the mode %04o: %s", w->socket, (unsigned)mode,
                         strerror(errno));
    return true;
}

static bool call_systemctl(const char *verb, const char *unit, error *e)
{
    const char *argv[] = {"systemctl", verb, unit, NULL};
    pid_t pid = 0;
    int status = 0;
    fflush(stdout);
    int why = posix_spawnp(&pid, argv[0], NULL, NULL, (char **)argv, environ);
    bool ran = why == 0 && waitpid(pid, &status, 0) == pid;
    if (ran && status == 0)
        return printf("systemctl %s%s%s: done\n", verb, unit ? " " : "", unit ? unit : "") > 0;
    return error_set(e, ERROR_INTERNAL,
                     "systemctl %s%s%s %s%s; the files are written: type this command, or restart hexad",
                     verb, unit ? " " : "", unit ? unit : "",
                     ran ? "failed" : "cannot be run: ", ran ? "" : strerror(why ? why : errno));
}

/* Whether the settings name users of the socket. */
static bool find_whether_shared(const change *w, bool *shared, error *e)
{
    config c = {0};
    if (!read_settings(w->file, &c, e)) return false;
    *shared = c.unix_users.count || c.unix_groups.count || c.unix_admins.count;
    config_clear(&c);
    return true;
}

static bool change_socket(const change *w, error *e)
{
    bool shared = false;
    if (!find_whether_shared(w, &shared, e)) return false;
    bool ours = has_drop_in(w), close = !shared && ours;
    if (w->allow && !write_drop_in(w, e)) return false;
    if (close && !remove_drop_in(w, e)) return false;
    if ((w->allow || close) && (!call_systemctl("daemon-reload", NULL, e) ||
                                !set_socket_mode(w, w->allow ? OPEN_MODE : UNIT_MODE, e)))
        return false;
    return call_systemctl("try-reload-or-restart", "hexad.service", e);
}

/* ---- both */

/* The first directory of $SYSTEMD_UNIT_PATH, from which systemd reads units if it is set, or the administrator's. To be freed. */
static char *unit_directory(void)
{
    const char *path = getenv("SYSTEMD_UNIT_PATH");
    size_t length = path ? strcspn(path, ":") : 0;
    return length ? mem_strndup(path, length) : mem_strdup(UNITS);
}

static bool begin(change *w, const config *settings, config_action action, error *e)
{
    const char *file = settings->file ? settings->file : SETTINGS_FILE,
               *runtime = getenv("RUNTIME_DIRECTORY");
    *w = (change){.allow = action == CONFIG_ALLOW, .group = *settings->admit == '@'};
    w->name = settings->admit + w->group;
    w->key = w->group ? "unix_groups" : "unix_users";
    w->file = realpath(file, NULL);
    if (!w->file)
        return error_set(e, ERROR_SPEC_INVALID, "%s cannot be read: %s: name the settings file with --config",
                         file, strerror(errno));
    char *units = unit_directory();
    w->drop_in_directory = mem_printf("%s/" DROP_IN_DIRECTORY, units);
    w->drop_in = mem_printf("%s/" DROP_IN, w->drop_in_directory);
    w->socket = mem_printf("%s/hexad.sock", runtime ? runtime : RUNTIME);
    free(units);
    return true;
}

static void end(change *w)
{
    free(w->file);
    free(w->drop_in_directory);
    free(w->drop_in);
    free(w->socket);
}

int admission_change(const config *settings, config_action action)
{
    error e = {0};
    change w;
    umask(0022); /* systemd and the service read these files */
    bool ok = begin(&w, settings, action, &e) && change_setting(&w, &e) && change_socket(&w, &e);
    if (ok && w.allow)
        printf("%s%s may use unix:%s\n", w.group ? "the members of " : "", w.name, w.socket);
    else if (ok)
        puts("connections that are open stay until they end");
    else
        fprintf(stderr, "hexad: %s%s\n", e.message, geteuid() ? " (this takes root)" : "");
    end(&w);
    return ok ? EXIT_SUCCESS : e.code == ERROR_SPEC_INVALID ? EXIT_WRONG : EXIT_FAILURE;
}

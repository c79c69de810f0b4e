// SPDX-License-Identifier: Apache-2.0
#include "programs/maintenance.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "base/core/user_name.h"
#include "client/client.h"
#include "service/database/backup.h"
#include "service/database/backup_directory.h"
#include "service/database/lock.h"
#include "service/results/instance_check.h"
#include "service/results/inventory.h"
#include "files/file.h"

/* The socket of the systemd service. */
#define SYSTEM_SOCKET "unix:/run/hexad/hexad.sock"
#define ADDRESS_LIMIT 4096

static int fail(const error *e)
{
    terminal_text_print(stderr, "hexad: %s\n", e->message);
    return EXIT_FAILURE;
}

/* Checks that the state directory exists and that this user may use it. Otherwise sets an error: the daemon's
 * settings were probably not given, or the command was run as another user. */
static bool check_state_directory(const config *c, error *e)
{
    struct stat info;
    if (stat(c->state_dir, &info) == 0) {
        char owner[USER_NAME_SIZE] = "";
        if (info.st_uid == geteuid() || access(c->state_dir, R_OK | W_OK | X_OK) == 0) return true;
        user_name_of(info.st_uid, owner);
        return error_set(
            e, ERROR_INTERNAL,
            "the state directory %s belongs to the user %s: run this command as root or as this user",
            c->state_dir, owner);
    }
    return error_set(e, ERROR_INTERNAL,
                     "cannot open the state directory %s: %s. Give the settings file of hexad with "
                     "--config FILE, or its state directory with --state_dir DIRECTORY.",
                     c->state_dir, strerror(errno));
}

/* ---- requests to a running daemon */

/* The address of the daemon, which the caller frees: from HEXAD_SERVER, otherwise from port_file, otherwise
 * the setting listen, otherwise the usual socket. */
static char *find_server(const config *c)
{
    const char *named = getenv("HEXAD_SERVER");
    if (named && *named) return mem_strdup(named);
    size_t length = 0;
    char *served = *c->port_file ? store_file_read(c->port_file, ADDRESS_LIMIT, &length, NULL) : NULL;
    const char *local = config_unix_address(c);
    char *address =
        served ? mem_strndup(served, strcspn(served, "\n")) : mem_strdup(local ? local : c->listen.item[0]);
    free(served);
    if (!*address || strcmp(address, "unix:") == 0) {
        free(address);
        address = mem_printf("unix:%s/hexad.sock", c->state_dir);
        if (access(address + strlen("unix:"), F_OK) != 0) {
            free(address);
            address = mem_strdup(SYSTEM_SOCKET);
        }
    }
    if (strncmp(address, "unix:", 5) == 0) return address;
    char *url = mem_printf("http://%s", address);
    free(address);
    return url;
}

static client *open_client(const config *c, error *e)
{
    const char *token = getenv("HEXAD_TOKEN");
    char *server = find_server(c);
    client *found = client_open(server, token && *token ? token : NULL, getenv("SSL_CERT_FILE"), e);
    if (found)
        client_set_advice(found,
                          "a daemon uses the state directory, but not this address; give its settings file "
                          "with --config FILE, or its address with HEXAD_SERVER");
    free(server);
    return found;
}

static bool fetch_copy(const config *c, FILE *stream, error *e)
{
    client_reply reply = {0};
    client *daemon = open_client(c, e);
    bool ok = daemon && client_download(daemon, "/v1/backup", stream, &reply, e);
    client_close(daemon);
    if (ok && reply.status != 200) {
        json_at root = json_root(reply.document);
        ok = error_set(e, error_code_from_name(json_string(json_member(&root, "code"), "internal")),
                       "the daemon refused the backup (status %ld): %s%s", reply.status,
                       json_string(json_member(&root, "detail"), "no reason"),
                       reply.status == 401 ? "; set HEXAD_TOKEN to a token with the scope admin" : "");
    }
    client_reply_clear(&reply);
    if (ok && fflush(stream) != 0)
        ok = error_set(e, ERROR_INTERNAL, "cannot write the copy: %s", strerror(errno));
    return ok;
}

/* ---- a copy, made by a daemon or by this process */

/* Copies the database to an empty file. *lock is the lock of the directory, which the caller closes; -1: a
 * daemon holds it. */
static bool copy(const config *c, FILE *stream, const char *path, int *lock, error *e)
{
    bool in_use = false;
    *lock = lock_take(c->state_dir, &in_use, e);
    if (in_use) return fetch_copy(c, stream, e);
    return *lock >= 0 && backup_make_idle(c->state_dir, path, e);
}

static void give_up(int lock)
{
    if (lock >= 0) close(lock);
}

static bool check_whole(const char *path, error *e)
{
    char *findings = NULL;
    if (!backup_check(path, true, NULL, &findings, e)) return false;
    bool whole = !*findings;
    if (!whole)
        error_set(e, ERROR_DATABASE_DAMAGED,
                  "the database is damaged (%.*s) and was not copied; run hexad --check for all findings",
                  (int)strcspn(findings, "\n"), findings);
    free(findings);
    return whole;
}

/* Checks that the daemon that made the copy serves this state directory. HEXAD_SERVER may name another
 * daemon. */
static bool check_instance(const config *c, const char *path, error *e)
{
    size_t length = 0;
    char *file = mem_printf("%s/%s", *c->work_dir ? c->work_dir : c->state_dir, INSTANCE_CHECK_FILE_NAME);
    char *own = store_file_read(file, ADDRESS_LIMIT, &length, NULL);
    char *copied = own ? backup_read_instance(path, e) : NULL;
    bool ok = !own || copied;
    if (ok && own && *copied && strncmp(own, copied, strlen(copied)) != 0)
        ok = error_set(e, ERROR_INTERNAL,
                       "the daemon that answered belongs to instance %s, and %s to instance %.*s: unset "
                       "HEXAD_SERVER, or give the settings file of that daemon with --config FILE",
                       copied, file, (int)strcspn(own, "\n"), own);
    free(copied);
    free(own);
    free(file);
    return ok;
}

int maintenance_back_up(const config *settings)
{
    error e = {0};
    store_file file = {0};
    struct stat info;
    int lock = -1;
    if (stat(settings->backup, &info) == 0 && !S_ISREG(info.st_mode)) {
        error_set(&e, ERROR_INTERNAL, "%s is not a regular file: give the path of a file", settings->backup);
        return fail(&e);
    }
    if (!check_state_directory(settings, &e)) return fail(&e);
    store_file_clear(settings->backup); /* left by a killed process */
    bool ok = store_file_begin(settings->backup, &file, &e) &&
              copy(settings, file.stream, file.temporary, &lock, &e) && check_whole(file.temporary, &e) &&
              check_instance(settings, file.temporary, &e);
    give_up(lock);
    if (ok)
        ok = store_file_commit(&file, &e);
    else
        store_file_abort(&file);
    return ok ? EXIT_SUCCESS : fail(&e);
}

/* ---- check */

static void print_findings(const char *findings, inventory_tally *t)
{
    for (const char *line = findings; *line;) {
        size_t length = strcspn(line, "\n");
        terminal_text_print(stdout, "database damaged: %.*s\n", (int)length, line);
        t->findings++;
        line += length + (line[length] == '\n'); /* the last line may lack a line break */
    }
}

/* Prints the damage that the daemon reports. */
static bool ask_health(const config *c, inventory_tally *t, error *e)
{
    client_reply reply = {0};
    client *daemon = open_client(c, e);
    bool ok = daemon && client_call(daemon, "GET", "/readyz", NULL, 0, &reply, e);
    json_at root = json_root(reply.document);
    if (ok && strcmp(json_string(json_member(&root, "code"), ""), "database_damaged") == 0) {
        terminal_text_print(stdout, "the daemon reports: %s\n",
                            json_string(json_member(&root, "detail"), ""));
        t->findings++;
    }
    client_reply_clear(&reply);
    client_close(daemon);
    return ok;
}

static bool check_copy(const config *c, const char *path, bool alone, inventory_tally *t, error *e)
{
    char *findings = NULL;
    if (!backup_check(path, true, NULL, &findings, e)) return false;
    print_findings(findings, t);
    free(findings);
    if (!alone) return true;
    queue *q = queue_open_copy(path, e);
    bool ok = q && inventory_check(q, *c->work_dir ? c->work_dir : c->state_dir, c->contents, stdout, t, e);
    queue_close(q);
    return ok;
}

static int sum_up(const inventory_tally *t, bool alone, bool contents)
{
    if (t->findings)
        terminal_text_print(
            stdout,
            "%zu fault%s found; see operations.md, \"A damaged database\", \"Damaged files\" and \"Restore\" (package hexad-doc:"
            " /usr/share/doc/hexad-doc/doc)\n",
            t->findings, t->findings == 1 ? "" : "s");
    else if (contents)
        printf("no faults in the database and %zu results: their bytes, and those of %zu uploads, have their "
               "hashes\n",
               t->results, t->uploads);
    else if (alone)
        printf(
            "no faults in the database and %zu results: their files are there, with their lengths; --check "
            "--contents compares the bytes, too\n",
            t->results);
    else
        puts("no faults in the database; results are checked only while hexad is stopped");
    return t->findings ? EXIT_FAILURE : EXIT_SUCCESS;
}

int maintenance_check(const config *settings)
{
    error e = {0};
    inventory_tally t = {0};
    int lock = -1;
    store_file file = {0};
    char *directory = backup_directory_path(settings->state_dir),
         *path = mem_printf("%s/check.db", directory);
    bool ok = check_state_directory(settings, &e) && backup_directory_make(settings->state_dir, &e) &&
              store_file_begin(path, &file, &e) && copy(settings, file.stream, file.temporary, &lock, &e);
    const bool alone = lock >= 0;
    if (ok && settings->contents && !alone)
        ok =
            error_set(&e, ERROR_INTERNAL,
                      "--contents reads the results while no daemon uses them: stop hexad, or name a copy of "
                      "its state directory with --state_dir");
    if (ok) {
        ok = check_copy(settings, file.temporary, alone, &t, &e) && (alone || ask_health(settings, &t, &e));
    } else if (e.code == ERROR_DATABASE_DAMAGED) {
        print_findings(e.message, &t);
        ok = true;
    }
    give_up(lock);
    store_file_abort(&file);
    free(path);
    free(directory);
    if (t.findings || ok) {
        int status = sum_up(&t, alone, settings->contents);
        if (ok) return status;
    }
    return fail(&e);
}

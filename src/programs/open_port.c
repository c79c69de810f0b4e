// SPDX-License-Identifier: Apache-2.0
#include "programs/open_port.h"

#include <grp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "client/command.h"
#include "files/file.h"
#include "files/token.h"
#include "programs/systemd_units.h"
#include "service/auth/access.h"

#define ADDRESS "127.0.0.1:8642"
#define SYSTEM_GROUP "hexad" /* the group of the service (systemd/hexad-sysusers.conf) */

enum { EXIT_WRONG = 2, FILE_LIMIT = 1 << 20 /* bytes of a drop-in */ };

/* As systemd/examples/tcp.conf, which explains it. */
static const char drop_in_text[] =
    "# Made by hexad --open-port: the port of the web page, for clients of this machine with a token.\n"
    "[Socket]\n"
    "ListenStream=" ADDRESS "\n"
    "IPAddressDeny=any\n"
    "IPAddressAllow=localhost\n";

/* Writes the drop-in, unless the file exists. */
static bool write_drop_in(const char *directory, const char *path, bool *written, error *e)
{
    *written = access(path, F_OK) != 0;
    bool ok = !*written || (store_directory_create(directory, e) &&
                            store_file_write(path, drop_in_text, strlen(drop_in_text), e));
    if (ok && *written && chmod(path, 0644) != 0)
        ok = error_set(e, ERROR_INTERNAL, "%s cannot be made readable: %m", path);
    if (ok) terminal_text_print(stdout, "%s: %s\n", path, *written ? "written" : "exists already");
    return ok;
}

/* Whether systemd may not have opened the port of the drop-in: it has not read the file, or its socket is older.
 * A run that failed or was interrupted leaves such a file. */
static bool is_pending(const char *path)
{
    struct stat info;
    char *since =
        systemd_units_show("show --value --property ActiveEnterTimestamp --timestamp=unix hexad.socket");
    const long long since_s = *since == '@' ? atoll(since + 1) : 0; /* "@" and seconds */
    const bool pending = systemd_units_are_unread() || stat(path, &info) != 0 || info.st_mtime > since_s;
    free(since);
    return pending;
}

/* Makes systemd open the port of a new drop-in. The service is restarted, since a socket of a running service
 * keeps its addresses. The service is started with its socket, so that queued and interrupted jobs run without
 * waiting for a client. */
static bool start_units(bool restarts, error *e)
{
    static const char *const words[] = {"daemon-reload", "stop hexad.service hexad.socket",
                                        "start hexad.socket hexad.service"};
    const size_t count = sizeof words / sizeof *words;
    char *failed = mem_strdup("");
    for (size_t i = restarts ? 0 : count - 1; i < count; i++) systemd_units_obey(words[i], &failed);
    bool ok = !*failed ||
              error_set(e, ERROR_INTERNAL,
                        "%s failed: `journalctl -u hexad.socket -u hexad -n 20` says why. Correct it, run "
                        "`systemctl reset-failed hexad.service hexad.socket`, and then this command again",
                        failed);
    free(failed);
    return ok;
}

/* Prints the addresses that the drop-in opens. */
static bool print_addresses(const char *path, error *e)
{
    static const char key[] = "ListenStream=";
    size_t length = 0, count = 0;
    char *text = store_file_read(path, FILE_LIMIT, &length, e), *rest = text;
    if (!text) return false;
    for (char *line; (line = strsep(&rest, "\n"));) {
        const char *address = line + strlen(key);
        if (strncmp(line, key, strlen(key)) != 0 || !*address || *address == '/') continue;
        terminal_text_print(stdout, "%s http://%s%s/", count++ ? " or" : "open",
                            strchr(address, ':') ? "" : "127.0.0.1:", address);
    }
    free(text);
    if (count)
        puts(" in a browser of this machine, and sign in with the token");
    else
        terminal_text_print(stdout, "%s opens no port: add a line ListenStream=" ADDRESS "\n", path);
    return true;
}

/* The number of tokens of a user. */
static size_t count_tokens(const char *file, const char *user)
{
    token_set set = {0};
    size_t count = 0;
    if (token_set_read_of_any_owner(file, &set, NULL))
        for (size_t k = 0; k < set.count; k++) count += strcmp(set.item[k].user, user) == 0;
    token_set_clear(&set);
    return count;
}

/* Adds a token for the user and prints it, unless the user has one. Returns the exit status. */
static int ensure_token(const char *file, const char *user)
{
    const struct group *group = getgrnam(SYSTEM_GROUP);
    const command_options options = {.file = file, .file_group = group ? group->gr_gid : TOKEN_NO_GROUP};
    const size_t count = count_tokens(file, user);
    if (!count) {
        const int code = command_token_add(NULL, user, &options);
        return code == COMMAND_OK ? EXIT_SUCCESS : code == COMMAND_USAGE ? EXIT_WRONG : EXIT_FAILURE;
    }
    terminal_text_print(
        stdout,
        "%s: %s has %zu token%s already; if the text of it is lost, `hexadctl token add %s --file %s` "
        "adds another\n",
        file, user, count, count == 1 ? "" : "s", user, file);
    return EXIT_SUCCESS;
}

/* Whether systemd has the service. Otherwise prints what to do without it. */
static bool has_unit(const config *settings)
{
    char *start = systemd_units_show("show --value --property ExecStart hexad.service");
    const bool has = start[strspn(start, " \n")] != '\0';
    free(start);
    fflush(stdout);
    if (!has && *settings->token_file)
        terminal_text_print(stderr,
                            "hexad: systemd does not run hexad: set listen = unix:," ADDRESS
                            ", run \"hexadctl token add %s --file %s\", and start hexad again\n",
                            settings->admit, settings->token_file);
    else if (!has)
        terminal_text_print(stderr,
                            "hexad: systemd does not run hexad: set listen = unix:," ADDRESS
                            ", run \"hexadctl token add %s --file %s/tokens\", and start hexad again\n",
                            settings->admit, settings->state_dir);
    return has;
}

int open_port(const config *settings)
{
    error e = {0};
    if (!has_unit(settings)) return EXIT_WRONG;
    if (!access_check_name(settings->admit, false, &e)) {
        terminal_text_print(stderr, "hexad: %s\n", e.message);
        return EXIT_WRONG;
    }
    umask(0022); /* systemd reads the drop-in */
    /* the token is first: with a port and without tokens, the service does not start */
    const char *own = settings->token_file;
    const int code = ensure_token(own && *own ? own : TOKEN_SYSTEM_FILE, settings->admit);
    if (code != EXIT_SUCCESS) return code;
    char *units = systemd_units_directory(), *directory = mem_printf("%s/hexad.socket.d", units),
         *path = mem_printf("%s/tcp.conf", directory);
    bool written = false;
    const bool ok = write_drop_in(directory, path, &written, &e) &&
                    start_units(written || is_pending(path), &e) && print_addresses(path, &e);
    fflush(stdout);
    if (!ok)
        terminal_text_print(stderr, "hexad: %s%s\n", e.message,
                            geteuid() == 0 ? "" : ". Run as root: sudo hexad --open-port USER");
    free(units);
    free(directory);
    free(path);
    return ok ? EXIT_SUCCESS : EXIT_FAILURE;
}

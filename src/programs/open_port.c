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

#define ADDRESS "127.0.0.1:8642"
#define SYSTEM_GROUP "hexad" /* the group of the service (systemd/hexad-sysusers.conf) */

enum { EXIT_WRONG = 2 };

/* As systemd/examples/tcp.conf, which explains it. */
static const char drop_in_text[] =
    "# Made by hexad --open-port: the port of the web page, for clients of this machine with a token.\n"
    "[Socket]\n"
    "ListenStream=" ADDRESS "\n"
    "IPAddressDeny=any\n"
    "IPAddressAllow=localhost\n";

/* Writes the drop-in, unless the file exists. */
static bool write_drop_in(bool *written, error *e)
{
    char *units = systemd_units_directory(), *directory = mem_printf("%s/hexad.socket.d", units),
         *path = mem_printf("%s/tcp.conf", directory);
    *written = access(path, F_OK) != 0;
    bool ok = !*written || (store_directory_create(directory, e) &&
                            store_file_write(path, drop_in_text, strlen(drop_in_text), e));
    if (ok && *written && chmod(path, 0644) != 0)
        ok = error_set(e, ERROR_INTERNAL, "%s cannot be made readable: %m", path);
    if (ok) terminal_text_print(stdout, "%s: %s\n", path, *written ? "written" : "exists already");
    free(units);
    free(directory);
    free(path);
    return ok;
}

/* Makes systemd open the port. The service is restarted, since a socket of a running service keeps its
 * addresses. */
static bool restart_socket(error *e)
{
    static const char *const words[] = {"daemon-reload", "stop hexad.service hexad.socket",
                                        "start hexad.socket"};
    char *failed = mem_strdup("");
    for (size_t i = 0; i < sizeof words / sizeof *words; i++) systemd_units_obey(words[i], &failed);
    bool ok = !*failed || error_set(e, ERROR_INTERNAL,
                                    "%s failed: \"journalctl -u hexad.socket -u hexad\" says why", failed);
    free(failed);
    return ok;
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
    if (!has_unit(settings)) return EXIT_WRONG;
    error e = {0};
    const struct group *group = getgrnam(SYSTEM_GROUP);
    const command_options options = {
        .file = settings->token_file && *settings->token_file ? settings->token_file : TOKEN_SYSTEM_FILE,
        .file_group = group ? group->gr_gid : TOKEN_NO_GROUP};
    bool written = false;
    umask(0022); /* systemd reads the drop-in */
    /* the token is first: with a port and without tokens, the service does not start */
    const int code = command_token_add(NULL, settings->admit, &options);
    if (code != COMMAND_OK) return code == COMMAND_USAGE ? EXIT_WRONG : EXIT_FAILURE;
    if (write_drop_in(&written, &e) && (!written || restart_socket(&e))) {
        puts(written ? "open http://" ADDRESS
                       "/ in a browser of this machine, and sign in with the token above"
                     : "the file names the port: open it in a browser, and sign in with the token above");
        return EXIT_SUCCESS;
    }
    fflush(stdout);
    terminal_text_print(stderr, "hexad: %s%s\n", e.message,
                        geteuid() == 0 ? "" : ". Run as root: sudo hexad --open-port USER");
    return EXIT_FAILURE;
}

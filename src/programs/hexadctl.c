/* hexadctl: the client. Reads the command line and calls the command. */
#include <grp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "config.h"

#include "auth/token.h"
#include "client/client.h"
#include "client/command.h"

/* The socket of the service that systemd runs, and that of other services. */
#define SYSTEM_SOCKET "/run/hexad/hexad.sock"
#define STATE_SOCKET HEXAD_STATEDIR "/hexad.sock"
/* The service that systemd runs reads the first, and has a group of its own (systemd/hexad-sysusers.conf). */
#define SYSTEM_TOKENS "/etc/hexad/tokens"
#define SYSTEM_GROUP "hexad"
#define STATE_TOKENS HEXAD_STATEDIR "/tokens"

static const char usage[] =
    "usage: hexadctl [--server URL] [--json] COMMAND ...\n"
    "\n"
    "  submit SPEC.json|- [--wait]      submit a job and print its id\n"
    "  list [--state STATE] [--limit N] list the newest jobs\n"
    "  show ID                          print the state of a job; everything with --json\n"
    "  wait ID                          wait for the end of a job and show its progress\n"
    "  cancel ID                        cancel a job, whether it waits or runs\n"
    "  fetch ID [--output DIR]          download and verify the results, into DIR or ./ID\n"
    "\n"
    "  pause ID, resume ID              start no more attempts of a job; allow them again\n"
    "  retry ID                         run the failed tasks of a job again\n"
    "  delete ID                        delete a job that has ended, with its results\n"
    "  priority ID --priority N         change the priority of a job\n"
    "  watch ID                         print the events of a job as they happen, as lines of JSON\n"
    "  log ID                           print the log of the last attempt of a job\n"
    "  workers                          list the running attempts, and the limits\n"
    "  drain, undrain                   accept and start no more jobs; accept and start them again\n"
    "  token add USER [--scopes LIST]   create a token for the REST interface and print it, once\n"
    "  token list                       list the tokens\n"
    "  token revoke ID                  revoke a token; it is refused at once\n"
    "\n"
    "  --server URL   unix:/path or http://HOST:PORT; default: $HEXAD_SERVER, otherwise\n"
    "                 unix:" SYSTEM_SOCKET " if that exists, otherwise\n"
    "                 unix:" STATE_SOCKET "\n"
    "  --scopes LIST  of read, submit, cancel, admin; default: read,submit,cancel\n"
    "  --file FILE    the daemon's token_file; default: " SYSTEM_TOKENS " (of the service that\n"
    "                 systemd runs) if the group " SYSTEM_GROUP " exists, otherwise\n"
    "                 " STATE_TOKENS "\n"
    "  --json         print the JSON documents of the server\n"
    "  --help, --version\n"
    "\n"
    "A server that needs a token gets the one in $HEXAD_TOKEN.\n"
    "\n"
    "Exit status: 0 done (after waiting for a job: it succeeded and converged), 1 the job failed or\n"
    "timed out, 2 bad usage or a spec that the server refuses, 3 no server answers, 4 no such job or\n"
    "no results, 6 the job was cancelled, 10 the job succeeded but did not converge.\n";

static const struct entry {
    const char *name;
    command *run;
    bool argument;
} commands[] = {
    {"submit", command_submit, true},
    {"list", command_list, false},
    {"show", command_show, true},
    {"wait", command_wait, true},
    {"cancel", command_cancel, true},
    {"fetch", command_fetch, true},
    {"pause", command_pause, true},
    {"resume", command_resume, true},
    {"retry", command_retry, true},
    {"delete", command_delete, true},
    {"priority", command_priority, true},
    {"watch", command_watch, true},
    {"log", command_log, true},
    {"workers", command_workers, false},
    {"drain", command_drain, false},
    {"undrain", command_undrain, false},
    {"token add", command_token_add, true},
    {"token list", command_token_list, false},
    {"token revoke", command_token_revoke, true},
};

typedef struct line {
    const struct entry *entry;
    const char *group; /* the first of a command's two words */
    const char *argument, *server;
    command_options options;
} line;

/* The value of `--name VALUE` or `--name=VALUE`; moves *index over a separate value. NULL when it is another
 * option, or has no value. */
static const char *option_value(const char *name, int argc, char **argv, int *index)
{
    size_t length = strlen(name);
    if (strncmp(argv[*index], name, length) != 0) return NULL;
    if (argv[*index][length] == '=') return argv[*index] + length + 1;
    if (argv[*index][length] || *index + 1 >= argc) return NULL;
    return argv[++*index];
}

static bool take_option(line *l, int argc, char **argv, int *index)
{
    const char *value;
    if (strcmp(argv[*index], "--json") == 0)
        l->options.json = true;
    else if (strcmp(argv[*index], "--wait") == 0)
        l->options.wait = true;
    else if ((value = option_value("--server", argc, argv, index)))
        l->server = value;
    else if ((value = option_value("--state", argc, argv, index)))
        l->options.state = value;
    else if ((value = option_value("--limit", argc, argv, index)))
        l->options.limit = value;
    else if ((value = option_value("--output", argc, argv, index)))
        l->options.output = value;
    else if ((value = option_value("--priority", argc, argv, index)))
        l->options.priority = value;
    else if ((value = option_value("--file", argc, argv, index)))
        l->options.file = value;
    else if ((value = option_value("--scopes", argc, argv, index)))
        l->options.scopes = value;
    else
        return false;
    return true;
}

/* Whether the word names the command, within its group if it has one. */
static bool is_named(const struct entry *entry, const char *group, const char *word)
{
    size_t length = group ? strlen(group) : 0;
    if (!group) return strcmp(entry->name, word) == 0;
    return strncmp(entry->name, group, length) == 0 && entry->name[length] == ' ' &&
           strcmp(entry->name + length + 1, word) == 0;
}

static bool take_word(line *l, const char *word)
{
    if (l->entry) {
        if (!l->entry->argument || l->argument) return false;
        l->argument = word;
        return true;
    }
    for (size_t i = 0; i < sizeof commands / sizeof *commands && !l->entry; i++)
        if (is_named(&commands[i], l->group, word)) l->entry = &commands[i];
    if (l->entry || l->group) return l->entry != NULL;
    l->group = word;
    size_t length = strlen(word);
    for (size_t i = 0; i < sizeof commands / sizeof *commands; i++)
        if (strncmp(commands[i].name, word, length) == 0 && commands[i].name[length] == ' ') return true;
    return false;
}

static bool is_print_only(int argc, char **argv)
{
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "-h") == 0) return fputs(usage, stdout) >= 0;
        if (strcmp(argv[i], "--version") == 0) return puts(PACKAGE_STRING) >= 0;
    }
    return false;
}

/* The value of an environment variable; NULL when it has none. */
static const char *environment(const char *name)
{
    const char *value = getenv(name);
    return value && *value ? value : NULL;
}

static const char *default_server(void)
{
    const char *server = environment("HEXAD_SERVER");
    if (server) return server;
    return access(SYSTEM_SOCKET, F_OK) == 0 ? "unix:" SYSTEM_SOCKET : "unix:" STATE_SOCKET;
}

static void set_default_tokens(command_options *options)
{
    const struct group *group = getgrnam(SYSTEM_GROUP);
    options->file = group ? SYSTEM_TOKENS : STATE_TOKENS;
    options->file_group = group ? group->gr_gid : TOKEN_NO_GROUP;
}

int main(int argc, char **argv)
{
    line l = {.server = default_server(), .options.file_group = TOKEN_NO_GROUP};
    if (is_print_only(argc, argv)) return COMMAND_OK;
    for (int i = 1; i < argc; i++) {
        bool option = argv[i][0] == '-' && argv[i][1];
        if (option ? take_option(&l, argc, argv, &i) : take_word(&l, argv[i])) continue;
        fprintf(stderr, "hexadctl: unknown argument %s; see --help\n", argv[i]);
        return COMMAND_USAGE;
    }
    if (!l.entry || (l.entry->argument && !l.argument)) {
        fputs(usage, stderr);
        return COMMAND_USAGE;
    }
    if (!l.options.file) set_default_tokens(&l.options);
    error e = {0};
    client *c = client_open(l.server, environment("HEXAD_TOKEN"), &e);
    if (!c) {
        fprintf(stderr, "hexadctl: %s\n", e.message);
        return COMMAND_USAGE;
    }
    int code = l.entry->run(c, l.argument, &l.options);
    client_close(c);
    return code;
}

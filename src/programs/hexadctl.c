/* hexadctl: the client. Reads the command line and calls the command. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "config.h"

#include "client/client.h"
#include "client/command.h"

#define DEFAULT_SERVER "http://127.0.0.1:8642"

static const char usage[] =
    "usage: hexadctl [--server URL] [--json] COMMAND ...\n"
    "\n"
    "  submit SPEC.json|- [--wait]      queue a job; prints its id\n"
    "  list [--state STATE] [--limit N] the newest jobs\n"
    "  show ID                          state of a job; all of it with --json\n"
    "  wait ID                          wait for the end of a job, showing its progress\n"
    "  cancel ID                        take a job out of the queue, or stop it\n"
    "  fetch ID [--output DIR]          the results, verified; into DIR, else into ./ID\n"
    "\n"
    "  --server URL   http://HOST:PORT or unix:/path; default: $HEXAD_SERVER, else " DEFAULT_SERVER
    "\n"
    "  --json         print documents as the server gives them\n"
    "  --help, --version\n"
    "\n"
    "Exit status: 0 done (a job waited for: succeeded and converged), 1 the job failed or ran out "
    "of\n"
    "time, 2 bad usage or a spec that is refused, 3 no server answers, 4 no such job or no "
    "results,\n"
    "6 the job was cancelled, 10 the job succeeded but did not converge.\n";

static const struct entry {
    const char *name;
    command *run;
    bool argument;
} commands[] = {
    {"submit", command_submit, true}, {"list", command_list, false},
    {"show", command_show, true},     {"wait", command_wait, true},
    {"cancel", command_cancel, true}, {"fetch", command_fetch, true},
};

typedef struct line {
    const struct entry *entry;
    const char *argument, *server;
    command_options options;
} line;

/* `--name VALUE` or `--name=VALUE`; moves *index over a value of its own. NULL when it is another
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
    else
        return false;
    return true;
}

static bool take_word(line *l, const char *word)
{
    if (l->entry) {
        if (!l->entry->argument || l->argument) return false;
        l->argument = word;
        return true;
    }
    for (size_t i = 0; i < sizeof commands / sizeof *commands && !l->entry; i++)
        if (strcmp(commands[i].name, word) == 0) l->entry = &commands[i];
    return l->entry != NULL;
}

static bool is_print_only(int argc, char **argv)
{
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "-h") == 0)
            return fputs(usage, stdout) >= 0;
        if (strcmp(argv[i], "--version") == 0) return puts(PACKAGE_STRING) >= 0;
    }
    return false;
}

int main(int argc, char **argv)
{
    const char *environment = getenv("HEXAD_SERVER");
    line l = {.server = environment && *environment ? environment : DEFAULT_SERVER};
    if (is_print_only(argc, argv)) return COMMAND_OK;
    for (int i = 1; i < argc; i++) {
        bool option = argv[i][0] == '-' && argv[i][1];
        if (option ? take_option(&l, argc, argv, &i) : take_word(&l, argv[i])) continue;
        fprintf(stderr, "hexadctl: %s is not understood; see --help\n", argv[i]);
        return COMMAND_USAGE;
    }
    if (!l.entry || (l.entry->argument && !l.argument)) {
        fputs(usage, stderr);
        return COMMAND_USAGE;
    }
    error e = {0};
    client *c = client_open(l.server, &e);
    if (!c) {
        fprintf(stderr, "hexadctl: %s\n", e.message);
        return COMMAND_USAGE;
    }
    int code = l.entry->run(c, l.argument, &l.options);
    client_close(c);
    return code;
}

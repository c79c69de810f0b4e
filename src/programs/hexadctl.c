// SPDX-License-Identifier: Apache-2.0
/* hexadctl: the command-line client. Parses the command line and calls the command. */
#include <grp.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "config.h"

#include "files/token.h"
#include "base/core/help_text.h"
#include "base/core/memory.h"
#include "base/core/nearest_name.h"
#include "base/core/options.h"
#include "base/core/terminal_text.h"
#include "client/client.h"
#include "client/command.h"
#include "client/job_name.h"
#include "spec/sample_spec.h"

/* The socket of the systemd service, and the name of the socket of other services. */
#define SYSTEM_SOCKET "/run/hexad/hexad.sock"
#define STATE_SOCKET HEXAD_STATEDIR "/hexad.sock"
/* The group of the systemd service (systemd/hexad-sysusers.conf). */
#define SYSTEM_GROUP "hexad"
#define STATE_TOKENS HEXAD_STATEDIR "/tokens"

/* Where texts of the help begin. */
enum { HELP_COLUMN = 20 };

typedef enum need { NONE, ONE, FILES, JOB, JOB_FILES, MAYBE_JOB, JOBS, MAYBE_JOBS } need;

static const struct entry {
    option_rank rank;
    const char *name;
    command *run;
    need argument;
    const char *arguments; /* with the options of the command; all commands have --server and --json */
    const char *text;
} commands[] = {
    {OPTION_BASIC, "sample", command_sample, ONE,
     "FILE [--on-service] [--count N | --spacing S] [--grade curvature[=RATIO]] [--pattern blue_noise] "
     "[--set /MEMBER=VALUE]... [--frames FRAMES] [--name NAME] [--output DIR] [--accept]",
     "from a file to points: send FILE, sample it, wait, and download the result. The job has the first spec "
     "that inspect suggests. The result and the spec (" SAMPLE_SPEC_NAME
     ") are downloaded into DIR, which has no files, or into ./NAME for NAME.obj, which does not exist. "
     "--on-service: FILE is a path of the service, as in a spec. --count: the number of points; --spacing: their "
     "distance; --grade: closer together where the surface is curved, by up to RATIO (default 4); --pattern "
     "blue_noise: without regular order; --frames: FILE is a pattern such as a.####.obj, whose first frame is "
     "inspected; --accept: see wait"},
    {OPTION_BASIC, "submit", command_submit, ONE,
     "SPEC|- [--wait [--accept]] [--set /MEMBER=VALUE]... [--name NAME] [--frames FRAMES] [--files PATTERN] "
     "[--depends-on ID]... [--priority N] [--label LABEL]... [--key KEY]",
     "submit a job and print its ID. --name, --frames, --files and --priority replace the value in the spec; "
     "--label and --depends-on add one. --files: one frame for each file of the service that matches, such as "
     "'meshes/*.ply', at {file} in the spec. With KEY, any text, a repeated submission prints the ID of the first "
     "one and creates no second job. If the service detects within 0.2 s that the inputs have a fault, submit "
     "prints a warning; the exit code stays 0"},
    {OPTION_ADVANCED, "attach", command_attach, JOB_FILES,
     "ID PATH... [--frame N] [--frames FRAMES] [--wait [--accept]] [--name NAME] [--priority N] "
     "[--label LABEL]... [--key KEY]",
     "submit a job that places the points of a job (of frame N of an array) on other frames of its meshes; PATH "
     "is the path of a mesh as in a spec, one for each mesh of the surface. With #### in PATH the job is an array "
     "of FRAMES. --name: the default is that of the job and the word attached"},
    {OPTION_BASIC, "validate", command_validate, ONE, "SPEC|-",
     "check a spec as submit would, without submitting it"},
    {OPTION_BASIC, "estimate", command_estimate, ONE, "SPEC|-",
     "print the points, memory and time that a job requires; of an array, its first frame"},
    {OPTION_BASIC, "upload", command_upload, FILES, "FILE...",
     "send files that jobs may read, and print the path of each for a spec. #### (or %04d, $F4) in a quoted file "
     "name matches all numbers"},
    {OPTION_ADVANCED, "uploads", command_uploads, NONE, "",
     "list your uploads, the newest first: name, size, time since the upload and the last use, number of your "
     "jobs that read it, and path for use in a spec"},
    {OPTION_ADVANCED, "delete-upload", command_delete_upload, FILES, "FILE... [--all]",
     "delete uploads of yours; FILE is a path that upload printed, or the name of the file if only one upload has "
     "it. Jobs that have not ended can still read the file. --all: as an administrator, delete it for all users "
     "at once; jobs that read it then fail"},
    {OPTION_BASIC, "inspect", command_inspect, ONE, "PATH",
     "describe a file that jobs may read, and print specs that sample it. PATH is written as in a spec"},
    {OPTION_BASIC, "list", command_list, NONE,
     "[--state STATES] [--owner USER] [--label LABEL] [--name NAME] [--text PART] [--since TIME] [--until TIME] "
     "[--limit N]",
     "list the newest jobs of all users. --owner: those of one user; --text: those whose name contains PART, "
     "ignoring case; TIME is 2026-01-31T18:00:00Z, 2026-01-31 (UTC), or an age: 30s, 90m, 2h or 1d"},
    {OPTION_BASIC, "show", command_show, JOB, "ID [--picture FILE.png [--frame N]]",
     "print the state, times, attempts and failed frames of a job. --json: all members. --picture writes its "
     "preview, or that of the frame N of an array"},
    {OPTION_ADVANCED, "attempts", command_attempts, JOB, "ID", "list all attempts of a job"},
    {OPTION_BASIC, "wait", command_wait, JOBS, "ID... [--accept]",
     "wait until jobs end and show their progress. The exit status is that of the worst outcome. --accept: an "
     "outcome that the job's queue.accept contains counts as 0"},
    {OPTION_BASIC, "cancel", command_cancel, MAYBE_JOBS, "ID... [--yes] | --label LABEL [--owner USER]",
     "cancel waiting and running jobs. --label: all your unfinished jobs with this label; as an administrator, "
     "those of all users"},
    {OPTION_BASIC, "fetch", command_fetch, MAYBE_JOB,
     "ID [--frame FRAMES] [--output DIR] | --label LABEL [--owner USER] [--output DIR]",
     "download and verify the results. They are in DIR; by default in ./ID or, if ID is the name of the job and "
     "./NAME is free or has this result, in ./NAME. Of an array all frames, or FRAMES (7, 1-100, 1-9x2,20), each "
     "in DIR/FRAME. Files that are already complete are not downloaded again: repeat an interrupted fetch. A "
     "directory with the result of another job is refused. --label: all your jobs with this label, or those of "
     "USER, in DIR or ./LABEL: each in a directory with its name, or with its ID if several jobs have this name"},
    {OPTION_BASIC, "log", command_log, JOB, "ID [--frame N] [--attempt K]",
     "print the log of the last attempt of a job, or of a frame of an array"},
    {OPTION_ADVANCED, "pause", command_pause, JOB, "ID",
     "start no more attempts of a job; running attempts continue"},
    {OPTION_ADVANCED, "resume", command_resume, JOB, "ID", "start attempts of a paused job again"},
    {OPTION_ADVANCED, "retry", command_retry, JOBS, "ID... [--dependents]",
     "run the tasks of jobs again that have failed, timed out or were cancelled; with --dependents also the jobs "
     "that ended as dependency_failed because of them"},
    {OPTION_ADVANCED, "deliver", command_deliver, JOB, "ID",
     "copy the results of a job to its output directory again, and wait for the end of the copy; the exit status "
     "is 1 when it failed"},
    {OPTION_BASIC, "delete", command_delete, JOBS, "ID... [--yes]",
     "delete jobs that have ended, with their results"},
    {OPTION_ADVANCED, "priority", command_priority, JOB, "ID --priority N", "change the priority of a job"},
    {OPTION_ADVANCED, "watch", command_watch, MAYBE_JOB, "[ID]",
     "print the events of a job as lines of JSON until it ends; without ID, the new events of all your jobs (as "
     "an administrator, of all users)"},
    {OPTION_BASIC, "workers", command_workers, NONE, "",
     "list the running attempts, the limits, and why jobs wait"},
    {OPTION_ADVANCED, "usage", command_usage, NONE, "",
     "print the disk space of results and of uploads, in total and for each user, and the bounds"},
    {OPTION_ADVANCED, "drain", command_drain, NONE, "", "accept and start no jobs"},
    {OPTION_ADVANCED, "undrain", command_undrain, NONE, "", "accept and start jobs again"},
    {OPTION_ADVANCED, "hold", command_hold, NONE, "", "accept jobs but start none, also after a restart"},
    {OPTION_ADVANCED, "release", command_release, NONE, "", "start jobs again after hold"},
    {OPTION_ADVANCED, "token add", command_token_add, ONE,
     "USER [--scopes LIST] [--max-priority N] [--file FILE]",
     "create a token for the REST interface and print it once; N is the highest priority that the token may give "
     "to jobs"},
    {OPTION_ADVANCED, "token list", command_token_list, NONE, "[--file FILE]", "list the tokens"},
    {OPTION_ADVANCED, "token revoke", command_token_revoke, ONE, "ID [--file FILE]",
     "revoke a token, with immediate effect"},
};
enum { COMMAND_COUNT = sizeof commands / sizeof *commands };

/* Arguments of several commands. */
static const struct {
    option_rank rank;
    const char *term, *text;
} explained[] = {
    {OPTION_BASIC, "help [COMMAND]",
     "print this text, or all about one command; --help all: about all of them"},
    {OPTION_BASIC, "--server URL",
     "unix:/path, http://HOST:PORT or https://HOST:PORT. The default is $HEXAD_SERVER, otherwise "
     "unix:" SYSTEM_SOCKET " if that exists, otherwise unix:" STATE_SOCKET},
    {OPTION_BASIC, "ID",
     "the ID of a job, or latest, your newest job. At least the first 8 characters of an ID, or a name, are "
     "enough if only one of your jobs has it. For cancel and delete, all but the whole ID require --yes"},
    {OPTION_BASIC, "--set /MEMBER=VALUE",
     "a member of the spec and its value, JSON or a text: --set /output/mesh=true. hexad-worker spec-help lists "
     "the members"},
    {OPTION_ADVANCED, "--label LABEL", "a word, often of the form key=value"},
    {OPTION_ADVANCED, "--state STATES",
     "blocked, queued, paused, running, cancelling, succeeded, failed, cancelled or timed_out; several are "
     "separated by commas"},
    {OPTION_ADVANCED, "--scopes LIST",
     "one or more of read, submit, cancel, admin; default: read,submit,cancel"},
    {OPTION_ADVANCED, "--file FILE",
     "the daemon's token_file; default: " TOKEN_SYSTEM_FILE
     " (of the service that systemd runs) if the group " SYSTEM_GROUP " exists, otherwise " STATE_TOKENS},
    {OPTION_BASIC, "--json", "print the JSON documents of the server"},
    {OPTION_ADVANCED, "--help, --version", ""},
};

static const char usage[] = "usage: hexadctl [--server URL] [--json] COMMAND ...\n";

static const char notes[] =
    "\n"
    "hexadctl sends the token in $HEXAD_TOKEN to a server that requires one. The certificate of an https\n"
    "server must be signed by one in the file $SSL_CERT_FILE or, without that variable, by one that the\n"
    "system trusts.\n"
    "\n"
    "Names, messages and logs may contain characters that a terminal would execute or not display: control,\n"
    "direction and invisible characters are printed as \\u{202e}, and bytes that are not UTF-8 as \\x{9b}. --json\n"
    "prints documents as they are.\n"
    "\n"
    "Exit status: 0 done (after waiting for a job: it succeeded and converged), 1 the job failed or\n"
    "timed out, or the server is unable to do this now, 2 bad usage, a missing, unknown or insufficient\n"
    "token, or another refused request such as a bad spec, 3 the server does not answer, 4 the job does\n"
    "not exist, its state does not allow this, or it or a requested frame has no results, 6 the job was\n"
    "cancelled, 10 the job succeeded but did not converge, 11 its points do not represent the surface\n"
    "(outcome unresolved).\n";

typedef struct line {
    const struct entry *entry;
    const char *group;     /* the first of a command's two words */
    const char **argument; /* has space for all words of the command line */
    size_t argument_count;
    command_options options;
    bool given[OPTIONS_MOST]; /* per option */
} line;

#define OPTION(option, its_kind, member)                                                       \
    {                                                                                          \
        .name = option, .kind = OPTION_##its_kind, .offset = offsetof(command_options, member) \
    }

/* The first ones are of all commands, the others of those whose arguments have them. */
static const option_row option_rows[] = {
    OPTION("server", WORD, server),
    OPTION("json", FLAG, json),
    OPTION("key", WORD, key),
    OPTION("owner", WORD, owner),
    OPTION("state", WORD, state),
    OPTION("limit", WORD, limit),
    OPTION("priority", WORD, priority),
    OPTION("frame", WORD, frame),
    OPTION("attempt", WORD, attempt),
    OPTION("output", WORD, output),
    OPTION("file", WORD, file),
    OPTION("scopes", WORD, scopes),
    OPTION("name", WORD, name),
    OPTION("since", WORD, since),
    OPTION("until", WORD, until),
    OPTION("max-priority", WORD, max_priority),
    OPTION("text", WORD, text),
    OPTION("picture", WORD, picture),
    OPTION("frames", WORD, frames),
    OPTION("count", WORD, count),
    OPTION("spacing", WORD, spacing),
    OPTION("grade", WORD, grade),
    OPTION("pattern", WORD, pattern),
    OPTION("files", WORD, files),
    OPTION("label", WORDS, label),
    OPTION("set", WORDS, set),
    OPTION("depends-on", WORDS, depends_on),
    OPTION("wait", FLAG, wait),
    OPTION("dependents", FLAG, dependents),
    OPTION("yes", FLAG, yes),
    OPTION("accept", FLAG, accept),
    OPTION("on-service", FLAG, on_service),
    OPTION("all", FLAG, all),
};
enum { OPTION_COUNT = sizeof option_rows / sizeof *option_rows, OF_ALL_COMMANDS = 2 };
static const option_table known_options = {"hexadctl", option_rows, OPTION_COUNT};

static void print_help_of_entry(FILE *file, const struct entry *entry, bool brief)
{
    char *term = mem_printf("%s %s", entry->name, entry->arguments);
    help_text_item(file, HELP_COLUMN, term, entry->text, brief);
    free(term);
}

/* Prints what commands, options and arguments mean, up to a rank. */
static void print_help(FILE *file, option_rank last)
{
    const bool brief = last == OPTION_BASIC;
    fputs(usage, file);
    for (option_rank rank = OPTION_BASIC; rank <= last; rank++) {
        fputc('\n', file);
        for (size_t i = 0; i < COMMAND_COUNT; i++)
            if (commands[i].rank == rank) print_help_of_entry(file, &commands[i], brief);
    }
    fputc('\n', file);
    for (size_t i = 0; i < sizeof explained / sizeof *explained; i++)
        if (explained[i].rank <= last)
            help_text_item(file, HELP_COLUMN, explained[i].term, explained[i].text, brief);
    if (!brief) fputs(notes, file);
}

/* Whether the word names the command, within its group if it has one. */
static bool is_named(const struct entry *entry, const char *group, const char *word)
{
    size_t length = group ? strlen(group) : 0;
    if (!group) return strcmp(entry->name, word) == 0;
    return strncmp(entry->name, group, length) == 0 && entry->name[length] == ' ' &&
           strcmp(entry->name + length + 1, word) == 0;
}

/* Prints the error for an unknown command. `group` is the first of two words, or NULL. */
static bool refuse_command(const char *group, const char *word)
{
    char *given = group ? mem_printf("%s %s", group, word) : mem_strdup(word);
    nearest_name n = nearest_name_to(given, strlen(given));
    for (size_t i = 0; i < COMMAND_COUNT; i++) nearest_name_offer(&n, commands[i].name);
    nearest_name_offer(&n, "token");
    if (n.name)
        terminal_text_print(stderr, "hexadctl: unknown command %s; did you mean %s?\n", given, n.name);
    else
        terminal_text_print(stderr, "hexadctl: unknown command %s; see hexadctl --help\n", given);
    free(given);
    return false;
}

/* The advice about an argument that the command does not accept. */
static const char *hint_of(const char *name)
{
    if (strcmp(name, "priority") == 0) return "write the number as --priority N";
    if (strcmp(name, "hold") == 0) return "use \"hexadctl pause ID\" to stop one job";
    if (strcmp(name, "release") == 0) return "use \"hexadctl resume ID\" to start one job";
    return "see hexadctl --help";
}

static bool take_word(line *l, const char *word)
{
    if (l->entry) {
        bool several = l->entry->argument == FILES || l->entry->argument == JOB_FILES ||
                       l->entry->argument == JOBS || l->entry->argument == MAYBE_JOBS;
        if (l->entry->argument == NONE || (l->argument_count && !several)) {
            terminal_text_print(stderr, "hexadctl %s: unexpected argument %s; %s\n", l->entry->name, word,
                                hint_of(l->entry->name));
            return false;
        }
        l->argument[l->argument_count++] = word;
        return true;
    }
    for (size_t i = 0; i < COMMAND_COUNT && !l->entry; i++)
        if (is_named(&commands[i], l->group, word)) l->entry = &commands[i];
    if (l->entry) return true;
    const char *group = l->group;
    l->group = word;
    size_t length = strlen(word);
    for (size_t i = 0; i < COMMAND_COUNT && !group; i++)
        if (strncmp(commands[i].name, word, length) == 0 && commands[i].name[length] == ' ') return true;
    if (strcmp(word, "status") != 0) return refuse_command(group, word);
    fputs(
        "hexadctl: unknown command status; use \"hexadctl workers\" for the service, or \"hexadctl show ID\" for a job\n",
        stderr);
    return false;
}

/* Whether the arguments of the command have the option. */
static bool has_option(const struct entry *entry, const char *name)
{
    char option[32];
    const size_t length = (size_t)snprintf(option, sizeof option, "--%s", name);
    const char *at = strstr(entry->arguments, option);
    while (at && strspn(at + length, "abcdefghijklmnopqrstuvwxyz-") > 0) at = strstr(at + length, option);
    return at != NULL;
}

/* Checks that the command is complete and that all options belong to it. */
static bool check(const line *l)
{
    if (!l->entry) {
        print_help(stderr, OPTION_BASIC);
        return false;
    }
    for (size_t i = OF_ALL_COMMANDS; i < OPTION_COUNT; i++) {
        if (!l->given[i] || has_option(l->entry, option_rows[i].name)) continue;
        terminal_text_print(stderr, "hexadctl %s: this command has no option --%s; see hexadctl --help\n",
                            l->entry->name, option_rows[i].name);
        return false;
    }
    bool needed = l->entry->argument == ONE || l->entry->argument == FILES || l->entry->argument == JOB ||
                  l->entry->argument == JOBS;
    if (l->entry->argument == JOB_FILES && l->argument_count < 2) {
        terminal_text_print(stderr,
                            "hexadctl %s: the arguments ID and PATH are required; see hexadctl --help\n",
                            l->entry->name);
        return false;
    }
    if (!needed || l->argument_count) return true;
    terminal_text_print(stderr, "hexadctl %s: the argument %.*s is missing; see hexadctl --help\n",
                        l->entry->name, (int)strcspn(l->entry->arguments, " .|"), l->entry->arguments);
    return false;
}

/* Prints the help of the command, or of the commands of the group. False: there is none. */
static bool print_help_of(const char *name)
{
    const size_t length = strlen(name);
    bool shown = false;
    for (size_t i = 0; i < COMMAND_COUNT; i++) {
        const char *end = commands[i].name + length;
        if (strncmp(commands[i].name, name, length) != 0 || (*end && *end != ' ')) continue;
        if (!shown) fputs(usage, stdout), puts("");
        print_help_of_entry(stdout, &commands[i], false);
        shown = true;
    }
    if (shown) puts("\nhexadctl --help all explains ID, options of all commands, and the exit status.");
    return shown;
}

/* Prints the help of the command that the words name, otherwise of the program. Returns an exit code. `asked`:
 * the words are arguments of `help`, which refuses unknown commands. */
static int print_help_for(const char *const *word, size_t count, bool asked)
{
    const bool all = count > 0 && strcmp(word[0], "all") == 0;
    char *both = count > 1 ? mem_printf("%s %s", word[0], word[1]) : NULL;
    /* the second word may be an argument of the command */
    bool found = (both && print_help_of(both)) || (count > 0 && print_help_of(word[0]));
    free(both);
    if (found) return COMMAND_OK;
    if (asked && count > 0 && !all) return refuse_command(NULL, word[0]) ? COMMAND_OK : COMMAND_USAGE;
    print_help(stdout, all ? OPTION_RESEARCH : OPTION_BASIC);
    return ferror(stdout) ? COMMAND_FAILED : COMMAND_OK;
}

/* Whether the command line requests a text only. *code is then the exit code, after printing it. */
static bool is_print_only(int argc, char **argv, int *code)
{
    const char *word[2] = {NULL};
    size_t count = 0;
    const bool asked = argc > 1 && strcmp(argv[1], "help") == 0;
    bool help = asked;
    for (int i = asked ? 2 : 1; i < argc && strcmp(argv[i], "--") != 0; i++) {
        if (strcmp(argv[i], "--version") == 0) {
            *code = puts("hexadctl " PACKAGE_VERSION) >= 0 ? COMMAND_OK : COMMAND_FAILED;
            return true;
        }
        help = help || strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "-h") == 0;
        if (argv[i][0] != '-' && count < 2) word[count++] = argv[i];
    }
    if (help) *code = print_help_for(word, count, asked);
    return help;
}

/* The value of an environment variable; NULL if it is unset or empty. */
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
    options->file = group ? TOKEN_SYSTEM_FILE : STATE_TOKENS;
    options->file_group = group ? group->gr_gid : TOKEN_NO_GROUP;
}

/* Finds the ids of the jobs that the arguments name, or prints an error. A command that cannot be undone
 * accepts another name than the whole ID only with --yes. */
static int resolve_jobs(client *c, const line *l, char **ids)
{
    bool final = has_option(l->entry, "yes");
    int code = COMMAND_OK;
    for (size_t i = 0; code == COMMAND_OK && i < l->argument_count; i++) {
        const char *name = l->argument[i];
        code = job_name_resolve(c, name, &ids[i]);
        if (code != COMMAND_OK || !final || l->options.yes || !job_name_is_short(name)) continue;
        terminal_text_print(stderr, "hexadctl %s: %s names the job %s: give this ID, or add --yes\n",
                            l->entry->name, name, ids[i]);
        code = COMMAND_USAGE;
    }
    return code;
}

/* The worse of two exit codes. */
static int worse_of(int a, int b)
{
    static const int from_best[] = {COMMAND_OK,        COMMAND_NOT_CONVERGED, COMMAND_UNRESOLVED,
                                    COMMAND_CANCELLED, COMMAND_FAILED,        COMMAND_MISSING,
                                    COMMAND_USAGE,     COMMAND_UNREACHABLE};
    for (size_t i = 0; i < sizeof from_best / sizeof *from_best; i++) {
        if (a == from_best[i]) return b;
        if (b == from_best[i]) return a;
    }
    return a;
}

/* Runs the command for each name. Returns the worst exit code. */
static int run_for_each(client *c, const line *l, const char *const *name)
{
    int code = COMMAND_OK;
    for (size_t i = 0; i < l->argument_count; i++)
        code = worse_of(code, l->entry->run(c, name[i], &l->options));
    return code;
}

static int run_for_jobs(client *c, const line *l)
{
    char **ids = mem_alloc(l->argument_count * sizeof *ids);
    for (size_t i = 0; i < l->argument_count; i++) ids[i] = NULL;
    int code = resolve_jobs(c, l, ids);
    if (code == COMMAND_OK) code = run_for_each(c, l, (const char *const *)ids);
    mem_free_texts(ids, l->argument_count);
    return code;
}

/* Runs a command with a job and files. */
static int run_for_job_and_files(client *c, const line *l)
{
    command_options options = l->options;
    char *id = NULL;
    options.mesh = l->argument + 1;
    options.mesh_count = l->argument_count - 1;
    int code = job_name_resolve(c, l->argument[0], &id);
    if (code == COMMAND_OK) code = l->entry->run(c, id, &options);
    free(id);
    return code;
}

static int run(client *c, line *l)
{
    if (l->entry->argument == JOB_FILES) return run_for_job_and_files(c, l);
    if (l->entry->argument == FILES) return run_for_each(c, l, l->argument);
    bool named = l->entry->argument != NONE && l->entry->argument != ONE && l->argument_count;
    if (named && l->argument_count == 1) l->options.called = l->argument[0];
    if (named) return run_for_jobs(c, l);
    return l->entry->run(c, l->argument_count ? l->argument[0] : NULL, &l->options);
}

/* Opens the client and runs the command. */
static int obey(line *l)
{
    error e = {0};
    l->options.several = l->argument_count > 1;
    if (!l->options.file) set_default_tokens(&l->options);
    client *c = client_open(l->options.server, environment("HEXAD_TOKEN"), environment("SSL_CERT_FILE"), &e);
    if (!c) {
        terminal_text_print(stderr, "hexadctl: %s\n", e.message);
        return COMMAND_USAGE;
    }
    int code = run(c, l);
    client_close(c);
    return code;
}

static bool read_line(line *l, int argc, char **argv)
{
    error e = {0};
    bool ok = true;
    for (int k; ok && (k = options_next(&known_options, argc, argv, true, &l->options, &e)) != OPTIONS_END;) {
        if (k == OPTIONS_REFUSED) terminal_text_print(stderr, "hexadctl: %s\n", e.message);
        if (k >= 0) l->given[k] = true;
        ok = k >= 0 || (k == OPTIONS_ARGUMENT && take_word(l, optarg));
    }
    for (; ok && optind < argc; optind++) ok = take_word(l, argv[optind]);
    return ok && check(l);
}

int main(int argc, char **argv)
{
    int code = COMMAND_OK;
    if (is_print_only(argc, argv, &code)) return code;
    line l = {.argument = mem_alloc((size_t)argc * sizeof *l.argument),
              .options.server = default_server(),
              .options.file_group = TOKEN_NO_GROUP};
    code = read_line(&l, argc, argv) ? obey(&l) : COMMAND_USAGE;
    free(l.options.label.item);
    free(l.options.set.item);
    free(l.options.depends_on.item);
    free(l.argument);
    return code;
}

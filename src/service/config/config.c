// SPDX-License-Identifier: Apache-2.0
#include "service/config/config.h"

#include <assert.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <ini.h>

#include "base/core/denial.h"
#include "base/core/help_text.h"
#include "base/core/memory.h"
#include "base/core/nearest_name.h"
#include "service/config/config_table.h"

enum { MOST_SETTINGS = 128 };

/* A source of values. `seen` marks the keys that it has set, to detect repeated keys and to restart lists. */
typedef struct source {
    config *c;
    FILE *file;
    const char *path;
    int line;
    bool seen[MOST_SETTINGS];
    error *e;
} source;

static const char *default_of(const config_row *row)
{
    return row->default_text ? row->default_text : "";
}

static bool bad(error *e, const config_row *row, const char *value, const char *expected)
{
    return error_set(e, ERROR_SPEC_INVALID, "%s: must be %s (given \"%s\")", row->key, expected, value);
}

/* In bytes; 0: the setting is no size. */
static double size_of_unit(const config_row *row)
{
    const char *unit = row->unit ? row->unit : "";
    return strcmp(unit, "bytes") == 0 ? 1 : strcmp(unit, "MiB") == 0 ? 1 << 20 : 0;
}

/* Reads K, M, G or T after a size, and converts the number to the unit of the setting. */
static void take_prefix(const config_row *row, double *number, char **end)
{
    static const char prefixes[] = "KMGT";
    const char *found = **end ? strchr(prefixes, **end) : NULL;
    const double converted = found && size_of_unit(row) > 0
                                 ? ldexp(*number, 10 * (int)(found - prefixes + 1)) / size_of_unit(row)
                                 : NAN;
    if (converted != floor(converted)) return;
    *number = converted;
    (*end)++;
}

static bool set_number(const config_row *row, const char *value, void *at, error *e)
{
    char expected[160], *end = NULL;
    bool whole = row->type == CONFIG_INTEGER;
    snprintf(expected, sizeof expected, "%sa%s number from %.10g to %.10g%s%s%s", row->or_zero ? "0 or " : "",
             whole ? " whole" : "", row->low, row->high, row->unit ? " " : "", row->unit ? row->unit : "",
             size_of_unit(row) > 0 ? ", or have the unit K, M, G or T, such as 2G for 2 GiB" : "");
    errno = 0;
    double number = whole ? (double)strtoll(value, &end, 10) : strtod(value, &end);
    if (end != value) take_prefix(row, &number, &end);
    if (errno || end == value || *end || !isfinite(number) || number > row->high ||
        (number < row->low && !(row->or_zero && number == 0)))
        return bad(e, row, value, expected);
    if (whole)
        *(int64_t *)at = (int64_t)number;
    else
        *(double *)at = number;
    return true;
}

static void list_clear(config_list *list)
{
    mem_free_texts(list->item, list->count);
    *list = (config_list){0};
}

static bool is_list(const config_row *row)
{
    return row->type == CONFIG_LIST || row->type == CONFIG_WORDS;
}

static void list_append(config_list *list, const char *value, const char *separators)
{
    while (*value) {
        size_t length = strcspn(value, separators);
        const char *first = value;
        value += length + (value[length] != '\0');
        while (length && (*first == ' ' || *first == '\t')) first++, length--;
        while (length && (first[length - 1] == ' ' || first[length - 1] == '\t')) length--;
        if (!length) continue;
        mem_add_text(&list->item, &list->count, mem_strndup(first, length));
    }
}

/* The page is enabled by default: 0 must be permitted. */
static bool refuse_missing(const config_row *row, const char *value, error *e)
{
    const char *why = build_part_missing(row->part);
    if (!why || strcmp(value, default_of(row)) == 0) return false;
    if (row->type == CONFIG_INTEGER && strcmp(value, "0") == 0) return false;
    error_set(e, ERROR_NOT_SUPPORTED, "%s = %s is not supported: %s", row->key, value, why);
    return true;
}

static bool set_value(config *c, const config_row *row, const char *value, error *e)
{
    void *at = (char *)c + row->offset;
    switch (row->type) {
    case CONFIG_TEXT:
        free(*(char **)at);
        *(char **)at = mem_strdup(value);
        return true;
    case CONFIG_LIST:
        list_append(at, value, ":,");
        return true;
    case CONFIG_WORDS:
        list_append(at, value, ",");
        return true;
    case CONFIG_INTEGER:
    case CONFIG_REAL:
        return set_number(row, value, at, e);
    case CONFIG_SANDBOX:
        return sandbox_mode_from_name(value, at) || bad(e, row, value, "required, available or off");
    case CONFIG_LEVEL:
        return log_level_from_name(value, at) || bad(e, row, value, "error, warning, info or debug");
    }
    return false;
}

static const config_row *find_row(const char *key, size_t length)
{
    for (size_t i = 0; i < config_table_size; i++) {
        const char *name = config_table[i].key;
        size_t n = 0;
        while (n < length && (name[n] == key[n] || (name[n] == '_' && key[n] == '-'))) n++;
        if (n == length && !name[n]) return &config_table[i];
    }
    return NULL;
}

static void offer_settings(nearest_name *n)
{
    for (size_t i = 0; i < config_table_size; i++) nearest_name_offer(n, config_table[i].key);
}

/* Sets a key from a source; the first value of a list replaces the value of earlier sources. */
static bool set_from(source *s, const config_row *row, const char *value)
{
    assert(config_table_size <= MOST_SETTINGS);
    bool *seen = &s->seen[row - config_table];
    if (*seen && !is_list(row))
        return error_set(s->e, ERROR_SPEC_INVALID, "%s is given twice: remove one", row->key);
    if (!*seen && is_list(row)) list_clear((config_list *)((char *)s->c + row->offset));
    *seen = true;
    char **place = &s->c->place[row - config_table];
    free(*place);
    *place = s->path ? mem_printf("%s:%d", s->path, s->line) : NULL;
    return !refuse_missing(row, value, s->e) && set_value(s->c, row, value, s->e);
}

/* fgets that counts lines, so that an error can name its line. */
static char *read_line(char *buffer, int size, void *context)
{
    source *s = context;
    if (s->e->code) return NULL; /* the first error is reported */
    char *line = fgets(buffer, size, s->file);
    if (!line) return NULL;
    s->line++;
    size_t length = strlen(line);
    if (length + 1 == (size_t)size && line[length - 1] != '\n') {
        error_set(s->e, ERROR_SPEC_INVALID,
                  "%s:%d: the line is longer than %d bytes: repeat the key on a second line", s->path,
                  s->line, size - 2);
        return NULL;
    }
    return line;
}

static int take_pair(void *context, const char *section, const char *key, const char *value)
{
    source *s = context;
    if (s->e->code) return 0;
    const config_row *row = find_row(key, strlen(key));
    nearest_name nearest = nearest_name_to(key, strlen(key));
    offer_settings(&nearest);
    if (*section && strcmp(section, "hexad") != 0)
        error_set(s->e, ERROR_SPEC_INVALID, "the setting is in the unknown section [%s]: remove the section",
                  section);
    else if (!row && nearest.name)
        error_set(s->e, ERROR_SPEC_INVALID, "unknown setting %s; did you mean %s?", key, nearest.name);
    else if (!row)
        error_set(s->e, ERROR_SPEC_INVALID, "unknown setting %s; see hexad --help", key);
    else
        set_from(s, row, value);
    error_prefix(s->e, "%s:%d", s->path, s->line);
    return !s->e->code;
}

static bool read_file(config *c, const char *path, error *e)
{
    error mine = {0};
    source s = {.c = c, .path = path, .e = &mine, .file = fopen(path, "re")};
    if (!s.file) {
        const int fault = errno;
        char *why = denial_explain(path, fault, DENIAL_SETTINGS, ". Check --config.");
        error_set(e, ERROR_SPEC_INVALID, "cannot read the settings file %s: %s%s", path, strerror(fault),
                  why);
        free(why);
        return false;
    }
    int line = ini_parse_stream(read_line, &s, take_pair, &s);
    if (ferror(s.file))
        error_set(&mine, ERROR_SPEC_INVALID, "cannot read the settings file %s: %s. Check --config.", path,
                  strerror(errno));
    fclose(s.file);
    if (line != 0 && !mine.code)
        error_set(&mine, ERROR_SPEC_INVALID, "%s:%d: the line is not a setting: write NAME = VALUE", path,
                  line);
    if (mine.code && e) *e = mine;
    return !mine.code;
}

/* Options that are no settings. Those with CONFIG_RUN are no actions. */
static const struct option {
    option_rank rank;
    const char *name;
    const char *argument; /* NULL: none; it has no value */
    config_action action;
    size_t offset; /* in config: of a char * for the value; without an action and a value, of a bool */
    const char *text;
} options[] = {
    {OPTION_BASIC, "config", "FILE", CONFIG_RUN, offsetof(config, file),
     "reads settings from a file (etc/hexad.conf explains each)"},
    {OPTION_BASIC, "check-settings", NULL, CONFIG_CHECK_SETTINGS, 0,
     "checks the settings and starts nothing. It warns of users, groups and directories that do not exist, or "
     "that the user of this command cannot use, and of a state directory that other users can write to: run it "
     "as the user of the service. It says if hexad would not start, although the settings are right, for example "
     "with a port and without any token. It does not open ports, and does not read the database"},
    {OPTION_ADVANCED, "strict", NULL, CONFIG_RUN, offsetof(config, strict),
     "with --check-settings: ends with 1 if hexad would not start"},
    {OPTION_BASIC, "allow", "USER|@GROUP", CONFIG_ALLOW, offsetof(config, admit),
     "grants a user, or the members of a @GROUP, access to the Unix socket. It adds the name to unix_users or "
     "unix_groups of FILE (default: the file that hexad.service names, otherwise " CONFIG_FILE
     "). For the service that systemd runs with this file it also writes the drop-in hexad.socket.d/allow.conf "
     "and has systemd read both; run it as root then. It prints each step, warns if the user still cannot reach "
     "the socket, and can be repeated"},
    {OPTION_BASIC, "deny", "USER|@GROUP", CONFIG_DENY, offsetof(config, admit), "revokes this access"},
    {OPTION_BASIC, "open-port", "USER", CONFIG_OPEN_PORT, offsetof(config, admit),
     "opens the port 127.0.0.1:8642 of the service that systemd runs. It is for the web page and for other "
     "clients of this machine. It creates a token for USER who has none, writes the drop-in "
     "hexad.socket.d/tcp.conf if there is none, and then restarts the service, which ends running attempts as a "
     "drain does. It prints the address and the token; run it as root"},
    {OPTION_BASIC, "backup", "FILE", CONFIG_BACKUP, offsetof(config, backup),
     "copies the queue's database to FILE, replacing it, and checks the copy. It works whether hexad runs or "
     "not. A running hexad is found at $HEXAD_SERVER, otherwise at the address of the settings; over TCP it "
     "requires a token with the scope admin in $HEXAD_TOKEN"},
    {OPTION_ADVANCED, "check", NULL, CONFIG_CHECK, 0,
     "checks the database for damage and, if hexad does not run, whether the results of all jobs have their "
     "files, with their lengths. It changes neither and prints a line for each fault. --backup, --check and "
     "--check-settings read " CONFIG_FILE " unless --config or --state_dir is given"},
    {OPTION_ADVANCED, "contents", NULL, CONFIG_RUN, offsetof(config, contents),
     "with --check: reads all files of results and uploads, and compares their bytes with the hashes that were "
     "stored with them. It requires that hexad does not run, and reports its progress on standard error"},
    {OPTION_ADVANCED, "adopt", NULL, CONFIG_ADOPT, 0,
     "for one start: takes over the database in state_dir from another instance, or creates a new one if it is "
     "missing, and registers results that it lacks"},
    {OPTION_BASIC, "print-config", NULL, CONFIG_SAMPLE, 0, "prints a sample of the settings file"},
    {OPTION_BASIC, "help", NULL, CONFIG_HELP, 0, "prints this text; --help all: all options and settings"},
    {OPTION_ADVANCED, "version", NULL, CONFIG_VERSION, 0, "prints the version"},
};
enum { OPTION_COUNT = sizeof options / sizeof *options };

static bool is_named(const char *key, size_t length, const char *name)
{
    return strlen(name) == length && memcmp(key, name, length) == 0;
}

static const struct option *find_option(const char *key, size_t length)
{
    for (size_t i = 0; i < OPTION_COUNT; i++)
        if (is_named(key, length, options[i].name)) return &options[i];
    return NULL;
}

/* Whether it is an option with a value. */
static bool has_value(const char *key, size_t length)
{
    const struct option *o = find_option(key, length);
    return o ? o->argument != NULL : find_row(key, length) != NULL;
}

static bool refuse_option(const char *key, size_t length, error *e)
{
    nearest_name nearest = nearest_name_to(key, length);
    for (size_t i = 0; i < OPTION_COUNT; i++) nearest_name_offer(&nearest, options[i].name);
    offer_settings(&nearest);
    if (find_option(key, length))
        return error_set(e, ERROR_SPEC_INVALID, "--%.*s takes no value: remove it", (int)length, key);
    if (nearest.name)
        return error_set(e, ERROR_SPEC_INVALID, "unknown option --%.*s; did you mean --%s?", (int)length, key,
                         nearest.name);
    return error_set(e, ERROR_SPEC_INVALID, "unknown option --%.*s; see hexad --help", (int)length, key);
}

/* Splits an option and its value, `--key VALUE` or `--key=VALUE`, and advances *index. */
static bool split_option(int argc, char *const *argv, int *index, const char **key, size_t *length,
                         const char **value, error *e)
{
    const char *text = argv[*index];
    if (strncmp(text, "--", 2) != 0 || !text[2])
        return error_set(e, ERROR_SPEC_INVALID, "unexpected argument %s; see hexad --help", text);
    *key = text + 2;
    *length = strcspn(*key, "=");
    if (!has_value(*key, *length)) return refuse_option(*key, *length, e);
    *value = (*key)[*length] ? *key + *length + 1 : NULL;
    if (*value) return true;
    if (*index + 1 >= argc)
        return error_set(e, ERROR_SPEC_INVALID, "%s requires a value: write %s VALUE", text, text);
    *value = argv[++*index];
    return true;
}

/* The option without a value that an argument is; NULL: none. */
static const struct option *find_bare_option(const char *text)
{
    if (strcmp(text, "-h") == 0) text = "--help";
    const struct option *o = strncmp(text, "--", 2) == 0 ? find_option(text + 2, strlen(text + 2)) : NULL;
    return o && !o->argument ? o : NULL;
}

/* Sets the action; a command line has at most one. */
static bool choose(const struct option *o, config_action *action, error *e)
{
    for (size_t i = 0; *action != CONFIG_RUN && *action != o->action && i < OPTION_COUNT; i++)
        if (options[i].action == *action)
            return error_set(e, ERROR_SPEC_INVALID, "--%s and --%s are both given: give one of them",
                             options[i].name, o->name);
    *action = o->action;
    return true;
}

static bool take_bare_option(config *c, const struct option *o, config_action *action, error *e)
{
    if (o->action != CONFIG_RUN) return choose(o, action, e);
    return *(bool *)((char *)c + o->offset) = true;
}

static bool take_action(config *c, const struct option *o, const char *value, config_action *action, error *e)
{
    char **kept = (char **)((char *)c + o->offset);
    if (!*value || strcmp(value, "@") == 0)
        return error_set(e, ERROR_SPEC_INVALID, "--%s requires a value: give %s", o->name, o->argument);
    if (!choose(o, action, e)) return false;
    if (*kept) return error_set(e, ERROR_SPEC_INVALID, "--%s is given with two values: give one", o->name);
    *kept = mem_strdup(value);
    return true;
}

static bool take_file(source *s, const char *path)
{
    free(s->c->file);
    s->c->file = mem_strdup(path);
    return read_file(s->c, path, s->e);
}

/* Called twice for the command line: first for the files, then for the options, which take precedence. */
static bool read_options(int argc, char *const *argv, bool files, source *s, config_action *action)
{
    for (int i = 1; i < argc; i++) {
        const char *key = "", *value = NULL;
        size_t length = 0;
        const struct option *o = find_bare_option(argv[i]);
        if (o) {
            if (!take_bare_option(s->c, o, action, s->e)) return false;
            continue;
        }
        if (*action == CONFIG_HELP && strcmp(argv[i], "all") == 0) {
            s->c->help_all = true;
            continue;
        }
        if (!split_option(argc, argv, &i, &key, &length, &value, s->e)) return false;
        o = find_option(key, length);
        const bool is_file = o && o->action == CONFIG_RUN;
        if (files != is_file) continue;
        if (is_file && !take_file(s, value)) return false;
        if (o && !is_file && !take_action(s->c, o, value, action, s->e)) return false;
        if (!o && !set_from(s, find_row(key, length), value)) return error_prefix(s->e, "command line");
    }
    return true;
}

/* Whether --check, --check-settings or --backup is meant for the installed service: no other settings file or
 * state directory is given. */
static bool maintains_service(int argc, char *const *argv)
{
    bool maintains = false;
    for (int i = 1; i < argc; i++) {
        const char *key = strncmp(argv[i], "--", 2) == 0 ? argv[i] + 2 : "";
        const size_t length = strcspn(key, "=");
        if (is_named(key, length, "config") || is_named(key, length, "state_dir")) return false;
        maintains |= is_named(key, length, "check") || is_named(key, length, "check-settings") ||
                     is_named(key, length, "backup");
    }
    return maintains && access(CONFIG_FILE, F_OK) == 0;
}

bool config_parse(int argc, char *const *argv, config *c, config_action *action, error *e)
{
    config read = {0};
    error mine = {0};
    source s = {.c = &read, .e = &mine};
    config_action what = CONFIG_RUN;
    bool ok = true;
    read.place = mem_alloc(config_table_size * sizeof *read.place);
    for (size_t i = 0; ok && i < config_table_size; i++)
        ok = set_value(&read, &config_table[i], default_of(&config_table[i]), &mine);
    if (ok && maintains_service(argc, argv)) ok = take_file(&s, CONFIG_FILE);
    ok = ok && read_options(argc, argv, true, &s, &what) && read_options(argc, argv, false, &s, &what);
    if (ok && read.strict && what != CONFIG_CHECK_SETTINGS)
        ok = error_set(&mine, ERROR_SPEC_INVALID,
                       "--strict requires --check-settings: add it, or remove --strict");
    if (ok && read.contents && what != CONFIG_CHECK)
        ok =
            error_set(&mine, ERROR_SPEC_INVALID, "--contents requires --check: add it, or remove --contents");
    if (!ok) {
        config_clear(&read);
        if (e) *e = mine;
        return false;
    }
    if (!*read.state_dir) {
        const char *given = getenv("STATE_DIRECTORY"); /* by systemd */
        free(read.state_dir);
        read.state_dir = mem_strdup(given && *given ? given : HEXAD_STATEDIR);
    }
    *c = read;
    *action = what;
    return true;
}

bool config_lists_differ(const config_list *a, const config_list *b)
{
    bool equal = a->count == b->count;
    for (size_t i = 0; equal && i < a->count; i++) equal = strcmp(a->item[i], b->item[i]) == 0;
    return !equal;
}

static bool are_equal(const config_row *row, const void *a, const void *b)
{
    if (row->type == CONFIG_TEXT) return strcmp(*(char *const *)a, *(char *const *)b) == 0;
    if (!is_list(row)) return memcmp(a, b, row->size) == 0;
    return !config_lists_differ(a, b);
}

static void swap(void *a, void *b, size_t size)
{
    char kept[sizeof(config_list)]; /* the size of the largest value */
    memcpy(kept, a, size);
    memcpy(a, b, size);
    memcpy(b, kept, size);
}

void config_take_over(config *c, config *fresh)
{
    for (size_t i = 0; i < config_table_size; i++) {
        const config_row *row = &config_table[i];
        void *at = (char *)c + row->offset;
        void *from = (char *)fresh + row->offset;
        if (are_equal(row, at, from)) continue;
        assert(!row->reloads || row->type != CONFIG_TEXT); /* other modules keep pointers to texts */
        if (row->reloads) swap(at, from, row->size);
        log_write(row->reloads ? LOG_LEVEL_INFO : LOG_LEVEL_WARNING, "setting %s %s", row->key,
                  row->reloads ? "has changed" : "has changed: restart hexad to apply it");
    }
}

void config_locate_error(const config *c, error *e)
{
    const config_row *row = find_row(e->message, strcspn(e->message, ": "));
    const char *place = row ? c->place[row - config_table] : NULL;
    if (place) error_prefix(e, "%s", place);
}

void config_clear(config *c)
{
    for (size_t i = 0; i < config_table_size; i++) {
        void *at = (char *)c + config_table[i].offset;
        if (config_table[i].type == CONFIG_TEXT) free(*(char **)at);
        if (is_list(&config_table[i])) list_clear(at);
        if (c->place) free(c->place[i]);
    }
    free(c->place);
    free(c->file);
    free(c->backup);
    free(c->admit);
    *c = (config){0};
}

const char *config_unix_address(const config *c)
{
    for (size_t i = 0; i < c->listen.count; i++)
        if (strncmp(c->listen.item[i], "unix:", 5) == 0) return c->listen.item[i];
    return c->listen.count ? NULL : "unix:";
}

bool config_shares_socket(const config *c)
{
    return c->unix_users.count || c->unix_groups.count || c->unix_admins.count;
}

static bool find_program(char **path, const char *name, const char *setting, error *e)
{
    if (!**path) {
        char own[4096];
        ssize_t length = readlink("/proc/self/exe", own, sizeof own - 1);
        own[length > 0 ? length : 0] = '\0';
        char *slash = strrchr(own, '/');
        if (slash) *slash = '\0';
        free(*path);
        *path = mem_printf("%s/%s", own, name);
        if (access(*path, X_OK) != 0) {
            free(*path);
            *path = mem_printf(HEXAD_BINDIR "/%s", name);
        }
    }
    if (access(*path, X_OK) == 0) return true;
    return error_set(e, ERROR_INPUT_MISSING, "%s: cannot run the program %s: %s. Correct this setting.",
                     setting, *path, strerror(errno));
}

bool config_find_worker(config *c, error *e)
{
    return find_program(&c->worker, "hexad-worker", "worker", e);
}

bool config_find_node(config *c, error *e)
{
    return find_program(&c->slurm_node, "hexad-node", "slurm_node", e);
}

static void print_facts(FILE *file, const char *prefix, const config_row *row)
{
    fprintf(file, "%sDefault: %s", prefix, row->default_text ? row->default_text : "empty");
    if (row->unit) fprintf(file, " %s", row->unit);
    if (row->high > row->low)
        fprintf(file, " (%s%.10g to %.10g)", row->or_zero ? "0 or " : "", row->low, row->high);
    fputs(row->reloads ? ". SIGHUP reloads it.\n" : ".\n", file);
}

static void print_help_row(FILE *file, const config_row *row)
{
    fprintf(file, "\n  --%s\n", row->key);
    help_text_wrap(file, "      ", row->help);
    print_facts(file, "      ", row);
}

static void print_sample_row(FILE *file, const config_row *row)
{
    fputc('\n', file);
    help_text_wrap(file, "# ", row->help);
    print_facts(file, "# ", row);
    fprintf(file, "#%s =%s%s\n", row->key, row->default_text ? " " : "", default_of(row));
}

/* Prints each setting, below the heading of its rank. */
static void print_rows(FILE *file, const char *prefix, void (*print)(FILE *file, const config_row *row))
{
    static const char *const headings[] = {[OPTION_BASIC] = "Basic settings",
                                           [OPTION_ADVANCED] = "Further settings",
                                           [OPTION_RESEARCH] =
                                               "Settings that only measurements suggest to change"};
    for (option_rank rank = OPTION_BASIC; rank <= OPTION_RESEARCH; rank++) {
        fprintf(file, "\n%s%s\n", prefix, headings[rank]);
        for (size_t i = 0; i < config_table_size; i++)
            if (config_table[i].rank == rank) print(file, &config_table[i]);
    }
}

static void print_options(FILE *file, bool all)
{
    enum { COLUMN = 20 };
    for (size_t i = 0; i < OPTION_COUNT; i++) {
        const struct option *o = &options[i];
        if (!all && o->rank != OPTION_BASIC) continue;
        char *term = mem_printf("--%s%s%s", o->name, o->argument ? " " : "", o->argument ? o->argument : "");
        help_text_item(file, COLUMN, term, o->text, !all);
        free(term);
    }
}

static void print_basic_settings(FILE *file)
{
    enum { COLUMN = 24 };
    for (size_t i = 0; i < config_table_size; i++) {
        const config_row *row = &config_table[i];
        if (row->rank != OPTION_BASIC) continue;
        char *term = mem_printf("--%s", row->key);
        help_text_item(file, COLUMN, term, row->help, true);
        free(term);
    }
}

void config_print_help(FILE *file, bool all)
{
    fputs(
        "usage: hexad [--config FILE] [--KEY VALUE]... [--backup FILE | --check [--contents]]\n"
        "       hexad [--config FILE] [--KEY VALUE]... --check-settings [--strict]\n"
        "       hexad [--config FILE] --allow USER|@GROUP | --deny USER|@GROUP | --open-port USER\n"
        "\n"
        "Serves sampling jobs over HTTP, keeps them in a durable queue and runs each in a worker process.\n",
        file);
    if (all)
        fputs(
            "SIGTERM and SIGINT stop it after a drain, with exit status 0; a second one stops it at once. SIGHUP\n"
            "reloads the settings.\n",
            file);
    fputc('\n', file);
    print_options(file, all);
    if (!all) {
        fputs("\nSettings, as options and as keys of the file; --help all has all:\n", file);
        print_basic_settings(file);
        return;
    }
    fputs(
        "\n"
        "Exit status: 0 drained, 1 failure, 2 bad settings. With --backup: 0 done, 1 failure; FILE is\n"
        "then unchanged. With --check: 0 no fault, 1 a fault was found, or the check failed.\n"
        "With --check-settings: 0 no fault, possibly with warnings, 2 bad settings; with --strict also 1\n"
        "hexad would not start.\n"
        "With --allow, --deny and --open-port: 0 done, 1 failure, 2 a name that does not exist or bad settings.\n"
        "\n"
        "Settings, as options and as keys of the file; options take precedence. A size in bytes or MiB\n"
        "may be given with K, M, G or T, the powers of 1024: 16G\n",
        file);
    print_rows(file, "", print_help_row);
}

void config_print_sample(FILE *file)
{
    fputs(
        "# Settings of hexad. Lines that are commented out show the defaults. A size in bytes or MiB may be given\n"
        "# with K, M, G or T, the powers of 1024: 16G\n"
        "# Made by `hexad --print-config`.\n",
        file);
    print_rows(file, "# ---- ", print_sample_row);
}

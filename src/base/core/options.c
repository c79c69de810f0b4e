// SPDX-License-Identifier: Apache-2.0
#include "base/core/options.h"

#include <errno.h>
#include <getopt.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/nearest_name.h"

/* Sets the error for an option that getopt_long refused. `answer` is its result: ':' for an option without
 * its value; '?' with an optopt for an option with a value that it does not accept; otherwise the option
 * is unknown. */
static bool refuse(const option_table *t, int answer, const char *word, error *e)
{
    if (answer == ':')
        return error_set(e, ERROR_SPEC_INVALID, "%s requires a value; see %s --help", word, t->program);
    if (answer == '?' && optopt)
        return error_set(e, ERROR_SPEC_INVALID, "%.*s takes no value: remove it", (int)strcspn(word, "="),
                         word);
    const char *name = word + strspn(word, "-");
    nearest_name n = nearest_name_to(name, strcspn(name, "="));
    for (size_t i = 0; i < t->count; i++) nearest_name_offer(&n, t->row[i].name);
    nearest_name_offer(&n, "help");
    nearest_name_offer(&n, "version");
    if (n.name)
        return error_set(e, ERROR_SPEC_INVALID, "unknown option %s; did you mean --%s?", word, n.name);
    return error_set(e, ERROR_SPEC_INVALID, "unknown option %s; see %s --help", word, t->program);
}

static bool parse_number(const option_row *o, long *out, error *e)
{
    char *end;
    errno = 0;
    long value = strtol(optarg, &end, 10);
    if (errno || end == optarg || *end || value < o->low || value > INT_MAX)
        return error_set(e, ERROR_SPEC_INVALID, "--%s must be a whole number of at least %ld (given %s)",
                         o->name, o->low, optarg);
    *out = value;
    return true;
}

/* Stores an option and its value, optarg. */
static bool take(const option_row *o, void *at, error *e)
{
    option_words *words = at;
    switch (o->kind) {
    case OPTION_FLAG:
        return *(bool *)at = true;
    case OPTION_WORD:
        *(const char **)at = optarg;
        return true;
    case OPTION_WORDS:
        words->item = mem_resize(words->item, (words->count + 1) * sizeof *words->item);
        words->item[words->count++] = optarg;
        return true;
    case OPTION_NUMBER:
        return parse_number(o, at, e);
    }
    return false;
}

int options_next(const option_table *t, int argc, char **argv, bool in_order, void *into, error *e)
{
    enum { FIRST = 256 }; /* results of getopt_long that are no characters */
    struct option options[OPTIONS_MOST + 1] = {{NULL}};
    for (size_t i = 0; i < t->count; i++)
        options[i] =
            (struct option){t->row[i].name, t->row[i].kind == OPTION_FLAG ? no_argument : required_argument,
                            NULL, FIRST + (int)i};
    opterr = 0;
    const char *next = optind < argc ? argv[optind] : "";
    const bool is_short = next[0] == '-' && next[1] && next[1] != '-';
    const int c = is_short ? 0 : getopt_long(argc, argv, in_order ? "-:" : ":", options, NULL);
    if (c == -1) return OPTIONS_END;
    if (c == 1) return OPTIONS_ARGUMENT;
    const option_row *o = c < FIRST ? NULL : &t->row[c - FIRST];
    if (o && in_order && strcspn(next + 2, "=") != strlen(o->name)) o = NULL; /* the name is shortened */
    const bool ok = o ? take(o, (char *)into + o->offset, e)
                      : refuse(t, c, is_short || in_order ? next : argv[optind - 1], e);
    return ok ? c - FIRST : OPTIONS_REFUSED;
}

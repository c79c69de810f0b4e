// SPDX-License-Identifier: Apache-2.0
/* options: the options of a command line by the rows of a table: --NAME, --NAME VALUE or --NAME=VALUE. There are
 * no short options. One thread: the position in the command line is that of getopt_long. */
#ifndef HEXAD_BASE_CORE_OPTIONS_H
#define HEXAD_BASE_CORE_OPTIONS_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"
#include "base/core/help_text.h"

typedef enum option_kind {
    OPTION_FLAG,  /* bool; the only kind without a value */
    OPTION_WORD,  /* const char *, in the command line */
    OPTION_WORDS, /* option_words; may be given several times */
    OPTION_NUMBER /* long */
} option_kind;

typedef struct option_words {
    const char **item; /* the caller frees it; the words are in the command line */
    size_t count;
} option_words;

typedef struct option_row {
    option_rank rank;
    const char *name, *value; /* `value`: as the help names it */
    option_kind kind;
    size_t offset;       /* of its place in the caller's struct */
    const char *command; /* the only command that has it; NULL: several */
    const char *text;    /* for the help */
    long low;            /* of numbers */
} option_row;

enum { OPTIONS_MOST = 64 };

typedef struct option_table {
    const char *program; /* whose help messages name */
    const option_row *row;
    size_t count; /* at most OPTIONS_MOST */
} option_table;

enum { OPTIONS_END = -1, OPTIONS_ARGUMENT = -2, OPTIONS_REFUSED = -3 };

/* Stores the value of the next option in the struct `into`. Returns the index of its row. `in_order`: arguments are
 * returned where they stand, as OPTIONS_ARGUMENT, in optarg; otherwise they are moved behind the options, and a name
 * may be shortened while it is the start of one name only. OPTIONS_END: argv[optind] is the next argument.
 * OPTIONS_REFUSED: error spec_invalid. */
int options_next(const option_table *t, int argc, char **argv, bool in_order, void *into, error *e);

#endif

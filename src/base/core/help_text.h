// SPDX-License-Identifier: Apache-2.0
/* help_text: help of a program for a terminal, in lines of at most HELP_TEXT_COLUMNS columns.
 *
 * Each command, option, setting and member of a spec has a rank. The short help lists the basic ones, each
 * with the first sentence of its text. Help on request has all of them, the basic ones first. Texts are ASCII.
 */
#ifndef HEXAD_BASE_CORE_HELP_TEXT_H
#define HEXAD_BASE_CORE_HELP_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

enum {
    HELP_TEXT_COLUMNS = 100,
    HELP_TEXT_SHORT_LINES = 40 /* most lines of a program's short help */
};

typedef enum option_rank {
    OPTION_BASIC = 1, /* a new user needs it in the first week */
    OPTION_ADVANCED,
    OPTION_RESEARCH /* a parameter of the method, or a bound that only measurements suggest to change */
} option_rank;

/* "basic", "advanced" or "research". */
const char *option_rank_name(option_rank rank);

/* Prints a text that is broken at spaces; each line begins with `indent`. */
void help_text_wrap(FILE *file, const char *indent, const char *text);

/* Prints an item of a list: its term, and its text from `column` (counted from 0) on. Further lines of a long
 * term have less indent than the text. `brief`: the arguments in brackets and all sentences but the first one
 * are left out. */
void help_text_item(FILE *file, size_t column, const char *term, const char *text, bool brief);

#endif

// SPDX-License-Identifier: Apache-2.0
/* table: prints texts in columns, escaped as base/core/terminal_text describes. Each column is as wide as its
 * widest text, in characters. One thread. */
#ifndef HEXAD_CLIENT_TABLE_H
#define HEXAD_CLIENT_TABLE_H

#include <stddef.h>

#define TABLE_COLUMNS_MOST 12

typedef struct table {
    size_t columns, count; /* of cells, row by row */
    char **cell;
} table;

/* Makes a table with a row of titles. The caller frees it with table_clear. */
table table_new(const char *const *titles, size_t columns);
void table_add(table *t, char *text); /* adds the next cell; takes over the text */
void table_print(const table *t);
void table_clear(table *t); /* accepts an empty table */

#endif

// SPDX-License-Identifier: Apache-2.0
#include "client/table.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "base/core/utf8.h"
#include "client/print.h"

table table_new(const char *const *titles, size_t columns)
{
    table t = {.columns = columns};
    assert(columns <= TABLE_COLUMNS_MOST);
    for (size_t i = 0; i < columns; i++) table_add(&t, mem_strdup(titles[i]));
    return t;
}

void table_add(table *t, char *text)
{
    if (t->count % (64 * t->columns) == 0)
        t->cell = mem_resize(t->cell, (t->count + 64 * t->columns) * sizeof *t->cell);
    t->cell[t->count++] = terminal_text_new(text);
    free(text);
}

void table_print(const table *t)
{
    size_t width[TABLE_COLUMNS_MOST] = {0};
    for (size_t i = 0; i < t->count; i++)
        if (utf8_count(t->cell[i]) > width[i % t->columns]) width[i % t->columns] = utf8_count(t->cell[i]);
    for (size_t i = 0; i < t->count; i++) {
        size_t column = i % t->columns;
        fputs(t->cell[i], stdout);
        if (column == t->columns - 1)
            putchar('\n');
        else
            terminal_text_print(stdout, "%*s", (int)(width[column] - utf8_count(t->cell[i]) + 2), "");
    }
}

void table_clear(table *t)
{
    mem_free_texts(t->cell, t->count);
    *t = (table){0};
}

#include "client/table.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
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
    t->cell[t->count++] = text;
}

void table_print(const table *t)
{
    size_t width[TABLE_COLUMNS_MOST] = {0};
    for (size_t i = 0; i < t->count; i++)
        if (strlen(t->cell[i]) > width[i % t->columns]) width[i % t->columns] = strlen(t->cell[i]);
    for (size_t i = 0; i < t->count; i++) {
        size_t column = i % t->columns;
        print_text(stdout, t->cell[i]);
        if (column == t->columns - 1)
            putchar('\n');
        else
            printf("%*s", (int)(width[column] - strlen(t->cell[i]) + 2), "");
    }
}

void table_clear(table *t)
{
    for (size_t i = 0; i < t->count; i++) free(t->cell[i]);
    free(t->cell);
    *t = (table){0};
}

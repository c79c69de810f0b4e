#include "executor/rows.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

struct rows {
    pthread_mutex_t mutex;
    int64_t newest;            /* number of the last line; 0: none */
    rows_line line[ROWS_KEPT]; /* number n at n % ROWS_KEPT */
};

rows *rows_new(void)
{
    rows *r = mem_alloc(sizeof *r);
    pthread_mutex_init(&r->mutex, NULL);
    return r;
}

void rows_free(rows *r)
{
    if (!r) return;
    for (size_t i = 0; i < ROWS_KEPT; i++) free(r->line[i].text);
    pthread_mutex_destroy(&r->mutex);
    free(r);
}

void rows_add(rows *r, const char *id, int frame, int attempt, const char *text)
{
    rows_line made = {.frame = frame, .attempt = attempt, .text = mem_strdup(text)};
    snprintf(made.id, sizeof made.id, "%s", id);
    pthread_mutex_lock(&r->mutex);
    made.number = ++r->newest;
    rows_line *place = &r->line[made.number % ROWS_KEPT];
    char *old = place->text;
    *place = made;
    pthread_mutex_unlock(&r->mutex);
    free(old);
}

size_t rows_list(rows *r, const char *id, int64_t after, size_t limit, rows_line **lines, int64_t *newest)
{
    rows_line *found = mem_alloc(limit * sizeof *found);
    size_t count = 0;
    pthread_mutex_lock(&r->mutex);
    int64_t oldest = r->newest - ROWS_KEPT + 1, number = after + 1 > oldest ? after + 1 : oldest;
    if (number < 1) number = 1;
    if (number > r->newest)
        number = r->newest + 1; /* also of who comes with a number from before a restart */
    for (; number <= r->newest && count < limit; number++) {
        const rows_line *l = &r->line[number % ROWS_KEPT];
        if (id && strcmp(l->id, id) != 0) continue;
        found[count] = *l;
        found[count++].text = mem_strdup(l->text);
    }
    pthread_mutex_unlock(&r->mutex);
    *lines = found;
    *newest = number - 1;
    return count;
}

void rows_lines_free(rows_line *lines, size_t count)
{
    for (size_t i = 0; i < count; i++) free(lines[i].text);
    free(lines);
}

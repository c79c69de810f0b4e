// SPDX-License-Identifier: Apache-2.0
#include "service/queue/user_numbers.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

#define OTHERS "*"

typedef struct entry {
    char *user;
    double number;
} entry;

struct user_numbers {
    pthread_mutex_t mutex; /* protects the next members */
    entry *item;           /* sorted by user */
    size_t count;
};

static int compare(const void *a, const void *b)
{
    return strcmp(((const entry *)a)->user, ((const entry *)b)->user);
}

static bool read_entry(const char *text, double low, double high, entry *out, error *e)
{
    const char *colon = strrchr(text, ':');
    char *end = NULL;
    double number = colon ? strtod(colon + 1, &end) : 0;
    if (!colon || colon == text || end == colon + 1 || *end || !isfinite(number))
        return error_set(e, ERROR_SPEC_INVALID, "%s: must be user:number, such as alice:2", text);
    if (number < low || number > high)
        return error_set(e, ERROR_SPEC_INVALID, "%s: the number must be from %g to %g", text, low, high);
    *out = (entry){mem_printf("%.*s", (int)(colon - text), text), number};
    return true;
}

user_numbers *user_numbers_read(const char *const *items, size_t count, double low, double high, error *e)
{
    user_numbers *n = mem_alloc(sizeof *n);
    pthread_mutex_init(&n->mutex, NULL);
    n->item = mem_alloc((count + 1) * sizeof *n->item);
    bool ok = true;
    for (size_t i = 0; ok && i < count; i++) {
        ok = read_entry(items[i], low, high, &n->item[n->count], e);
        if (ok) n->count++;
    }
    qsort(n->item, n->count, sizeof *n->item, compare);
    for (size_t i = 1; ok && i < n->count; i++)
        if (compare(&n->item[i - 1], &n->item[i]) == 0)
            ok = error_set(e, ERROR_SPEC_INVALID, "%s is given twice: remove one", n->item[i].user);
    if (ok) return n;
    user_numbers_free(n);
    return NULL;
}

void user_numbers_free(user_numbers *n)
{
    if (!n) return;
    for (size_t i = 0; i < n->count; i++) free(n->item[i].user);
    free(n->item);
    pthread_mutex_destroy(&n->mutex);
    free(n);
}

void user_numbers_change(user_numbers *n, user_numbers *fresh)
{
    pthread_mutex_lock(&n->mutex);
    entry *item = n->item;
    size_t count = n->count;
    n->item = fresh->item;
    n->count = fresh->count;
    pthread_mutex_unlock(&n->mutex);
    fresh->item = item;
    fresh->count = count;
    user_numbers_free(fresh);
}

static const entry *find(const user_numbers *n, const char *user)
{
    const entry wanted = {.user = (char *)user};
    return n->count ? bsearch(&wanted, n->item, n->count, sizeof *n->item, compare) : NULL;
}

double user_numbers_of(const user_numbers *n, const char *user, double otherwise)
{
    if (!n) return otherwise;
    pthread_mutex_t *mutex = (pthread_mutex_t *)&n->mutex; /* locking is logically const */
    pthread_mutex_lock(mutex);
    const entry *found = find(n, user);
    if (!found) found = find(n, OTHERS);
    double number = found ? found->number : otherwise;
    pthread_mutex_unlock(mutex);
    return number;
}

// SPDX-License-Identifier: Apache-2.0
#include "service/results/fetches.h"

#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

typedef struct entry {
    fetches_result of;
    bool *sent;         /* for each file */
    size_t count, left; /* files of the result; files that were not sent yet */
    uint64_t used;      /* value of `clock` when a file of the result was last sent */
} entry;

struct fetches {
    pthread_mutex_t mutex;
    entry item[FETCHES_MOST];
    size_t count;
    uint64_t clock; /* number of calls of fetches_note */
};

fetches *fetches_new(void)
{
    fetches *f = mem_alloc(sizeof *f);
    pthread_mutex_init(&f->mutex, NULL);
    return f;
}

void fetches_free(fetches *f)
{
    if (!f) return;
    for (size_t i = 0; i < f->count; i++) free(f->item[i].sent);
    pthread_mutex_destroy(&f->mutex);
    free(f);
}

static void drop(fetches *f, entry *x)
{
    free(x->sent);
    *x = f->item[--f->count];
}

static entry *find(fetches *f, const fetches_result *of)
{
    for (size_t i = 0; i < f->count; i++)
        if (f->item[i].of.frame == of->frame && strcmp(f->item[i].of.id, of->id) == 0) return &f->item[i];
    return NULL;
}

static entry *add(fetches *f, const fetches_result *of, size_t count)
{
    if (f->count == FETCHES_MOST) {
        entry *oldest = &f->item[0];
        for (size_t i = 1; i < f->count; i++)
            if (f->item[i].used < oldest->used) oldest = &f->item[i];
        drop(f, oldest);
    }
    entry *x = &f->item[f->count++];
    *x = (entry){.of = *of, .sent = mem_alloc(count * sizeof *x->sent), .count = count, .left = count};
    return x;
}

bool fetches_note(fetches *f, const fetches_result *of, size_t index, size_t count)
{
    pthread_mutex_lock(&f->mutex);
    entry *x = find(f, of);
    if (x && x->count != count) { /* the result has been changed on the disk */
        drop(f, x);
        x = NULL;
    }
    if (!x) x = add(f, of, count);
    x->used = ++f->clock;
    x->left -= !x->sent[index];
    x->sent[index] = true;
    bool whole = !x->left;
    if (whole) drop(f, x);
    pthread_mutex_unlock(&f->mutex);
    return whole;
}

// SPDX-License-Identifier: Apache-2.0
#include "files/turns.h"

#include <errno.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/core/memory.h"

struct store_turns {
    pthread_mutex_t mutex;
    pthread_cond_t ended;
    store_turn *taken; /* few: a thread has at most one */
    size_t count;
};

store_turns *store_turns_new(void)
{
    store_turns *t = mem_alloc(sizeof *t);
    pthread_mutex_init(&t->mutex, NULL);
    pthread_cond_init(&t->ended, NULL);
    return t;
}

void store_turns_free(store_turns *t)
{
    if (!t) return;
    pthread_cond_destroy(&t->ended);
    pthread_mutex_destroy(&t->mutex);
    free(t->taken);
    free(t);
}

/* The index of a taken turn; `count` if it is not taken. The caller holds the mutex. */
static size_t find(const store_turns *t, store_turn turn)
{
    size_t i = 0;
    while (i < t->count && (t->taken[i].device != turn.device || t->taken[i].inode != turn.inode)) i++;
    return i;
}

bool store_turns_take(store_turns *t, int directory, store_turn *turn, error *e)
{
    struct stat info;
    if (fstat(directory, &info) != 0)
        return error_set(e, error_code_of_errno(errno), "cannot examine a directory: %s", strerror(errno));
    *turn = (store_turn){info.st_dev, info.st_ino};
    pthread_mutex_lock(&t->mutex);
    while (find(t, *turn) < t->count) pthread_cond_wait(&t->ended, &t->mutex);
    t->taken = mem_resize(t->taken, (t->count + 1) * sizeof *t->taken);
    t->taken[t->count++] = *turn;
    pthread_mutex_unlock(&t->mutex);
    return true;
}

void store_turns_end(store_turns *t, store_turn turn)
{
    pthread_mutex_lock(&t->mutex);
    t->taken[find(t, turn)] = t->taken[t->count - 1];
    t->count--;
    pthread_cond_broadcast(&t->ended);
    pthread_mutex_unlock(&t->mutex);
}

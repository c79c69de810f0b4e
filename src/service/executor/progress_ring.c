// SPDX-License-Identifier: Apache-2.0
#include "service/executor/progress_ring.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

struct progress_ring {
    pthread_mutex_t mutex;
    int64_t newest;                               /* number of the last line; 0: none */
    progress_ring_line line[PROGRESS_RING_LINES]; /* number n at n % PROGRESS_RING_LINES */
};

progress_ring *progress_ring_new(void)
{
    progress_ring *r = mem_alloc(sizeof *r);
    pthread_mutex_init(&r->mutex, NULL);
    return r;
}

void progress_ring_free(progress_ring *r)
{
    if (!r) return;
    for (size_t i = 0; i < PROGRESS_RING_LINES; i++) free(r->line[i].text);
    pthread_mutex_destroy(&r->mutex);
    free(r);
}

void progress_ring_add(progress_ring *r, const char *id, const char *owner, int frame, int attempt,
                       const char *text)
{
    progress_ring_line made = {.frame = frame, .attempt = attempt, .text = mem_strdup(text)};
    snprintf(made.id, sizeof made.id, "%s", id);
    snprintf(made.owner, sizeof made.owner, "%s", owner);
    pthread_mutex_lock(&r->mutex);
    made.number = ++r->newest;
    progress_ring_line *place = &r->line[made.number % PROGRESS_RING_LINES];
    char *old = place->text;
    *place = made;
    pthread_mutex_unlock(&r->mutex);
    free(old);
}

size_t progress_ring_list(progress_ring *r, const char *id, const char *owner, int64_t after, size_t limit,
                          progress_ring_line **lines, int64_t *newest)
{
    progress_ring_line *found = mem_alloc(limit * sizeof *found);
    size_t count = 0;
    pthread_mutex_lock(&r->mutex);
    int64_t oldest = r->newest - PROGRESS_RING_LINES + 1;
    if (oldest < 1) oldest = 1;
    if (after > r->newest) after = r->newest; /* it may be a number from before a restart */
    int64_t number = after + 1 > oldest ? after + 1 : oldest;
    for (; number <= r->newest && count < limit; number++) {
        const progress_ring_line *l = &r->line[number % PROGRESS_RING_LINES];
        if ((id && strcmp(l->id, id) != 0) || (owner && strcmp(l->owner, owner) != 0)) continue;
        found[count] = *l;
        found[count++].text = mem_strdup(l->text);
    }
    pthread_mutex_unlock(&r->mutex);
    *lines = found;
    *newest = number - 1;
    return count;
}

void progress_ring_lines_free(progress_ring_line *lines, size_t count)
{
    for (size_t i = 0; i < count; i++) free(lines[i].text);
    free(lines);
}

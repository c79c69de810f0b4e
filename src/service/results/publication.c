// SPDX-License-Identifier: Apache-2.0
#include "service/results/publication.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/memory.h"

struct publication {
    pthread_t thread;
    bool started;
    output_place *outputs;
    char *user, *from, *directory, *temporary;
    int frame;
    int end_fd;
    atomic_bool ended;
    bool ok;
    error fault;
};

char *publication_temporary(const char *from)
{
    const char *slash = strrchr(from, '/'); /* the last part of the path is unique: job, frame and attempt */
    return output_place_temporary(slash ? slash + 1 : from);
}

static void *run(void *argument)
{
    publication *p = argument;
    p->ok = output_place_copy(p->outputs, p->user, p->from, p->directory, p->frame, p->temporary, &p->fault);
    atomic_store(&p->ended, true);
    ssize_t written = write(p->end_fd, &(uint64_t){1}, sizeof(uint64_t));
    (void)written; /* fails only if the counter is full, and then the eventfd is readable anyway */
    return NULL;
}

publication *publication_start(output_place *outputs, const char *user, const char *from,
                               const char *directory, int frame, int end_fd)
{
    publication *p = mem_alloc(sizeof *p);
    p->outputs = outputs;
    p->user = mem_strdup(user);
    p->temporary = publication_temporary(from);
    p->from = mem_strdup(from);
    p->directory = mem_strdup(directory);
    p->frame = frame;
    p->end_fd = end_fd;
    p->started = pthread_create(&p->thread, NULL, run, p) == 0;
    if (!p->started) run(p); /* without a thread, this one copies, which delays other jobs */
    return p;
}

bool publication_has_ended(publication *p)
{
    return atomic_load(&p->ended);
}

bool publication_end(publication *p, error *e)
{
    if (p->started) pthread_join(p->thread, NULL);
    bool ok = p->ok;
    if (!ok && e) *e = p->fault;
    free(p->user);
    free(p->from);
    free(p->directory);
    free(p->temporary);
    free(p);
    return ok;
}

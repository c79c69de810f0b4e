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
    char *user, *directory, *path, *above, *temporary;
    int end_fd;
    atomic_bool ended;
    bool ok;
    error fault;
};

char *publication_temporary(const char *directory)
{
    const char *slash =
        strrchr(directory, '/'); /* the last part of the path is unique: job, frame and attempt */
    return mem_printf(".%s.hexad-tmp", slash ? slash + 1 : directory);
}

static void *run(void *argument)
{
    publication *p = argument;
    p->ok = output_place_copy(p->outputs, p->user, p->directory, p->path, p->above, p->temporary, &p->fault);
    if (!p->ok) error_prefix(&p->fault, "output.directory");
    atomic_store(&p->ended, true);
    ssize_t written = write(p->end_fd, &(uint64_t){1}, sizeof(uint64_t));
    (void)written; /* fails only if the counter is full, and then the eventfd is readable anyway */
    return NULL;
}

publication *publication_start(output_place *outputs, const char *user, const char *directory,
                               const char *path, const char *above, int end_fd)
{
    publication *p = mem_alloc(sizeof *p);
    p->outputs = outputs;
    p->user = mem_strdup(user);
    p->temporary = publication_temporary(directory);
    p->directory = mem_strdup(directory);
    p->path = mem_strdup(path);
    p->above = above ? mem_strdup(above) : NULL;
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
    free(p->directory);
    free(p->path);
    free(p->above);
    free(p->temporary);
    free(p);
    return ok;
}

#include "results/publication.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/memory.h"
#include "base/worker_contract.h"
#include "results/result.h"

struct publication {
    pthread_t thread;
    bool started;
    queue *q;
    const store_outputs *outputs;
    char *directory, *path, *temporary;
    int end_fd;
    atomic_bool ended;
    bool ok;
    error fault;
};

char *publication_temporary(const char *directory)
{
    const char *slash = strrchr(directory, '/'); /* the last part is unique: job, frame and attempt */
    return mem_printf(".%s.hexad-tmp", slash ? slash + 1 : directory);
}

static bool copy(publication *p)
{
    result r = {0};
    if (!result_read(p->directory, &r, &p->fault)) return false;
    const char **names = mem_alloc((r.output_count + 1) * sizeof *names);
    for (size_t i = 0; i < r.output_count; i++) names[i] = r.output[i].name;
    names[r.output_count] = WORKER_REPORT_NAME;
    bool ok = queue_note_copy(p->q, p->path, p->temporary, &p->fault) &&
              store_output_copy(p->outputs, p->directory, names, r.output_count + 1, p->path, p->temporary,
                                &p->fault);
    free(names);
    result_clear(&r);
    return ok;
}

static void *run(void *argument)
{
    publication *p = argument;
    p->ok = copy(p);
    if (!p->ok) error_prefix(&p->fault, "output.directory");
    atomic_store(&p->ended, true);
    ssize_t written = write(p->end_fd, &(uint64_t){1}, sizeof(uint64_t));
    (void)written; /* a full counter is readable, which is enough */
    return NULL;
}

publication *publication_start(queue *q, const store_outputs *outputs, const char *directory,
                               const char *path, int end_fd)
{
    publication *p = mem_alloc(sizeof *p);
    p->q = q;
    p->outputs = outputs;
    p->temporary = publication_temporary(directory);
    p->directory = mem_strdup(directory);
    p->path = mem_strdup(path);
    p->end_fd = end_fd;
    p->started = pthread_create(&p->thread, NULL, run, p) == 0;
    if (!p->started) run(p); /* without a thread the supervisor copies itself, which delays the others */
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
    free(p->directory);
    free(p->path);
    free(p->temporary);
    free(p);
    return ok;
}

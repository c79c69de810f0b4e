// SPDX-License-Identifier: Apache-2.0
#include "service/results/publication.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/background.h"
#include "base/core/memory.h"

struct publication {
    background_call *call;
    output_place *outputs;
    char *user, *from, *directory, *temporary;
    int frame;
    bool ok;
    error fault;
};

char *publication_temporary(const char *from)
{
    const char *slash = strrchr(from, '/'); /* the last part of the path is unique: job, frame and attempt */
    return output_place_temporary(slash ? slash + 1 : from);
}

static void copy(void *argument)
{
    publication *p = argument;
    p->ok = output_place_copy(p->outputs, p->user, p->from, p->directory, p->frame, p->temporary, &p->fault);
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
    p->call = background_call_start(copy, p, end_fd);
    return p;
}

bool publication_has_ended(const publication *p)
{
    return background_call_has_ended(p->call);
}

bool publication_end(publication *p, error *e)
{
    background_call_end(p->call);
    bool ok = p->ok;
    if (!ok && e) *e = p->fault;
    free(p->user);
    free(p->from);
    free(p->directory);
    free(p->temporary);
    free(p);
    return ok;
}

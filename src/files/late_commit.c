// SPDX-License-Identifier: Apache-2.0
#include "files/late_commit.h"

#include <stdlib.h>

#include "base/core/background.h"
#include "base/core/memory.h"

struct late_commit {
    store_file file;
    late_commit_step write;
    void *context;
    store_facts facts;
    pthread_t thread;
    bool beside, ok;
    error e;
};

static void *run(void *context)
{
    late_commit *c = context;
    c->ok =
        c->write(c->file.stream, c->context, &c->e) && store_file_place_verified(&c->file, &c->facts, &c->e);
    store_file_abort(&c->file);
    return NULL;
}

late_commit *late_commit_begin(store_file *file, late_commit_step write, void *context, bool beside)
{
    late_commit *c = mem_alloc(sizeof *c);
    c->file = *file;
    c->write = write;
    c->context = context;
    *file = (store_file){0};
    c->beside = beside && background_start(&c->thread, run, c, "the results", NULL);
    if (!c->beside) run(c);
    return c;
}

bool late_commit_end(late_commit *c, store_facts *out, error *e)
{
    if (c->beside) pthread_join(c->thread, NULL);
    const bool ok = c->ok;
    if (ok)
        *out = c->facts;
    else
        *e = c->e;
    free(c);
    return ok;
}

#include "files/late_commit.h"

#include <stdlib.h>

#include "base/core/background.h"
#include "base/core/memory.h"
#include "files/late_hash.h"

struct late_commit {
    store_file file;
    late_commit_step write, verify;
    void *context;
    store_facts facts;
    pthread_t thread;
    bool beside, hashes_beside, ok;
    error e;
};

bool late_commit_now(store_file *file, store_facts *out, error *e)
{
    store_facts facts;
    if (!store_file_hash(fileno(file->stream), facts.sha256, &facts.bytes, e)) {
        store_file_abort(file);
        return false;
    }
    if (!store_file_place(file, e)) return false;
    *out = facts;
    return true;
}

static void *run(void *context)
{
    late_commit *c = context;
    if (c->write(c->file.stream, c->context, &c->e)) {
        store_file_begin_flush(&c->file);
        late_hash *hash = late_hash_begin(fileno(c->file.stream), c->hashes_beside);
        const bool verified = c->verify(c->file.stream, c->context, &c->e);
        c->ok = late_hash_end(hash, &c->facts, verified ? &c->e : NULL) && verified &&
                store_file_place(&c->file, &c->e);
    }
    store_file_abort(&c->file);
    return NULL;
}

late_commit *late_commit_begin(store_file *file, late_commit_step write, late_commit_step verify,
                               void *context, bool beside, bool hashes_beside)
{
    late_commit *c = mem_alloc(sizeof *c);
    c->file = *file;
    c->write = write;
    c->verify = verify;
    c->context = context;
    c->hashes_beside = hashes_beside;
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

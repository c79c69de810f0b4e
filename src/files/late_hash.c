// SPDX-License-Identifier: Apache-2.0
#include "files/late_hash.h"

#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/background.h"
#include "base/core/memory.h"

/* In bytes. Hashing 2 MiB takes about 1 ms; smaller files are not worth a thread. */
static const off_t SMALL = 2 << 20;

struct late_hash {
    int fd; /* a duplicate if a thread hashes */
    store_facts facts;
    pthread_t thread;
    bool beside, ok;
    error e;
};

static void *run(void *context)
{
    late_hash *h = context;
    h->ok = store_file_hash(h->fd, h->facts.sha256, &h->facts.bytes, &h->e);
    return NULL;
}

late_hash *late_hash_begin(int fd, bool beside)
{
    late_hash *h = mem_alloc(sizeof *h);
    struct stat info;
    if (beside && fstat(fd, &info) == 0 && info.st_size > SMALL &&
        (h->fd = fcntl(fd, F_DUPFD_CLOEXEC, 0)) >= 0) {
        h->beside = background_start(&h->thread, run, h, "a hash", NULL);
        if (!h->beside) close(h->fd);
    }
    if (!h->beside) {
        h->fd = fd;
        run(h);
    }
    return h;
}

bool late_hash_end(late_hash *h, store_facts *out, error *e)
{
    if (!h) return true;
    if (h->beside) {
        pthread_join(h->thread, NULL);
        close(h->fd);
    }
    const bool ok = h->ok;
    if (ok)
        *out = h->facts;
    else if (e)
        *e = h->e;
    free(h);
    return ok;
}

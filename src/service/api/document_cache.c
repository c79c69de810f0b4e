// SPDX-License-Identifier: Apache-2.0
#include "service/api/document_cache.h"

#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/hash.h"
#include "base/core/memory.h"

/* Places in a row. The hash of the id of a job determines the row of its documents. */
#define ROW_PLACES 4

typedef struct place {
    char id[ULID_SIZE]; /* "": the place is unused */
    job_json_viewer viewer;
    int64_t seq;
    uint64_t stamp;
    char *owner;
    cached_document document;
} place;

typedef struct row {
    place place[ROW_PLACES];
    unsigned next; /* the place of the next new document, modulo ROW_PLACES */
} row;

struct document_cache {
    pthread_mutex_t mutex;
    size_t count;
    row *rows;
};

document_cache *document_cache_new(size_t places)
{
    if (!places) return NULL;
    document_cache *c = mem_alloc(sizeof *c);
    pthread_mutex_init(&c->mutex, NULL);
    c->count = (places + ROW_PLACES - 1) / ROW_PLACES;
    c->rows = mem_alloc(c->count * sizeof *c->rows);
    return c;
}

static void empty(place *p)
{
    free(p->owner);
    free(p->document.text);
    *p = (place){0};
}

void document_cache_free(document_cache *c)
{
    if (!c) return;
    for (size_t i = 0; i < c->count; i++)
        for (size_t k = 0; k < ROW_PLACES; k++) empty(&c->rows[i].place[k]);
    free(c->rows);
    pthread_mutex_destroy(&c->mutex);
    free(c);
}

static row *row_of(document_cache *c, const char *id)
{
    return &c->rows[hash_add_text(HASH_NONE, id) % c->count];
}

bool document_cache_find(document_cache *c, queue *q, const char *id, const access_caller *caller,
                         cached_document *found)
{
    bool any = false;
    if (!c) return false;
    row *r = row_of(c, id);
    pthread_mutex_lock(&c->mutex);
    for (size_t i = 0; !any && i < ROW_PLACES; i++) {
        const place *p = &r->place[i];
        if (strcmp(p->id, id) != 0 || p->viewer != job_json_viewer_of(caller, p->owner) ||
            p->stamp != queue_stamp(q, p->seq))
            continue;
        any = true;
        *found = p->document;
        found->text = mem_strndup(p->document.text, p->document.length);
    }
    pthread_mutex_unlock(&c->mutex);
    return any;
}

void document_cache_put(document_cache *c, const queue_job *job, job_json_viewer viewer,
                        const cached_document *document)
{
    if (!c || document->length > DOCUMENT_CACHE_BYTES_MOST) return;
    row *r = row_of(c, job->id);
    pthread_mutex_lock(&c->mutex);
    place *p = NULL;
    for (size_t i = 0; i < ROW_PLACES; i++)
        if (strcmp(r->place[i].id, job->id) == 0 && r->place[i].viewer == viewer) p = &r->place[i];
    if (!p) p = &r->place[r->next++ % ROW_PLACES];
    empty(p);
    memcpy(p->id, job->id, sizeof p->id);
    p->viewer = viewer;
    p->seq = job->seq;
    p->stamp = job->stamp;
    p->owner = mem_strdup(job->owner);
    p->document = *document;
    p->document.text = mem_strndup(document->text, document->length);
    pthread_mutex_unlock(&c->mutex);
}

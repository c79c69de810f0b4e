#include "http/shelf.h"

#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

/* A document has its place in one row, by the id of its job. */
#define ROW_PLACES 4

typedef struct place {
    char id[ULID_SIZE]; /* "": free */
    bool own;
    int64_t seq;
    uint64_t stamp;
    char *owner;
    shelf_document document;
} place;

typedef struct row {
    place place[ROW_PLACES];
    unsigned next; /* to be taken when all are */
} row;

struct shelf {
    pthread_mutex_t mutex;
    size_t count;
    row *rows;
};

shelf *shelf_new(size_t places)
{
    if (!places) return NULL;
    shelf *s = mem_alloc(sizeof *s);
    pthread_mutex_init(&s->mutex, NULL);
    s->count = (places + ROW_PLACES - 1) / ROW_PLACES;
    s->rows = mem_alloc(s->count * sizeof *s->rows);
    return s;
}

static void empty(place *p)
{
    free(p->owner);
    free(p->document.text);
    *p = (place){0};
}

void shelf_free(shelf *s)
{
    if (!s) return;
    for (size_t i = 0; i < s->count; i++)
        for (size_t k = 0; k < ROW_PLACES; k++) empty(&s->rows[i].place[k]);
    free(s->rows);
    pthread_mutex_destroy(&s->mutex);
    free(s);
}

static row *row_of(shelf *s, const char *id)
{
    uint64_t hash = 14695981039346656037u; /* FNV-1a */
    for (; *id; id++) hash = (hash ^ (unsigned char)*id) * 1099511628211u;
    return &s->rows[hash % s->count];
}

bool shelf_find(shelf *s, queue *q, const char *id, const access_caller *caller, shelf_document *found)
{
    bool any = false;
    if (!s) return false;
    row *r = row_of(s, id);
    pthread_mutex_lock(&s->mutex);
    for (size_t i = 0; !any && i < ROW_PLACES; i++) {
        const place *p = &r->place[i];
        if (strcmp(p->id, id) != 0 || p->own != access_is_owner(caller, p->owner) ||
            p->stamp != queue_stamp(q, p->seq))
            continue;
        any = true;
        *found = p->document;
        found->text = mem_strndup(p->document.text, p->document.length);
    }
    pthread_mutex_unlock(&s->mutex);
    return any;
}

void shelf_put(shelf *s, const queue_job *job, bool own, const shelf_document *document)
{
    if (!s || document->length > SHELF_BYTES_MOST) return;
    row *r = row_of(s, job->id);
    pthread_mutex_lock(&s->mutex);
    place *p = NULL;
    for (size_t i = 0; i < ROW_PLACES; i++)
        if (strcmp(r->place[i].id, job->id) == 0 && r->place[i].own == own) p = &r->place[i];
    if (!p) p = &r->place[r->next++ % ROW_PLACES];
    empty(p);
    memcpy(p->id, job->id, sizeof p->id);
    p->own = own;
    p->seq = job->seq;
    p->stamp = job->stamp;
    p->owner = mem_strdup(job->owner);
    p->document = *document;
    p->document.text = mem_strndup(document->text, document->length);
    pthread_mutex_unlock(&s->mutex);
}

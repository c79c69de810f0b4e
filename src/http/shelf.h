/* shelf: documents of jobs as they were last shown, to be shown again while their jobs do not change.
 *
 * Each is kept with the stamp that its job had (queue_stamp), and given out under no other, so that what is
 * given out holds every change that was acknowledged. What an owner is shown and what others are stand apart.
 * The shelf has a number of places, and no document over SHELF_BYTES_MOST is kept: the newest take the places of
 * others. Any thread.
 */
#ifndef HEXAD_HTTP_SHELF_H
#define HEXAD_HTTP_SHELF_H

#include <stdbool.h>
#include <stddef.h>

#include "auth/access.h"
#include "queue/queue.h"

#define SHELF_BYTES_MOST 16384
#define SHELF_TAG_SIZE 40

typedef struct shelf shelf;

typedef struct shelf_document {
    char *text; /* JSON, to be freed */
    size_t length;
    char tag[SHELF_TAG_SIZE]; /* ETag */
} shelf_document;

/* For so many documents, rounded up to four. 0: NULL, which is a shelf that keeps none. */
shelf *shelf_new(size_t places);
void shelf_free(shelf *s); /* accepts NULL */

/* What this caller is shown of the job; false: it is not there, or the job is not what it was. */
bool shelf_find(shelf *s, queue *q, const char *id, const access_caller *caller, shelf_document *found);

/* Keeps a copy. `job` is what queue_get gave, and the document is made of that and of what changes with it; `own`:
 * it is for the owner. */
void shelf_put(shelf *s, const queue_job *job, bool own, const shelf_document *document);

#endif

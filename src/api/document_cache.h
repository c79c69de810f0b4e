/* document_cache: the documents of jobs, ready to be sent again while their jobs do not change.
 *
 * A document is stored with the stamp that its job had (queue_stamp) and is returned only while the job has
 * that stamp, so that it never misses a change that was acknowledged. The document for the owner and the one
 * for other readers are stored apart. The cache has a fixed number of places; a new document replaces an
 * older one. Documents longer than DOCUMENT_CACHE_BYTES_MOST are not stored. Any thread.
 */
#ifndef HEXAD_API_DOCUMENT_CACHE_H
#define HEXAD_API_DOCUMENT_CACHE_H

#include <stdbool.h>
#include <stddef.h>

#include "api/job_json.h"
#include "auth/access.h"
#include "queue/queue.h"

#define DOCUMENT_CACHE_BYTES_MOST 16384

typedef struct document_cache document_cache;

typedef struct cached_document {
    char *text; /* JSON, to be freed */
    size_t length;
    char tag[JOB_JSON_TAG_SIZE]; /* ETag */
} cached_document;

/* For so many documents, rounded up to a multiple of four. 0: NULL, a cache that stores none. */
document_cache *document_cache_new(size_t places);
void document_cache_free(document_cache *c); /* accepts NULL */

/* Returns a copy of the document that this caller may see; false when it is not stored or the job has
 * changed. */
bool document_cache_find(document_cache *c, queue *q, const char *id, const access_caller *caller,
                         cached_document *found);

/* Stores a copy. `job` comes from queue_get, and the document depends on nothing that changes without it.
 * `own`: the document is the owner's. */
void document_cache_put(document_cache *c, const queue_job *job, bool own, const cached_document *document);

#endif

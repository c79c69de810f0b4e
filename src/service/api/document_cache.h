// SPDX-License-Identifier: Apache-2.0
/* document_cache: caches the JSON documents of jobs until the jobs change.
 *
 * A document is stored with the stamp of its job (queue_stamp) and is returned only while the job has this
 * stamp. So it always contains every change that was acknowledged to a client. The documents for the owner,
 * for administrators and for other readers are separate entries. The number of entries is fixed; a new
 * document replaces an older one. Any thread.
 */
#ifndef HEXAD_SERVICE_API_DOCUMENT_CACHE_H
#define HEXAD_SERVICE_API_DOCUMENT_CACHE_H

#include <stdbool.h>
#include <stddef.h>

#include "service/api/job_json.h"
#include "service/auth/access.h"
#include "service/queue/queue.h"

#define DOCUMENT_CACHE_BYTES_MOST 16384 /* longer documents are not stored */

typedef struct document_cache document_cache;

typedef struct cached_document {
    char *text; /* JSON; the owner of the struct frees it */
    size_t length;
    char tag[JOB_JSON_TAG_SIZE]; /* ETag */
} cached_document;

/* A cache for `places` documents, rounded up to a multiple of four. 0: NULL, which the functions below accept
 * as a cache that stores nothing. */
document_cache *document_cache_new(size_t places);
void document_cache_free(document_cache *c); /* accepts NULL */

/* Returns a copy of the stored document that this caller may see. False if it is not stored or the job has
 * changed. */
bool document_cache_find(document_cache *c, queue *q, const char *id, const access_caller *caller,
                         cached_document *found);

/* Stores a copy. `job` must come from queue_get. The document must not contain anything that can change while
 * the stamp of the job stays the same. `viewer`: for whom it was made. */
void document_cache_put(document_cache *c, const queue_job *job, job_json_viewer viewer,
                        const cached_document *document);

#endif

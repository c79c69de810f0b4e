// SPDX-License-Identifier: Apache-2.0
/* constant_document: a document that does not change while the service runs. It is made once, at the start of
 * the service, and all answers share its bytes. Constant data; any thread.
 */
#ifndef HEXAD_SERVICE_API_CONSTANT_DOCUMENT_H
#define HEXAD_SERVICE_API_CONSTANT_DOCUMENT_H

#include <stddef.h>

#include "service/http/handler.h"
#include "files/file.h"

typedef struct constant_document {
    const char *type; /* the media type, a constant */
    char *bytes;
    size_t length;
    char tag[STORE_HASH_SIZE + 2]; /* ETag */
} constant_document;

/* Takes over the bytes. `type` is a constant. */
constant_document constant_document_make(const char *type, char *bytes, size_t length);
void constant_document_clear(constant_document *d);

/* Answers with the document, or with 304 if the client has it already. The document must outlive the
 * server. */
void constant_document_answer(const constant_document *d, const http_request *request, reply *r);

#endif

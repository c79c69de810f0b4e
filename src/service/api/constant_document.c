// SPDX-License-Identifier: Apache-2.0
#include "service/api/constant_document.h"

#include <stdio.h>
#include <stdlib.h>

#include "service/http/preconditions.h"

constant_document constant_document_make(const char *type, char *bytes, size_t length)
{
    char hash[STORE_HASH_SIZE];
    constant_document d = {.type = type, .bytes = bytes, .length = length};
    store_hash(bytes, length, hash);
    snprintf(d.tag, sizeof d.tag, "\"%s\"", hash);
    return d;
}

void constant_document_clear(constant_document *d)
{
    free(d->bytes);
    *d = (constant_document){0};
}

void constant_document_answer(const constant_document *d, const http_request *request, reply *r)
{
    const char *known = request->header[HTTP_IF_NONE_MATCH];
    if (known && preconditions_match(known, d->tag))
        reply_set_empty(r, 304);
    else
        reply_set_constant(r, d->type, d->bytes, d->length);
    r->cache_control = "no-cache";
    reply_add_header(r, "ETag", d->tag);
}

// SPDX-License-Identifier: Apache-2.0
#include "service/http/fields.h"

#include <string.h>
#include <strings.h>

#include <microhttpd.h>

/* Reads the fields that identify the origin of the request and the requested host. */
static void read_origin_field(fields *f, const char *key, const char *value)
{
    if (strcasecmp(key, MHD_HTTP_HEADER_HOST) == 0) {
        f->hosts++;
        f->host = value ? value : "";
    } else if (strcasecmp(key, MHD_HTTP_HEADER_ORIGIN) == 0) {
        f->origins++;
        f->origin = value ? value : "";
    } else if (strcasecmp(key, "Sec-Fetch-Site") == 0) {
        f->site = value;
    } else if (strcasecmp(key, "Sec-Fetch-Dest") == 0) {
        f->destination = value;
    } else if (strcasecmp(key, MHD_HTTP_HEADER_FORWARDED) == 0) {
        if (f->forwarded_count < FIELDS_MOST_FORWARDED) f->forwarded[f->forwarded_count] = value ? value : "";
        f->forwarded_count++;
    }
}

static enum MHD_Result read_field(void *context, enum MHD_ValueKind kind, const char *key, const char *value)
{
    (void)kind;
    fields *f = context;
    if (strcasecmp(key, MHD_HTTP_HEADER_CONTENT_LENGTH) == 0) {
        f->lengths++;
        f->length = value;
    } else if (strcasecmp(key, MHD_HTTP_HEADER_TRANSFER_ENCODING) == 0) {
        f->codings++;
        f->chunked = value && strcasecmp(value, "chunked") == 0;
    } else if (strcasecmp(key, MHD_HTTP_HEADER_CONTENT_ENCODING) == 0) {
        f->coded = f->coded || !value || strcasecmp(value, "identity") != 0;
    } else if (strcasecmp(key, MHD_HTTP_HEADER_AUTHORIZATION) == 0) {
        f->authorizations++;
        f->authorization = value;
    } else {
        read_origin_field(f, key, value);
    }
    return MHD_YES;
}

fields fields_read(struct MHD_Connection *connection)
{
    fields f = {0};
    MHD_get_connection_values(connection, MHD_HEADER_KIND, read_field, &f);
    return f;
}

bool fields_is_media_type(const char *type, const char *wanted)
{
    size_t length = strlen(wanted);
    return type && strncasecmp(type, wanted, length) == 0 &&
           (type[length] == '\0' || type[length] == ';' || type[length] == ' ');
}

// SPDX-License-Identifier: Apache-2.0
#include "service/http/head.h"

#include <stdint.h>
#include <string.h>

#include <microhttpd.h>

#include "service/http/handler.h"

#define LINE_END 2 /* bytes: CR LF */
/* The library leaves the received bytes in place. */
#define LEAVES_BYTES (MHD_VERSION < 0x01000000)

static bool is_control_byte(char byte)
{
    return (unsigned char)byte < ' ' || byte == 0x7f;
}

head_target head_look(const char *uri)
{
    head_target t = {.start = uri, .end = uri + strlen(uri), .plain = true};
    for (const char *at = uri; t.plain && at < t.end; at++) t.plain = *at != ' ' && !is_control_byte(*at);
    const char *query = strchr(uri, '?'), *next = query;
    for (size_t count = 0; next && next[1]; count++, next = strchr(next + 1, '&'))
        if (count == HTTP_MAX_QUERY) t.has_too_many_parameters = true;
    /* writes to the library's own buffer, which the library splits at the next step */
    if (t.has_too_many_parameters) *(char *)(uintptr_t)(query + 1) = '\0';
    return t;
}

/* State of the iteration over the headers. */
typedef struct walk {
    const char *at; /* start of the next line */
    bool plain;     /* no fault was found */
} walk;

static enum MHD_Result pass_line(void *context, enum MHD_ValueKind kind, const char *name, size_t name_length,
                                 const char *value, size_t length)
{
    (void)kind;
    walk *w = context;
    w->plain = name_length && (!LEAVES_BYTES || name == w->at);
    for (size_t i = 0; w->plain && i < name_length; i++) w->plain = head_is_token_byte(name[i]);
    if (!w->plain) return MHD_NO;
    const char *start = name + name_length + 1; /* after the colon */
    w->plain = !LEAVES_BYTES || value == start + strspn(start, " \t");
    for (size_t i = 0; w->plain && i < length; i++) w->plain = value[i] == '\t' || !is_control_byte(value[i]);
    w->at = value + length + LINE_END;
    return w->plain ? MHD_YES : MHD_NO;
}

static bool is_request_line(const char *method, const char *version, const head_target *t)
{
    while (head_is_token_byte(*method)) method++;
    return method + 1 == t->start && t->end + 1 == version;
}

/* The fault of the head; NULL: none. */
static const char *find_fault(struct MHD_Connection *connection, const char *method, const char *version,
                              const head_target *target)
{
    size_t size = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_REQUEST_HEADER_SIZE)->header_size;
    walk w = {.at = version + strlen(version) + LINE_END, .plain = true};
    if (!target->plain || (LEAVES_BYTES && !is_request_line(method, version, target)))
        return "the request line must be METHOD PATH VERSION with one blank between, and no control bytes";
    MHD_get_connection_values_n(connection, MHD_HEADER_KIND, pass_line, &w);
    if (w.plain && (!LEAVES_BYTES || w.at + LINE_END == method + size)) return NULL;
    return "each line must end with CR LF, and each header be NAME: VALUE on one line, without a blank before the"
           " colon and without control bytes";
}

/* Whether the digits are a length. *large: the number exceeds 64 bits. */
static bool is_length(const char *digits, size_t count, bool *large)
{
    uint64_t number = 0;
    *large = false;
    for (size_t i = 0; i < count; i++) {
        if (digits[i] < '0' || digits[i] > '9') return false;
        const unsigned digit = (unsigned)(digits[i] - '0');
        *large |= number > (UINT64_MAX - digit) / 10;
        number = 10 * number + digit;
    }
    return count > 0;
}

/* Finds the first header of this name. False: there is none. */
static bool find_header(struct MHD_Connection *connection, const char *name, const char **value,
                        size_t *length)
{
    return MHD_lookup_connection_value_n(connection, MHD_HEADER_KIND, name, strlen(name), value, length) ==
           MHD_YES;
}

bool head_refuse_unread(struct MHD_Connection *connection, reply *r)
{
    const union MHD_ConnectionInfo *info =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_REQUEST_HEADER_SIZE);
    const char *value = NULL;
    size_t length = 0;
    bool large = false;
    if (!info || !info->header_size) return false; /* the end of the headers has not arrived */
    /* the library ignores a length if there is a transfer coding */
    if (!find_header(connection, MHD_HTTP_HEADER_TRANSFER_ENCODING, &value, &length) &&
        find_header(connection, MHD_HTTP_HEADER_CONTENT_LENGTH, &value, &length)) {
        const bool is_number = is_length(value, length, &large);
        if (!is_number)
            reply_set_problem(r, "request_invalid", NULL, "Content-Length must be a number of bytes");
        else if (large)
            reply_set_problem(r, "body_too_large", NULL,
                              "Content-Length exceeds all limits: send a smaller body");
        if (!is_number || large) return true;
    }
    /* The library copies this header before it parses the cookies. Later versions also report cookies that
     * they refuse. */
    if (MHD_VERSION > 0x00097600 || !find_header(connection, MHD_HTTP_HEADER_COOKIE, &value, &length))
        return false;
    reply_set_problem(r, "request_invalid", NULL,
                      "the headers exceed the setting header_limit_bytes: send shorter ones");
    return true;
}

bool head_refuse(struct MHD_Connection *connection, const char *method, const char *version,
                 const head_target *target, reply *r)
{
    const char *fault = find_fault(connection, method, version, target);
    if (fault)
        reply_set_problem(r, "request_invalid", NULL, "%s", fault);
    else if (target->has_too_many_parameters)
        reply_set_problem(r, "request_invalid", NULL, "the query has more than %d parameters: send fewer",
                          HTTP_MAX_QUERY);
    return fault || target->has_too_many_parameters;
}

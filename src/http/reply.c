#include "http/reply.h"

#include <assert.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/log.h"
#include "base/memory.h"

typedef struct problem {
    const char *code;
    int status;
    const char *title;
} problem;

static const problem problems[] = {
    {"json_invalid", 400, "The body is not valid JSON"},
    {"request_invalid", 400, "The request cannot be understood"},
    {"path_forbidden", 403, "The path is not open to jobs"},
    {"not_found", 404, "There is no such thing"},
    {"method_not_allowed", 405, "The method does not apply here"},
    {"conflict", 409, "The state of the job does not admit this"},
    {"body_too_large", 413, "The body is too large"},
    {"media_type_unsupported", 415, "The media type is not supported"},
    {"spec_invalid", 422, "The job spec is not valid"},
    {"not_supported", 422, "The job spec asks for something not built yet"},
    {"input_missing", 422, "The input file is missing"},
    {"input_unsupported", 422, "The input is not of a kind that can be read"},
    {"limit_memory", 422, "The job needs more memory than there is"},
    {"too_many_jobs", 429, "The user has too many jobs"},
    {"unavailable", 503, "The service takes no jobs now"},
    {"internal", 500, "The service failed"}, /* the last one: also for a code not listed */
};

static const problem *find_problem(const char *code)
{
    size_t last = sizeof problems / sizeof *problems - 1, i = 0;
    while (i < last && strcmp(problems[i].code, code) != 0) i++;
    return &problems[i];
}

void reply_clear(reply *r)
{
    free(r->body);
    if (r->fd >= 0) close(r->fd);
    for (size_t i = 0; i < r->header_count; i++) free(r->header[i].value);
    *r = (reply){.fd = -1};
}

void reply_add_header(reply *r, const char *name, const char *value)
{
    assert(r->header_count < REPLY_MAX_HEADERS);
    r->header[r->header_count].name = name;
    r->header[r->header_count++].value = mem_strdup(value);
}

void reply_set_json(reply *r, int status, json *document)
{
    reply_clear(r);
    r->status = status;
    r->content_type = "application/json";
    r->body = json_print(document);
    r->length = strlen(r->body);
    json_free(document);
}

void reply_set_file(reply *r, const char *content_type, int fd, int64_t bytes)
{
    reply_clear(r);
    r->status = 200;
    r->content_type = content_type;
    r->fd = fd;
    r->fd_bytes = bytes;
}

void reply_set_problem(reply *r, const char *code, json *errors, const char *format, ...)
{
    char detail[1024];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(detail, sizeof detail, format, arguments);
    va_end(arguments);
    const problem *p = find_problem(code);
    char *type = mem_printf("urn:hexad:problem:%s", p->code);
    json *document = json_new_object();
    json_put_string(document, "type", type);
    json_put_string(document, "title", p->title);
    json_put_integer(document, "status", p->status);
    json_put_string(document, "detail", detail);
    json_put_string(document, "code", p->code);
    json_put(document, "errors", errors ? errors : json_new_array());
    free(type);
    reply_set_json(r, p->status, document);
    r->content_type = "application/problem+json";
}

void reply_set_error(reply *r, const error *e, json *errors)
{
    const char *code = error_code_name(e->code);
    if (find_problem(code)->status == 500)
        log_write(LOG_LEVEL_ERROR, "request failed: %s", e->message);
    reply_set_problem(r, code, errors, "%s", e->message);
}

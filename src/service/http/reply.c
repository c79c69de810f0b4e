// SPDX-License-Identifier: Apache-2.0
#include "service/http/reply.h"

#include <assert.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/log.h"
#include "base/core/memory.h"

/* Seconds in Retry-After; a restart of the daemon takes less. */
#define RETRY_AFTER_S "5"

static const reply_problem problems[] = {
    {"json_invalid", 400, "The body is not valid JSON"},
    {"request_invalid", 400, "The request is not valid"},
    {"unauthorized", 401, "The caller is unknown"},
    {"forbidden", 403, "The caller may not do this"},
    {"origin_forbidden", 403, "Pages of this origin may not send requests"},
    {"path_forbidden", 403, "Jobs may not use this path"},
    {"not_found", 404, "The resource does not exist"},
    {"method_not_allowed", 405, "The method is not allowed here"},
    {"conflict", 409, "The state of the job does not allow this"},
    {"gone", 410, "The resource was removed from the service"},
    {"output_taken", 409, "A result of another user is in the output directory"},
    {"precondition_failed", 412, "The resource has changed"},
    {"body_too_large", 413, "The body is too large"},
    {"media_type_unsupported", 415, "The media type is not supported"},
    {"range_not_satisfiable", 416, "The range is beyond the end"},
    {"misdirected_request", 421, "The request is for another host"},
    {"idempotency_mismatch", 422, "The key was used for another request"},
    {"digest_mismatch", 422, "The bytes do not have the announced SHA-256"},
    {"spec_invalid", 422, "The job spec is not valid"},
    {"not_supported", 422, "The job spec requests something that is not supported"},
    {"input_missing", 422, "The input file is missing"},
    {"input_unsupported", 422, "The format of the input is not supported"},
    {"input_damaged", 422, "The input cannot be read"},
    {"grid_missing", 422, "The input has no such grid"},
    {"attribute_missing", 422, "The input has no such attribute"},
    {"grid_ambiguous", 422, "The input has more than one such grid"},
    {"isovalue_required", 422, "The input needs an isovalue"},
    {"no_surface", 422, "There is no surface"},
    {"too_many_requests", 429, "The client or user has reached a limit of simultaneous requests"},
    {"unavailable", 503, "The service cannot do this now"},
    {"database_damaged", 503, "The database of the service is damaged"},
    {"state_lost", 503, "The state directory of the service is lost"},
    {"output_unwritable", 422, "The service cannot write to the output directory"},
    {"limit_memory", 422, "The job needs more memory than there is"},
    {"too_many_jobs", 429, "The user has too many jobs"},
    {"too_many_tasks", 429, "The user has too many tasks"},
    {"results_full", 507, "The results have reached their bound"},
    {"too_many_submissions", 429, "The user has submitted too many jobs"},
    {"priority_forbidden", 403, "The caller may not give this priority"},
    {"storage_full", 507, "The storage is full"},
    {"internal", 500, "The service has failed"}, /* last row: also for codes that are not listed */
};

#define COUNT (sizeof problems / sizeof *problems)

/* Codes of jobs that no answer has. */
static const reply_problem of_jobs[] = {
    {"limit_time", 0, "The job ran longer than allowed"},
    {"limit_file", 0, "A file of the job is longer than allowed"},
    {"stalled", 0, "The worker reported no progress"},
    {"cancelled", 0, "The job was cancelled"},
    {"dependency_failed", 0, "A job that this one depends on failed"},
    {"storage_failed", 0, "The storage failed"},
    {"interrupted", 0, "The daemon or the host ended during the job"},
};

const reply_problem *reply_problem_at(size_t index)
{
    return index < COUNT ? &problems[index] : NULL;
}

const reply_problem *reply_find_problem(const char *code)
{
    size_t last = COUNT - 1, i = 0;
    while (i < last && strcmp(problems[i].code, code) != 0) i++;
    return &problems[i];
}

const char *reply_title(const char *code)
{
    for (size_t i = 0; i < sizeof of_jobs / sizeof *of_jobs; i++)
        if (strcmp(of_jobs[i].code, code) == 0) return of_jobs[i].title;
    return reply_find_problem(code)->title;
}

void reply_clear(reply *r)
{
    free(r->body);
    if (r->fd >= 0) close(r->fd);
    if (r->source) r->source->free(r->source);
    if (r->receipt) r->receipt->end(r->receipt, false);
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
    reply_set_text(r, "application/json", json_print(document));
    r->status = status;
    json_free(document);
}

void reply_set_text(reply *r, const char *content_type, char *text)
{
    reply_clear(r);
    r->status = 200;
    r->content_type = content_type;
    r->body = text;
    r->length = strlen(text);
}

void reply_set_constant(reply *r, const char *content_type, const char *bytes, size_t length)
{
    reply_clear(r);
    r->status = 200;
    r->content_type = content_type;
    r->constant = bytes;
    r->length = length;
}

void reply_set_empty(reply *r, int status)
{
    reply_clear(r);
    r->status = status;
}

static void set_topic(reply *r, const char *topic)
{
    assert(strlen(topic) < sizeof r->topic);
    strcpy(r->topic, topic);
}

void reply_set_source(reply *r, const char *content_type, const char *topic, reply_source *source)
{
    reply_clear(r);
    r->status = 200;
    r->content_type = content_type;
    r->source = source;
    set_topic(r, topic);
}

void reply_set_waiting(reply *r, const char *topic, int64_t again_ms)
{
    reply_clear(r);
    r->again_ms = again_ms;
    set_topic(r, topic);
}

void reply_set_file(reply *r, const char *content_type, int fd, int64_t bytes)
{
    reply_clear(r);
    r->status = 200;
    r->content_type = content_type;
    r->fd = fd;
    r->fd_bytes = bytes;
}

void reply_append_fault(json *errors, const char *pointer, const char *detail)
{
    json *o = json_append_object(errors);
    json_put_string(o, "pointer", pointer);
    json_put_string(o, "detail", detail);
}

void reply_set_problem(reply *r, const char *code, json *errors, const char *format, ...)
{
    char detail[1024];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(detail, sizeof detail, format, arguments);
    va_end(arguments);
    const reply_problem *p = reply_find_problem(code);
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

void reply_add_member(reply *r, const char *name, json *value)
{
    json *document = json_parse(r->body, r->length, NULL);
    json_put(document, name, value);
    free(r->body);
    r->body = json_print(document);
    r->length = strlen(r->body);
    json_free(document);
}

void reply_ask_again(reply *r)
{
    reply_add_header(r, "Retry-After", "1");
}

void reply_set_refusal(reply *r, ledger_refusal why)
{
    char after[24];
    reply_set_problem(r, why.code, NULL, "%s", why.message);
    snprintf(after, sizeof after, "%lld", (long long)why.retry_s);
    if (why.retry_s) reply_add_header(r, "Retry-After", after);
}

void reply_set_unavailable(reply *r, const char *why)
{
    reply_set_problem(r, "unavailable", NULL, "%s", why);
    reply_add_header(r, "Retry-After", RETRY_AFTER_S);
}

void reply_set_storage_full(reply *r, const char *why)
{
    reply_set_problem(r, "storage_full", NULL, "%s", why);
    reply_add_header(r, "Retry-After", RETRY_AFTER_S);
}

void reply_set_error(reply *r, const error *e, json *errors)
{
    if (e->code == ERROR_STORAGE_FULL) {
        json_free(errors);
        reply_set_storage_full(r, e->message);
        return;
    }
    const char *code = error_code_name(e->code);
    if (reply_find_problem(code)->status == 500) log_write(LOG_LEVEL_ERROR, "request failed: %s", e->message);
    reply_set_problem(r, code, errors, "%s", e->message);
}

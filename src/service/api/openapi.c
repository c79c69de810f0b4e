// SPDX-License-Identifier: Apache-2.0
#include "service/api/openapi.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "config.h"

#include "service/api/job_commands.h"
#include "service/api/parameters.h"
#include "service/api/routes.h"
#include "base/core/memory.h"
#include "spec/json_schema.h"

#define STREAM_PROSE                                                                                          \
    "Server-Sent Events. `id` is the number of the event, `event` its type, `data` an Event. A stream of all" \
    " jobs begins with an event `position`: its `id` and `data.seq` are the number after which the stream"    \
    " continues. Further `position` events follow where a filter skipped many events, or where events are"    \
    " missing; `removed_up_to` and `reset` in their data mean the same as in an EventPage. The stream of one" \
    " job also has events `progress` and ends with the job. The `id` of progress is that of the last event,"  \
    " followed by a dot and a number; Last-Event-ID accepts both forms."

/* The bytes of two JSON files; the Makefile generates the included files. */
static const char answer_schemas[] = {
#include "service/api/openapi_schemas.inc"
};
static const char answer_examples[] = {
#include "service/api/openapi_examples.inc"
};

/* The groups of routes, in the order in which documents of the interface list them. */
static const struct {
    const char *name, *prose;
} tags[] = {
    {"jobs", "Submit, list, change and cancel jobs."},
    {"events", "Events of jobs, as pages or as a stream."},
    {"results", "The files of jobs that have succeeded, and their disk space."},
    {"inputs", "Files that jobs read: uploads, and files below the input roots."},
    {"service", "The state and the interface of the service."},
    {"administration", "For administrators: drain, hold, back up."},
    {"page", "The web page and the sessions of browsers."},
};

/* Parses JSON that is written with ' instead of ". */
static json *read_quoted(const char *text)
{
    char *copy = mem_strdup(text);
    for (char *c = copy; *c; c++)
        if (*c == '\'') *c = '"';
    error e = {0};
    json *document = json_parse(copy, strlen(copy), &e);
    free(copy);
    return document;
}

static void put_ref(json *object, const char *name)
{
    char *ref = mem_printf("#/components/schemas/%s", name);
    json_put_string(object, "$ref", ref);
    free(ref);
}

static json *put_type(json *content, const char *type, const char *schema)
{
    json *media = json_put_object(content, type);
    json *s = json_put_object(media, "schema");
    if (strcmp(schema, "file") == 0)
        json_put_string(s, "description", "The bytes of the file.");
    else if (strcmp(schema, "text") == 0)
        json_put_string(s, "type", "string");
    else
        put_ref(s, schema);
    return media;
}

/* Adds a reference to an example of openapi_examples.json, which has one for every schema of an answer and
 * for every operation whose answer is text. */
static void put_example(json *media, const char *name)
{
    char *ref = mem_printf("#/components/examples/%s", name);
    json_put_string(json_put_object(json_put_object(media, "examples"), name), "$ref", ref);
    free(ref);
}

static void put_content(json *object, const char *type, const char *schema)
{
    put_example(put_type(json_put_object(object, "content"), type, schema), schema);
}

/* Reads the next {name} of a pattern and advances it; false: there is none. */
static bool next_path_parameter(const char **pattern, char *name, size_t size)
{
    const char *start = strchr(*pattern, '{');
    if (!start) return false;
    size_t length = strcspn(++start, "}");
    snprintf(name, size, "%.*s", (int)length, start);
    *pattern = start + length;
    return true;
}

/* Reads the next word of a list separated by blanks and advances it; false: there is none. */
static bool next_word(const char **list, char *word, size_t size)
{
    if (!*list) return false;
    *list += strspn(*list, " ");
    size_t length = strcspn(*list, " ");
    if (length == 0) return false;
    snprintf(word, size, "%.*s", (int)length, *list);
    *list += length;
    return true;
}

static void put_parameters(json *operation, const route *r)
{
    char name[64];
    const char *pattern = r->pattern, *query = r->query, *headers = r->headers;
    json *list = json_new_array();
    while (next_path_parameter(&pattern, name, sizeof name))
        json_append(list, parameter_describe(&api_parameters, name, "path"));
    while (next_word(&query, name, sizeof name))
        json_append(list, parameter_describe(&api_parameters, name, "query"));
    while (next_word(&headers, name, sizeof name))
        json_append(list, parameter_describe(&api_parameters, name, "header"));
    if (json_size(json_root(list)) > 0)
        json_put(operation, "parameters", list);
    else
        json_free(list);
}

static void put_body(json *operation, const route *r)
{
    if (!r->body) return;
    json *body = json_put_object(operation, "requestBody");
    json_put_bool(body, "required", true);
    json *content = json_put_object(body, "content");
    bool patch = strcmp(r->method, "PATCH") == 0;
    const char *const types[] = {r->opener ? "application/octet-stream" : "application/json",
                                 patch ? ROUTE_MERGE_PATCH : NULL};
    for (size_t i = 0; i < 2 && types[i]; i++) {
        json *media = put_type(content, types[i], r->body);
        if (r->example)
            json_put(json_put_object(json_put_object(media, "examples"), "example"), "value",
                     read_quoted(r->example));
    }
}

/* Adds the response of an element of route.answers, "STATUS:SCHEMA". */
static void put_answer(json *responses, const route *r, const char *word)
{
    char status[4];
    snprintf(status, sizeof status, "%.3s", word);
    const char *schema = word + 4;
    json *answer = json_put_object(responses, status);
    json_put_string(answer, "description",
                    strcmp(status, "304") == 0   ? "The known version is still valid."
                    : strcmp(status, "204") == 0 ? "Done."
                    : strcmp(status, "206") == 0 ? "The requested part."
                                                 : "Success.");
    if (strcmp(schema, "file") == 0)
        put_type(json_put_object(answer, "content"), "*/*", schema);
    else if (strcmp(schema, "text") == 0)
        put_example(put_type(json_put_object(answer, "content"), "text/plain", schema), r->name);
    else if (*schema != '-')
        put_content(answer, "application/json", schema);
    if (strcmp(schema, "EventPage") != 0) return;
    json_at root = json_root(answer), content = json_member(&root, "content");
    json *media = json_put_object((json *)(uintptr_t)content.node, "text/event-stream");
    json *events = json_put_object(media, "schema");
    json_put_string(events, "type", "string");
    json_put_string(events, "description", STREAM_PROSE);
    put_example(media, "EventStream");
}

/* Adds the response of a problem, unless there is one for its status. */
static void put_problem(json *responses, const char *code)
{
    const reply_problem *p = reply_find_problem(code);
    char status[12];
    snprintf(status, sizeof status, "%d", p->status);
    json_at root = json_root(responses), there = json_member(&root, status);
    if (there.node) return;
    char *ref = mem_printf("#/components/responses/Problem%s", status);
    json_put_string(json_put_object(responses, status), "$ref", ref);
    free(ref);
}

static void put_responses(json *operation, const route *r)
{
    char word[64];
    const char *answers = r->answers, *problems = r->problems;
    json *responses = json_put_object(operation, "responses");
    while (next_word(&answers, word, sizeof word)) put_answer(responses, r, word);
    while (next_word(&problems, word, sizeof word)) put_problem(responses, word);
    static const char *const everywhere[] = {"request_invalid",   "origin_forbidden", "misdirected_request",
                                             "too_many_requests", "internal",         "unavailable"};
    for (size_t i = 0; i < sizeof everywhere / sizeof *everywhere; i++) put_problem(responses, everywhere[i]);
    if (strcmp(r->method, "GET") != 0) put_problem(responses, "storage_full");
    if (!r->scope) return;
    put_problem(responses, "unauthorized");
    put_problem(responses, "forbidden");
}

static void put_operation(json *paths, const route *r)
{
    json_at root = json_root(paths), there = json_member(&root, r->pattern);
    json *path = there.node ? (json *)(uintptr_t)there.node : json_put_object(paths, r->pattern);
    char method[8] = "";
    for (size_t i = 0; r->method[i] && i + 1 < sizeof method; i++) method[i] = (char)(r->method[i] | 0x20);
    json *operation = json_put_object(path, method);
    json_put_string(operation, "operationId", r->name);
    json_append_string(json_put_array(operation, "tags"), r->tag);
    json_put_string(operation, "summary", r->summary);
    json *security = json_put_array(operation, "security");
    if (r->scope) {
        char *prose = mem_printf("Needs the scope `%s`.", scope_name(r->scope));
        json_put_string(operation, "description", prose);
        free(prose);
        json_put_array(json_append_object(security), "bearer");
        json_append_object(security); /* a Unix socket needs no token */
    }
    put_parameters(operation, r);
    put_body(operation, r);
    put_responses(operation, r);
}

/* Adds the schemas of answers (openapi_schemas.json) and of specs to `schemas`, and the examples to
 * `components`. */
static void put_schemas(json *components, json *schemas)
{
    json *document = json_parse(answer_schemas, sizeof answer_schemas, NULL);
    json_at root = json_root(document);
    for (json_at schema = json_first(&root); schema.node; schema = json_next(&schema)) {
        json_put(schemas, schema.key, json_copy(schema.node));
    }
    json_free(document);
    json_put(schemas, "JobSpec", json_schema_new(JSON_SCHEMA_SENT));
    json_put(schemas, "Surface", json_schema_new_member("/surface", JSON_SCHEMA_SENT));
    json_put(schemas, "AnsweredSpec", json_schema_new(JSON_SCHEMA_ANSWERED));
    json_put(schemas, "AnsweredSurface", json_schema_new_member("/surface", JSON_SCHEMA_ANSWERED));
    json_put(components, "examples", json_parse(answer_examples, sizeof answer_examples, NULL));
}

static void put_tags(json *document)
{
    json *list = json_put_array(document, "tags");
    for (size_t i = 0; i < sizeof tags / sizeof *tags; i++) {
        json *tag = json_append_object(list);
        json_put_string(tag, "name", tags[i].name);
        json_put_string(tag, "description", tags[i].prose);
    }
}

static void put_states(json *schemas)
{
    json *state = json_put_object(schemas, "State");
    json_put_string(state, "type", "string");
    json *list = json_put_array(state, "enum");
    for (int s = 0; s < QUEUE_STATE_COUNT; s++) json_append_string(list, queue_state_name((queue_state)s));
}

static void put_patch(json *schemas)
{
    json *patch = json_put_object(schemas, "JobPatch");
    json_put_string(patch, "type", "object");
    json_put_bool(patch, "additionalProperties", false);
    json *properties = json_put_object(patch, "properties");
    for (size_t i = 0; job_commands_patch_members[i]; i++) {
        char *pointer = mem_printf("/queue/%s", job_commands_patch_members[i]);
        json_put(properties, job_commands_patch_members[i],
                 json_schema_new_member(pointer, JSON_SCHEMA_SENT));
        free(pointer);
    }
}

/* Adds the request that the service sends when a job has ended (src/service/webhook). */
static void put_webhook(json *document)
{
    json *ended = json_put_object(json_put_object(document, "webhooks"), "jobEnded");
    json *call = json_put_object(ended, "post");
    json_put_string(call, "operationId", "jobEnded");
    json_append_string(json_put_array(call, "tags"), "events");
    json_put_string(call, "summary", "A job whose queue.webhook is this address has ended");
    json_put_string(
        call, "description",
        "With the headers webhook-id, webhook-timestamp and webhook-signature of Standard Webhooks"
        " (standardwebhooks.com). It is repeated, with the same id, until the answer is 2xx or 410, and not"
        " before the time of Retry-After in a 429 or 503.");
    json_put_array(call, "security");
    json *body = json_put_object(call, "requestBody");
    json_put_bool(body, "required", true);
    put_content(body, "application/json", "JobEnded");
    json_put_string(json_put_object(json_put_object(call, "responses"), "2XX"), "description", "Received.");
}

/* Adds the schema of all codes, and a response for each status. */
static void put_problems(json *schemas, json *responses)
{
    json *code = json_put_object(schemas, "ProblemCode");
    json_put_string(code, "type", "string");
    json *codes = json_put_array(code, "enum");
    const reply_problem *p;
    for (size_t i = 0; (p = reply_problem_at(i)); i++) {
        char name[16];
        snprintf(name, sizeof name, "Problem%d", p->status);
        json_append_string(codes, p->code);
        json *answer = json_put_object(responses, name);
        char *prose = NULL, *longer = NULL;
        const reply_problem *same;
        for (size_t k = 0; (same = reply_problem_at(k)); k++) {
            if (same->status != p->status) continue;
            longer =
                mem_printf("%s%s`%s`: %s", prose ? prose : "", prose ? "; " : "", same->code, same->title);
            free(prose);
            prose = longer;
        }
        json_put_string(answer, "description", prose);
        free(prose);
        put_content(answer, "application/problem+json", "Problem");
    }
}

static json *describe(void)
{
    json *document = json_new_object();
    json_put_string(document, "openapi", "3.1.0");
    json *info = json_put_object(document, "info");
    json_put_string(info, "title", PACKAGE_NAME);
    json_put_string(info, "version", PACKAGE_VERSION);
    json_put_string(info, "summary", "Sampling of implicit surfaces as a batch service.");
    json_put_string(info, "description",
                    "Clients submit jobs, which wait in a durable queue until worker processes run them."
                    " Every error of the service is a problem document (RFC 9457) with a stable `code`.");
    json_put_string(json_append_object(json_put_array(document, "servers")), "url", "/");
    put_tags(document);
    json *paths = json_put_object(document, "paths");
    for (size_t i = 0; i < api_routes.count; i++) put_operation(paths, &api_routes.row[i]);
    put_webhook(document);
    json *components = json_put_object(document, "components"),
         *schemas = json_put_object(components, "schemas");
    put_schemas(components, schemas);
    put_patch(schemas);
    put_states(schemas);
    put_problems(schemas, json_put_object(components, "responses"));
    json *bearer = json_put_object(json_put_object(components, "securitySchemes"), "bearer");
    json_put_string(bearer, "type", "http");
    json_put_string(bearer, "scheme", "bearer");
    json_put_string(bearer, "description", "A token created by `hexadctl token add`.");
    return document;
}

/* Prints the document, and frees it. */
static constant_document print(json *document)
{
    char *text = json_print(document);
    json_free(document);
    return constant_document_make("application/json", text, strlen(text));
}

openapi *openapi_new(void)
{
    openapi *o = mem_alloc(sizeof *o);
    *o = (openapi){print(describe()), print(json_schema_new(JSON_SCHEMA_ALONE))};
    return o;
}

void openapi_free(openapi *o)
{
    if (!o) return;
    constant_document_clear(&o->document);
    constant_document_clear(&o->spec_schema);
    free(o);
}

void openapi_show(const http_context *c, const http_request *request, reply *r)
{
    constant_document_answer(&c->openapi->document, request, r);
}

void openapi_show_schema(const http_context *c, const http_request *request, reply *r)
{
    constant_document_answer(&c->openapi->spec_schema, request, r);
}

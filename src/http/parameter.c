#include "http/parameter.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef enum parameter_type { TEXT, INTEGER, STATE } parameter_type;

typedef struct parameter {
    const char *name;
    parameter_type type;
    int64_t low, high;     /* of a text: its length in bytes */
    const char *otherwise; /* NULL: none */
    const char *pattern;   /* of a text, for the document; NULL: none */
    const char *prose;
} parameter;

static const parameter parameters[] = {
    {"id", TEXT, 26, 26, NULL, "^[0-9a-z]{26}$", "The id of a job."},
    {"name", TEXT, 1, 255, NULL, NULL, "The name of a result, as the listing has it."},
    {"sha256", TEXT, 64, 64, NULL, "^[0-9a-f]{64}$",
     "The SHA-256 of the file's bytes, 64 digits, lower case."},
    {"state", STATE, 0, 0, NULL, NULL, "Only jobs in this state."},
    {"limit", INTEGER, 1, 500, "50", NULL, "The most to list at once."},
    {"owner", TEXT, 0, 64, NULL, NULL, "Only jobs, or events of jobs, of this user."},
    {"label", TEXT, 1, 400, NULL, NULL, "Only jobs that have this label, or events of such jobs."},
    {"job", TEXT, 26, 26, NULL, "^[0-9a-z]{26}$", "Only events of the job with this id."},
    {"after", INTEGER, 0, 999999999999999999, NULL, NULL,
     "`next`, or `position`, of the page before: only what comes after it. 0: from the first that is kept. Without it "
     "`/v1/events` begins now, other listings at their beginning."},
    {"frame", INTEGER, -2147483647, 2147483647, NULL, NULL, "The frame, of a job that is an array."},
    {"attempt", INTEGER, 1, 2147483647, NULL, NULL, "The number of the attempt; without it the last."},
    {"Idempotency-Key", TEXT, 1, 255, NULL, NULL,
     "A name for this request: sent again with the same body it makes no other job, with another it is "
     "refused."},
    {"traceparent", TEXT, 55, 55, NULL, NULL, "W3C Trace Context; kept on the job and in the logs."},
    {"If-Match", TEXT, 1, 1000, NULL, NULL,
     "The ETag of the job as it was seen: changed only when it is still that."},
    {"If-None-Match", TEXT, 1, 1000, NULL, NULL,
     "The ETag that is known: answered 304 when it is still that."},
    {"Prefer", TEXT, 1, 1000, NULL, NULL,
     "wait=SECONDS: to be answered when the job has ended or, with If-None-Match, has changed, or after that "
     "time."},
    {"Range", TEXT, 1, 1000, NULL, NULL, "bytes=FIRST-LAST: a part of the file."},
    {"If-Range", TEXT, 1, 1000, NULL, NULL,
     "The ETag of which Range is a part: the whole is sent when it is another."},
    {"Last-Event-ID", TEXT, 1, 18, NULL, NULL,
     "The id of the event that came last: only what comes after it. It goes before the query's `after`."},
    {"cursor", INTEGER, 1, 999999999999999999, NULL, NULL, "`next` of the page before."},
};

static const parameter *find(const char *name, size_t length)
{
    for (size_t i = 0; i < sizeof parameters / sizeof *parameters; i++)
        if (strlen(parameters[i].name) == length && strncmp(parameters[i].name, name, length) == 0)
            return &parameters[i];
    return NULL;
}

static bool is_listed(const char *names, const char *name)
{
    size_t length = strlen(name);
    for (; *names; names += strspn(names, " ")) {
        size_t n = strcspn(names, " ");
        if (n == length && memcmp(names, name, n) == 0) return true;
        names += n;
    }
    return false;
}

static bool is_good(const parameter *p, const char *value)
{
    queue_state state;
    bool negative = false;
    size_t length = value ? strlen(value) : 0;
    if (!value) return false;
    switch (p->type) {
    case TEXT:
        return (int64_t)length >= p->low && (int64_t)length <= p->high;
    case INTEGER:
        if (p->low < 0 && *value == '-') value++, length--, negative = true;
        if (length == 0 || length > 18 || strspn(value, "0123456789") != length) return false;
        if (negative) return -strtoll(value, NULL, 10) >= p->low;
        return strtoll(value, NULL, 10) >= p->low && strtoll(value, NULL, 10) <= p->high;
    case STATE:
        return queue_state_from_name(value, &state);
    }
    return false;
}

bool parameter_check_query(const char *names, const http_request *request, reply *r)
{
    for (size_t i = 0; i < request->query_count; i++) {
        const char *key = request->query[i].key, *value = request->query[i].value;
        const char *fault = NULL;
        for (size_t other = 0; other < i; other++)
            if (strcmp(key, request->query[other].key) == 0) fault = "stands twice";
        if (!is_listed(names, key))
            fault = "is not known here";
        else if (!is_good(find(key, strlen(key)), value))
            fault = "cannot be that";
        if (!fault) continue;
        reply_set_problem(r, "request_invalid", NULL, "query %.100s=%.100s: %.100s %s", key,
                          value ? value : "", key, fault);
        return false;
    }
    return true;
}

const char *parameter_text(const http_request *request, const char *name, const char *otherwise)
{
    for (size_t i = 0; i < request->query_count; i++)
        if (strcmp(request->query[i].key, name) == 0) return request->query[i].value;
    return otherwise;
}

int64_t parameter_integer(const http_request *request, const char *name, int64_t otherwise)
{
    const char *text = parameter_text(request, name, NULL);
    return text ? strtoll(text, NULL, 10) : otherwise;
}

json *parameter_describe(const char *name, const char *in)
{
    const parameter *p = find(name, strlen(name));
    assert(p);
    json *o = json_new_object();
    json_put_string(o, "name", name);
    json_put_string(o, "in", in);
    if (strcmp(in, "path") == 0) json_put_bool(o, "required", true);
    json_put_string(o, "description", p->prose);
    json *schema = json_put_object(o, "schema");
    if (p->type == INTEGER) {
        json_put_string(schema, "type", "integer");
        json_put_integer(schema, "minimum", p->low);
        json_put_integer(schema, "maximum", p->high);
        if (p->otherwise) json_put_integer(schema, "default", atoll(p->otherwise));
    } else if (p->type == STATE) {
        json_put_string(schema, "$ref", "#/components/schemas/State");
    } else {
        json_put_string(schema, "type", "string");
        if (p->pattern) json_put_string(schema, "pattern", p->pattern);
    }
    return o;
}

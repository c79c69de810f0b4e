// SPDX-License-Identifier: Apache-2.0
#include "service/http/parameter.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/memory.h"

static const parameter *find(const parameter_table *table, const char *name)
{
    for (size_t i = 0; i < table->count; i++)
        if (strcmp(table->row[i].name, name) == 0) return &table->row[i];
    return NULL;
}

static bool is_listed(const char *names, const char *name)
{
    size_t length = strlen(name);
    for (; names && *names; names += strspn(names, " ")) {
        size_t n = strcspn(names, " ");
        if (n == length && memcmp(names, name, n) == 0) return true;
        names += n;
    }
    return false;
}

/* Whether all words between the commas are words of the parameter. */
static bool are_words(const parameter *p, const char *text)
{
    for (const char *at = text;; at++) {
        size_t n = strcspn(at, ","), i = 0;
        const char *word;
        while ((word = p->word(i)) && (strncmp(word, at, n) != 0 || word[n])) i++;
        if (!word) return false;
        at += n;
        if (!*at) return true;
    }
}

static bool is_good(const parameter *p, const char *value)
{
    bool negative = false;
    size_t length = value ? strlen(value) : 0;
    int64_t wall_ms;
    if (!value) return false;
    switch (p->type) {
    case PARAMETER_TEXT:
        return (int64_t)length >= p->low && (int64_t)length <= p->high;
    case PARAMETER_INTEGER:
        if (p->low < 0 && *value == '-') value++, length--, negative = true;
        if (length == 0 || length > 18 || strspn(value, "0123456789") != length) return false;
        if (negative) return -strtoll(value, NULL, 10) >= p->low;
        return strtoll(value, NULL, 10) >= p->low && strtoll(value, NULL, 10) <= p->high;
    case PARAMETER_TIME:
        return clock_parse_utc(value, &wall_ms) && wall_ms > 0;
    case PARAMETER_WORD:
        return !strchr(value, ',') && are_words(p, value);
    case PARAMETER_WORDS:
        return are_words(p, value);
    }
    return false;
}

/* Describes the permitted values, for a message. */
static void describe_values(const parameter *p, char *text, size_t size)
{
    const char *word;
    if (p->type == PARAMETER_TEXT) {
        snprintf(text, size, "must have %lld to %lld bytes", (long long)p->low, (long long)p->high);
    } else if (p->type == PARAMETER_INTEGER) {
        snprintf(text, size, "must be an integer from %lld to %lld", (long long)p->low, (long long)p->high);
    } else if (p->type == PARAMETER_TIME) {
        snprintf(text, size, "must be a time after 1970, such as 2026-01-31T18:00:00Z or 2026-01-31");
    } else {
        size_t used = (size_t)snprintf(text, size, "must be one of ");
        for (size_t i = 0; used < size && (word = p->word(i)); i++)
            used += (size_t)snprintf(text + used, size - used, "%s, ", word);
        if (used < size)
            snprintf(text + used - 2, size - used + 2, "%s%s",
                     p->type == PARAMETER_WORDS ? ", or several of these, separated by commas" : "",
                     p->remark ? p->remark : "");
    }
}

/* Describes the names "a b c" as "a, b and c", for a message. */
static void describe_names(const char *names, char *text, size_t size)
{
    size_t used = (size_t)snprintf(text, size, "is not a parameter of this path: %s",
                                   names ? "use " : "it has none; remove it");
    for (const char *at = names; at && *at && used + 3 < size; at++) {
        if (*at == ' ') text[used++] = ',';
        text[used++] = *at;
        text[used] = '\0';
    }
}

bool parameter_check_query(const parameter_table *table, const char *names, const http_request *request,
                           reply *r)
{
    for (size_t i = 0; i < request->query_count; i++) {
        const char *key = request->query[i].key, *value = request->query[i].value;
        const char *fault = NULL;
        char values[512];
        for (size_t other = 0; other < i; other++)
            if (strcmp(key, request->query[other].key) == 0) fault = "is given twice: remove one";
        if (!is_listed(names, key)) {
            describe_names(names, values, sizeof values);
            fault = values;
        } else if (!is_good(find(table, key), value)) {
            describe_values(find(table, key), values, sizeof values);
            fault = values;
        }
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

int64_t parameter_time(const http_request *request, const char *name)
{
    int64_t wall_ms = 0;
    const char *text = parameter_text(request, name, NULL);
    return text && clock_parse_utc(text, &wall_ms) ? wall_ms : 0;
}

json *parameter_describe(const parameter_table *table, const char *name, const char *in)
{
    const parameter *p = find(table, name);
    assert(p);
    json *o = json_new_object();
    json_put_string(o, "name", name);
    json_put_string(o, "in", in);
    if (strcmp(in, "path") == 0) json_put_bool(o, "required", true);
    json_put_string(o, "description", p->prose);
    if (p->example) json_put_string(o, "example", p->example);
    json *schema = json_put_object(o, "schema");
    if (p->type == PARAMETER_INTEGER) {
        json_put_string(schema, "type", "integer");
        json_put_integer(schema, "minimum", p->low);
        json_put_integer(schema, "maximum", p->high);
        if (p->otherwise) json_put_integer(schema, "default", atoll(p->otherwise));
    } else if (p->type == PARAMETER_WORD) {
        json_put_string(schema, "type", "string");
        json *words = json_put_array(schema, "enum");
        for (size_t i = 0; p->word(i); i++) json_append_string(words, p->word(i));
        if (p->otherwise) json_put_string(schema, "default", p->otherwise);
    } else if (p->type == PARAMETER_WORDS) {
        char *ref = mem_printf("#/components/schemas/%s", p->schema);
        json_put_string(o, "style", "form");
        json_put_bool(o, "explode", false);
        json_put_string(schema, "type", "array");
        json_put_string(json_put_object(schema, "items"), "$ref", ref);
        free(ref);
    } else {
        json_put_string(schema, "type", "string");
        if (p->pattern) json_put_string(schema, "pattern", p->pattern);
        if (p->type == PARAMETER_TIME) json_put_string(schema, "format", "date-time");
    }
    return o;
}

// SPDX-License-Identifier: Apache-2.0
/* Prints a tree as text. cJSON's own printer compares doubles with a tolerance. snprintf and strtod convert
 * numbers, so the programs keep the C locale for LC_NUMERIC.
 */
#include "base/json/json.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cjson/cJSON.h>

#include "base/core/memory.h"
#include "base/json/json_internal.h"

static const double exact_integer_limit = 9007199254740992.0; /* 2^53: every integer up to this is a double */

typedef struct text {
    char *data;
    size_t length, capacity;
    bool pretty;
} text;

static void add(text *t, const char *bytes, size_t n)
{
    if (t->length + n + 1 > t->capacity) {
        t->capacity = 2 * (t->length + n + 1) + 256;
        t->data = mem_resize(t->data, t->capacity);
    }
    memcpy(t->data + t->length, bytes, n);
    t->length += n;
    t->data[t->length] = '\0';
}

static void add_text(text *t, const char *s)
{
    add(t, s, strlen(s));
}

static void add_break(text *t, int level)
{
    if (!t->pretty) return;
    add(t, "\n", 1);
    for (int i = 0; i < level; i++) add(t, "  ", 2);
}

/* Prints a whole number, the most frequent case, without the slower snprintf. */
static void add_integer(text *t, int64_t value)
{
    char digits[24], *end = digits + sizeof digits, *at = end;
    uint64_t left = value < 0 ? -(uint64_t)value : (uint64_t)value;
    do *--at = (char)('0' + left % 10);
    while (left /= 10);
    if (value < 0) *--at = '-';
    add(t, at, (size_t)(end - at));
}

static void add_number(text *t, double value)
{
    char digits[40];
    if (!isfinite(value)) {
        add_text(t, "null");
        return;
    }
    if (value == floor(value) && fabs(value) <= exact_integer_limit && !(value == 0 && signbit(value))) {
        add_integer(t, (int64_t)value);
        return;
    }
    for (int precision = 15; precision <= 17; precision++) {
        snprintf(digits, sizeof digits, "%.*g", precision, value);
        if (strtod(digits, NULL) == value) break;
    }
    add_text(t, digits);
}

/* The number of bytes that need no escape. */
static size_t plain_length(const char *s)
{
    size_t n = 0;
    while ((unsigned char)s[n] >= 0x20 && (unsigned char)s[n] < 0x80 && s[n] != '"' && s[n] != '\\') n++;
    return n;
}

/* Prints a string. Bytes that are not UTF-8, as in the last output of a worker, become U+FFFD, so the output
 * is always valid JSON. */
static void add_string(text *t, const char *s)
{
    add(t, "\"", 1);
    for (size_t left = strlen(s), n; left > 0; s += n, left -= n) {
        unsigned char c = (unsigned char)*s;
        char escape[8];
        n = plain_length(s);
        if (n == 0) n = json_utf8_length((const unsigned char *)s, left);
        if (c == '"' || c == '\\') {
            escape[0] = '\\';
            escape[1] = (char)c;
            add(t, escape, 2);
        } else if (c == '\n' || c == '\r' || c == '\t') {
            add_text(t, c == '\n' ? "\\n" : c == '\r' ? "\\r" : "\\t");
        } else if (c < 0x20) {
            snprintf(escape, sizeof escape, "\\u%04x", c);
            add_text(t, escape);
        } else if (n > 0) {
            add(t, s, n);
        } else {
            add_text(t, "\xEF\xBF\xBD");
            n = 1;
        }
    }
    add(t, "\"", 1);
}

static void add_node(text *t, const cJSON *node, int level);

/* Whether an array has numbers and words only. It is then printed on one line, which is more readable for
 * vectors. */
static bool is_flat(const cJSON *node)
{
    if (!cJSON_IsArray(node)) return false;
    for (const cJSON *c = node->child; c; c = c->next)
        if (cJSON_IsObject(c) || cJSON_IsArray(c)) return false;
    return true;
}

static void add_children(text *t, const cJSON *node, int level)
{
    bool object = cJSON_IsObject(node), flat = is_flat(node);
    add(t, object ? "{" : "[", 1);
    for (const cJSON *c = node->child; c; c = c->next) {
        if (!flat) add_break(t, level + 1);
        if (object) {
            add_string(t, c->string);
            add_text(t, t->pretty ? ": " : ":");
        }
        add_node(t, c, level + 1);
        if (c->next) add_text(t, flat && t->pretty ? ", " : ",");
    }
    if (node->child && !flat) add_break(t, level);
    add(t, object ? "}" : "]", 1);
}

static void add_node(text *t, const cJSON *node, int level)
{
    if (cJSON_IsRaw(node)) {
        add_text(t, node->valuestring);
        return;
    }
    switch (json_type_of(json_root(node))) {
    case JSON_BOOL:
        add_text(t, cJSON_IsTrue(node) ? "true" : "false");
        break;
    case JSON_NUMBER:
        add_number(t, node->valuedouble);
        break;
    case JSON_STRING:
        add_string(t, node->valuestring);
        break;
    case JSON_ARRAY:
    case JSON_OBJECT:
        add_children(t, node, level);
        break;
    default:
        add_text(t, "null");
    }
}

bool json_is_text(const char *value)
{
    for (size_t left = strlen(value), n; left; value += n, left -= n)
        if ((n = json_utf8_length((const unsigned char *)value, left)) == 0) return false;
    return true;
}

char *json_print(const json *node)
{
    text t = {0};
    add_node(&t, node, 0);
    return t.data;
}

char *json_print_pretty(const json *node)
{
    text t = {.pretty = true};
    add_node(&t, node, 0);
    add(&t, "\n", 1);
    return t.data;
}

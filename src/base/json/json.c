// SPDX-License-Identifier: Apache-2.0
/* Positions in a tree of cJSON, and building of trees. json_parse.c parses text and json_print.c prints
 * it. */
#include "base/json/json.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cjson/cJSON.h>

#include "base/core/memory.h"
#include "base/core/utf8.h"
#include "base/json/json_internal.h"

cJSON *json_must(cJSON *node)
{
    if (!node) {
        fputs("hexad: out of memory\n", stderr);
        abort();
    }
    return node;
}

size_t json_utf8_length(const unsigned char *s, size_t left)
{
    uint32_t code;
    if (left > 0 && s[0] < 0x80) return 1; /* the most frequent case */
    const size_t length = utf8_decode(s, left, &code);
    return length > 0 && (code < 0xD800 || code > 0xDFFF) ? length : 0;
}

void json_free(json *root)
{
    cJSON_Delete(root);
}

/* ---- positions */

json_at json_root(const json *root)
{
    return (json_at){root, NULL, NULL, 0};
}

json_at json_member(const json_at *object, const char *key)
{
    const cJSON *node =
        cJSON_IsObject(object->node) ? cJSON_GetObjectItemCaseSensitive(object->node, key) : NULL;
    return (json_at){node, object, key, 0};
}

json_at json_first(const json_at *list)
{
    const bool has_children = cJSON_IsArray(list->node) || cJSON_IsObject(list->node);
    const cJSON *node = has_children ? list->node->child : NULL;
    return (json_at){node, list, node ? node->string : NULL, 0};
}

json_at json_next(const json_at *at)
{
    const cJSON *node = at->node->next;
    return (json_at){node, at->parent, node ? node->string : NULL, at->index + 1};
}

json_type json_type_of(json_at at)
{
    if (!at.node) return JSON_NONE;
    switch (at.node->type & 0xFF) {
    case cJSON_NULL:
        return JSON_NULL;
    case cJSON_True:
    case cJSON_False:
        return JSON_BOOL;
    case cJSON_Number:
        return JSON_NUMBER;
    case cJSON_String:
        return JSON_STRING;
    case cJSON_Array:
        return JSON_ARRAY;
    case cJSON_Object:
        return JSON_OBJECT;
    default:
        return JSON_NONE;
    }
}

size_t json_size(json_at at)
{
    return cJSON_IsArray(at.node) || cJSON_IsObject(at.node) ? (size_t)cJSON_GetArraySize(at.node) : 0;
}

double json_number(json_at at, double otherwise)
{
    return cJSON_IsNumber(at.node) ? at.node->valuedouble : otherwise;
}

size_t json_numbers(json_at array, double *out, size_t count)
{
    size_t n = 0;
    if (!cJSON_IsArray(array.node)) return 0;
    for (const cJSON *c = array.node->child; c && n < count && cJSON_IsNumber(c); c = c->next)
        out[n++] = c->valuedouble;
    return n;
}

size_t json_elements(json_at array, const json **out, size_t count)
{
    size_t n = 0;
    if (!cJSON_IsArray(array.node)) return 0;
    for (const cJSON *c = array.node->child; c && n < count; c = c->next) out[n++] = c;
    return n;
}

bool json_bool(json_at at, bool otherwise)
{
    return cJSON_IsBool(at.node) ? cJSON_IsTrue(at.node) : otherwise;
}

const char *json_string(json_at at, const char *otherwise)
{
    return cJSON_IsString(at.node) ? at.node->valuestring : otherwise;
}

typedef struct cursor {
    char *buffer;
    size_t size, length;
    bool full; /* the text was truncated: nothing is appended any more */
} cursor;

/* Appends one character (a whole UTF-8 sequence), or nothing if it does not fit. */
static void cursor_put(cursor *c, const char *sequence, size_t n)
{
    if (c->full || c->length + n + 1 > c->size) {
        c->full = true;
        return;
    }
    memcpy(c->buffer + c->length, sequence, n);
    c->length += n;
    c->buffer[c->length] = '\0';
}

static void write_pointer(const json_at *at, cursor *c)
{
    if (!at->parent) return;
    write_pointer(at->parent, c);
    cursor_put(c, "/", 1);
    if (!at->key) {
        char digits[24];
        int n = snprintf(digits, sizeof digits, "%zu", at->index);
        for (int i = 0; i < n; i++) cursor_put(c, digits + i, 1);
        return;
    }
    size_t left = strlen(at->key);
    for (const char *k = at->key; left > 0;) {
        size_t n = json_utf8_length((const unsigned char *)k, left);
        if (n == 0) n = 1;
        if (*k == '~')
            cursor_put(c, "~0", 2);
        else if (*k == '/')
            cursor_put(c, "~1", 2);
        else
            cursor_put(c, k, n);
        k += n;
        left -= n;
    }
}

char *json_pointer(const json_at *at, char *buffer, size_t size)
{
    if (size == 0) return buffer;
    cursor c = {buffer, size, 0, false};
    buffer[0] = '\0';
    write_pointer(at, &c);
    return buffer;
}

/* The next part of a pointer, which the caller frees. *pointer is advanced past it. */
static char *next_part(const char **pointer)
{
    size_t length = strcspn(*pointer, "/"), n = 0;
    char *part = mem_strndup(*pointer, length);
    *pointer += length;
    for (const char *t = part; *t; t++) {
        bool escaped = *t == '~' && (t[1] == '0' || t[1] == '1');
        part[n++] = !escaped ? *t : *++t == '0' ? '~' : '/';
    }
    part[n] = '\0';
    return part;
}

/* The member or element with this name or index; NULL: there is none. */
static cJSON *find_part(cJSON *node, const char *part)
{
    char *end = NULL;
    unsigned long index = strtoul(part, &end, 10);
    if (!cJSON_IsArray(node)) return cJSON_GetObjectItemCaseSensitive(node, part);
    return *part && !*end && index <= INT32_MAX ? cJSON_GetArrayItem(node, (int)index) : NULL;
}

json *json_find(json *node, const char *pointer)
{
    while (node && *pointer == '/') {
        pointer++;
        char *part = next_part(&pointer);
        node = find_part(node, part);
        free(part);
    }
    return *pointer ? NULL : node;
}

bool json_set(json *root, const char *pointer, json *value)
{
    while (*pointer == '/') {
        pointer++;
        char *part = next_part(&pointer);
        cJSON *next = find_part(root, part);
        bool last = !*pointer, object = cJSON_IsObject(root), put = last && (object || next);
        if (put && object)
            json_put(root, part, value);
        else if (put)
            cJSON_ReplaceItemViaPointer(root, next, value);
        else if (!last && object && !next)
            next = json_put_object(root, part);
        free(part);
        if (last) return put;
        root = next;
    }
    return false;
}

/* ---- building */

json *json_new_object(void)
{
    return json_must(cJSON_CreateObject());
}

json *json_new_array(void)
{
    return json_must(cJSON_CreateArray());
}

json *json_new_number(double value)
{
    return json_must(isfinite(value) ? cJSON_CreateNumber(value) : cJSON_CreateNull());
}

json *json_new_string(const char *value)
{
    return json_must(value ? cJSON_CreateString(value) : cJSON_CreateNull());
}

void json_put(json *object, const char *key, json *child)
{
    bool put = cJSON_GetObjectItemCaseSensitive(object, key)
                   ? cJSON_ReplaceItemInObjectCaseSensitive(object, key, child)
                   : cJSON_AddItemToObject(object, key, child);
    if (!put) json_must(NULL);
}

void json_remove(json *object, const char *key)
{
    cJSON_DeleteItemFromObjectCaseSensitive(object, key);
}

void json_put_null(json *object, const char *key)
{
    json_put(object, key, json_must(cJSON_CreateNull()));
}

void json_put_bool(json *object, const char *key, bool value)
{
    json_put(object, key, json_must(cJSON_CreateBool(value)));
}

void json_put_number(json *object, const char *key, double value)
{
    json_put(object, key, json_new_number(value));
}

void json_put_integer(json *object, const char *key, int64_t value)
{
    json_put(object, key, json_new_number((double)value));
}

void json_put_string(json *object, const char *key, const char *value)
{
    json_put(object, key, json_new_string(value));
}

void json_put_text(json *object, const char *key, const char *text)
{
    json_put(object, key, json_must(cJSON_CreateRaw(text)));
}

json *json_put_object(json *object, const char *key)
{
    json *child = json_new_object();
    json_put(object, key, child);
    return child;
}

json *json_put_array(json *object, const char *key)
{
    json *child = json_new_array();
    json_put(object, key, child);
    return child;
}

void json_set_string(json *string, const char *value)
{
    if (!cJSON_SetValuestring(string, value)) json_must(NULL);
}

void json_append(json *array, json *child)
{
    cJSON_AddItemToArray(array, child);
}

void json_append_number(json *array, double value)
{
    json_append(array, json_new_number(value));
}

void json_append_string(json *array, const char *value)
{
    json_append(array, json_new_string(value));
}

json *json_append_object(json *array)
{
    json *child = json_new_object();
    json_append(array, child);
    return child;
}

json *json_copy(const json *node)
{
    return json_must(cJSON_Duplicate(node, true));
}

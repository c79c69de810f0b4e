/* The tree is cJSON's; reading and writing text is done here, since cJSON's own parser accepts more
 * than RFC 8259, cuts numbers of more than 63 characters, and its printer compares doubles with a
 * tolerance. Numbers go through strtod and snprintf: the programs stay in the C locale for
 * LC_NUMERIC. */
#include "json/json.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cjson/cJSON.h>

#include "base/memory.h"

static const double exact_integer_limit = 9007199254740992.0; /* 2^53: every integer up to here is a double */

/* ---- reading ---- */

typedef struct parser {
    const unsigned char *text;
    size_t length;
    size_t at;
    char *scratch; /* length + 1 bytes: a decoded string or a number's text is never longer */
    error *e;
} parser;

typedef struct member_name {
    const char *text;
    size_t at; /* where it stands, for the message */
} member_name;

static cJSON *must(cJSON *node)
{
    if (!node) {
        fputs("hexad: out of memory\n", stderr);
        abort();
    }
    return node;
}

/* The fault is at byte `at`; lines and columns (in characters) are counted from 1. */
static bool fault_at(const parser *p, size_t at, const char *words)
{
    size_t line = 1, column = 1;
    for (size_t i = 0; i < at && i < p->length; i++) {
        if (p->text[i] == '\n') {
            line++;
            column = 1;
        } else if ((p->text[i] & 0xC0) != 0x80) {
            column++;
        }
    }
    return error_set(p->e, ERROR_SPEC_INVALID, "line %zu column %zu: %s", line, column, words);
}

static bool fault(const parser *p, const char *words)
{
    return fault_at(p, p->at, p->at < p->length ? words : "the text ends too early");
}

static int peek(const parser *p)
{
    return p->at < p->length ? p->text[p->at] : -1;
}

static void skip_space(parser *p)
{
    while (p->at < p->length && (p->text[p->at] == ' ' || p->text[p->at] == '\t' || p->text[p->at] == '\n' ||
                                 p->text[p->at] == '\r'))
        p->at++;
}

static bool is_digit(int c)
{
    return c >= '0' && c <= '9';
}

/* Length of the well-formed UTF-8 sequence at s (Unicode 15, table 3-7), 0 if there is none. */
static size_t utf8_sequence(const unsigned char *s, size_t left)
{
    if (left == 0) return 0;
    if (s[0] < 0x80) return 1;
    size_t want = s[0] >= 0xC2 && s[0] <= 0xDF   ? 2
                  : (s[0] & 0xF0) == 0xE0        ? 3
                  : s[0] >= 0xF0 && s[0] <= 0xF4 ? 4
                                                 : 0;
    if (want == 0 || left < want) return 0;
    unsigned low = s[0] == 0xE0 ? 0xA0 : s[0] == 0xF0 ? 0x90 : 0x80;
    unsigned high = s[0] == 0xED ? 0x9F : s[0] == 0xF4 ? 0x8F : 0xBF;
    if (s[1] < low || s[1] > high) return 0;
    for (size_t i = 2; i < want; i++)
        if ((s[i] & 0xC0) != 0x80) return 0;
    return want;
}

static bool read_hex4(parser *p, unsigned *out)
{
    unsigned value = 0;
    for (int i = 0; i < 4; i++, p->at++) {
        int c = peek(p);
        unsigned digit;
        if (is_digit(c))
            digit = (unsigned)(c - '0');
        else if (c >= 'a' && c <= 'f')
            digit = (unsigned)(c - 'a') + 10;
        else if (c >= 'A' && c <= 'F')
            digit = (unsigned)(c - 'A') + 10;
        else
            return fault(p, "\\u needs four hexadecimal digits");
        value = value * 16 + digit;
    }
    *out = value;
    return true;
}

static size_t put_utf8(char *out, unsigned c)
{
    if (c < 0x80) {
        out[0] = (char)c;
        return 1;
    }
    size_t n = c < 0x800 ? 2 : c < 0x10000 ? 3 : 4;
    for (size_t i = n - 1; i > 0; i--, c >>= 6) out[i] = (char)(0x80 | (c & 0x3F));
    out[0] = (char)((n == 2 ? 0xC0 : n == 3 ? 0xE0 : 0xF0) | c);
    return n;
}

/* After "\u": one code unit, or two that make a surrogate pair. */
static bool read_unicode_escape(parser *p, size_t start, size_t *length)
{
    unsigned unit = 0, low = 0;
    if (!read_hex4(p, &unit)) return false;
    if (unit == 0) return fault_at(p, start, "\\u0000 is not accepted in a string");
    if (unit >= 0xDC00 && unit <= 0xDFFF)
        return fault_at(p, start, "a low surrogate without a high one before it");
    if (unit >= 0xD800 && unit <= 0xDBFF) {
        if (p->length - p->at < 2 || p->text[p->at] != '\\' || p->text[p->at + 1] != 'u')
            return fault_at(p, start, "a high surrogate without a low one after it");
        p->at += 2;
        if (!read_hex4(p, &low)) return false;
        if (low < 0xDC00 || low > 0xDFFF)
            return fault_at(p, start, "a high surrogate without a low one after it");
        unit = 0x10000 + ((unit - 0xD800) << 10) + (low - 0xDC00);
    }
    *length += put_utf8(p->scratch + *length, unit);
    return true;
}

static bool read_escape(parser *p, size_t *length)
{
    static const char letters[] = "\"\\/bfnrt", meanings[] = "\"\\/\b\f\n\r\t";
    size_t start = p->at++;
    int c = peek(p);
    if (c == 'u') {
        p->at++;
        return read_unicode_escape(p, start, length);
    }
    const char *which = c > 0 ? strchr(letters, c) : NULL;
    if (!which) return fault(p, "an unknown escape in a string");
    p->scratch[(*length)++] = meanings[which - letters];
    p->at++;
    return true;
}

/* At the opening quote; leaves the decoded text in p->scratch. */
static bool read_string(parser *p)
{
    size_t length = 0;
    p->at++;
    for (;;) {
        int c = peek(p);
        if (c < 0) return fault(p, "");
        if (c == '"') break;
        if (c < 0x20) return fault(p, "a control character in a string: write it as an escape");
        if (c == '\\') {
            if (!read_escape(p, &length)) return false;
            continue;
        }
        size_t n = utf8_sequence(p->text + p->at, p->length - p->at);
        if (n == 0) return fault_at(p, p->at, "a string is not well-formed UTF-8");
        memcpy(p->scratch + length, p->text + p->at, n);
        length += n;
        p->at += n;
    }
    p->at++;
    p->scratch[length] = '\0';
    return true;
}

static bool skip_digits(parser *p, const char *words)
{
    if (!is_digit(peek(p))) return fault(p, words);
    while (is_digit(peek(p))) p->at++;
    return true;
}

static cJSON *read_number(parser *p)
{
    size_t start = p->at;
    if (peek(p) == '-') p->at++;
    if (peek(p) == '0') {
        p->at++;
        if (is_digit(peek(p))) {
            fault(p, "a number must not begin with 0");
            return NULL;
        }
    } else if (!skip_digits(p, "a number needs a digit here")) {
        return NULL;
    }
    if (peek(p) == '.') {
        p->at++;
        if (!skip_digits(p, "a number needs a digit after its point")) return NULL;
    }
    if (peek(p) == 'e' || peek(p) == 'E') {
        p->at++;
        if (peek(p) == '+' || peek(p) == '-') p->at++;
        if (!skip_digits(p, "a number needs a digit in its exponent")) return NULL;
    }
    memcpy(p->scratch, p->text + start, p->at - start);
    p->scratch[p->at - start] = '\0';
    double value = strtod(p->scratch, NULL);
    if (!isfinite(value)) {
        fault_at(p, start, "a number is too large: its magnitude must stay below 1.8e308");
        return NULL;
    }
    return must(cJSON_CreateNumber(value));
}

static cJSON *read_value(parser *p, int depth);

static cJSON *read_array(parser *p, int depth)
{
    cJSON *array = must(cJSON_CreateArray());
    p->at++;
    skip_space(p);
    if (peek(p) == ']') {
        p->at++;
        return array;
    }
    for (;;) {
        cJSON *element = read_value(p, depth);
        if (!element) goto failed;
        cJSON_AddItemToArray(array, element);
        int c = peek(p);
        if (c != ',' && c != ']') {
            fault(p, "expected ',' or ']' in an array");
            goto failed;
        }
        p->at++;
        if (c == ']') return array;
    }
failed:
    cJSON_Delete(array);
    return NULL;
}

static int compare_names(const void *a, const void *b)
{
    const member_name *x = a, *y = b;
    int order = strcmp(x->text, y->text);
    return order ? order : (x->at > y->at) - (x->at < y->at);
}

/* Sorting keeps this from being quadratic in what a hostile client sends. */
static bool check_names(const parser *p, member_name *names, size_t count)
{
    const member_name *twice = NULL;
    if (count > 1) qsort(names, count, sizeof *names, compare_names);
    for (size_t i = 1; i < count; i++)
        if (strcmp(names[i - 1].text, names[i].text) == 0 && (!twice || names[i].at < twice->at))
            twice = &names[i];
    if (!twice) return true;
    char words[256];
    snprintf(words, sizeof words, "the member '%.180s' stands twice in one object", twice->text);
    return fault_at(p, twice->at, words);
}

/* One `"name": value`, added to the object; its name is noted for check_names. */
static bool read_member(parser *p, int depth, cJSON *object, member_name *name)
{
    skip_space(p);
    if (peek(p) != '"') return fault(p, "expected a member name in double quotes");
    name->at = p->at;
    if (!read_string(p)) return false;
    char *key = mem_strdup(p->scratch);
    bool done = false;
    skip_space(p);
    if (peek(p) != ':') {
        fault(p, "expected ':' after a member name");
        goto end;
    }
    p->at++;
    cJSON *value = read_value(p, depth);
    if (!value) goto end;
    cJSON_AddItemToObject(object, key, value);
    if (!value->string) must(NULL);
    name->text = value->string;
    done = true;
end:
    free(key);
    return done;
}

static cJSON *read_object(parser *p, int depth)
{
    cJSON *object = must(cJSON_CreateObject());
    member_name *names = NULL;
    size_t count = 0, capacity = 0;
    bool done = false;
    p->at++;
    skip_space(p);
    if (peek(p) == '}') {
        p->at++;
        return object;
    }
    for (;;) {
        if (count == capacity) {
            capacity = capacity ? 2 * capacity : 8;
            names = mem_resize(names, capacity * sizeof *names);
        }
        if (!read_member(p, depth, object, &names[count])) goto end;
        count++;
        int c = peek(p);
        if (c != ',' && c != '}') {
            fault(p, "expected ',' or '}' in an object");
            goto end;
        }
        p->at++;
        if (c == '}') break;
    }
    done = check_names(p, names, count);
end:
    free(names);
    if (done) return object;
    cJSON_Delete(object);
    return NULL;
}

static cJSON *read_word(parser *p)
{
    static const char *const words[] = {"true", "false", "null"};
    for (int i = 0; i < 3; i++) {
        size_t n = strlen(words[i]);
        if (p->length - p->at < n || memcmp(p->text + p->at, words[i], n) != 0) continue;
        p->at += n;
        return must(i == 2 ? cJSON_CreateNull() : cJSON_CreateBool(i == 0));
    }
    fault(p, "expected a value (an object, an array, a string in double quotes, a number, true, "
             "false or null)");
    return NULL;
}

/* Space around the value is taken with it. Depth counts open objects and arrays, so the recursion
 * is bounded by JSON_MAX_DEPTH. */
static cJSON *read_value(parser *p, int depth)
{
    cJSON *value;
    skip_space(p);
    int c = peek(p);
    if ((c == '{' || c == '[') && depth == JSON_MAX_DEPTH) {
        fault(p, "objects and arrays are nested too deep");
        return NULL;
    }
    if (c == '{')
        value = read_object(p, depth + 1);
    else if (c == '[')
        value = read_array(p, depth + 1);
    else if (c == '"')
        value = read_string(p) ? must(cJSON_CreateString(p->scratch)) : NULL;
    else if (c == '-' || is_digit(c))
        value = read_number(p);
    else
        value = read_word(p);
    skip_space(p);
    return value;
}

json *json_parse(const char *text, size_t length, error *e)
{
    parser p = {(const unsigned char *)text, length, 0, NULL, e};
    cJSON *root = NULL;
    if (length >= 3 && memcmp(text, "\xEF\xBB\xBF", 3) == 0) {
        fault_at(&p, 0, "the text begins with a byte order mark: save it without");
        return NULL;
    }
    p.scratch = mem_alloc(length + 1);
    root = read_value(&p, 0);
    if (root && p.at < length) {
        fault(&p, "there is more text after the value");
        cJSON_Delete(root);
        root = NULL;
    }
    free(p.scratch);
    return root;
}

void json_free(json *root)
{
    cJSON_Delete(root);
}

/* ---- places ---- */

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

json_at json_element(const json_at *array, size_t index)
{
    const cJSON *node =
        array->node && index < json_size(*array) ? cJSON_GetArrayItem(array->node, (int)index) : NULL;
    return (json_at){node, array, node ? node->string : NULL, index};
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
    bool full; /* something was cut: nothing may follow it */
} cursor;

/* Appends one character (a whole UTF-8 sequence) or nothing. */
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
        size_t n = utf8_sequence((const unsigned char *)k, left);
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

/* The next part of a pointer, which `*pointer` is moved behind; released with free(). */
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

json *json_find(json *node, const char *pointer)
{
    while (node && *pointer == '/') {
        pointer++;
        char *part = next_part(&pointer), *end = part;
        unsigned long index = strtoul(part, &end, 10);
        if (!cJSON_IsArray(node))
            node = cJSON_GetObjectItemCaseSensitive(node, part);
        else
            node = *part && !*end && index <= INT32_MAX ? cJSON_GetArrayItem(node, (int)index) : NULL;
        free(part);
    }
    return *pointer ? NULL : node;
}

/* ---- building ---- */

json *json_new_object(void)
{
    return must(cJSON_CreateObject());
}

json *json_new_array(void)
{
    return must(cJSON_CreateArray());
}

static cJSON *new_number(double value)
{
    return must(isfinite(value) ? cJSON_CreateNumber(value) : cJSON_CreateNull());
}

static cJSON *new_string(const char *value)
{
    return must(value ? cJSON_CreateString(value) : cJSON_CreateNull());
}

void json_put(json *object, const char *key, json *child)
{
    bool put = cJSON_GetObjectItemCaseSensitive(object, key)
                   ? cJSON_ReplaceItemInObjectCaseSensitive(object, key, child)
                   : cJSON_AddItemToObject(object, key, child);
    if (!put) must(NULL);
}

void json_put_null(json *object, const char *key)
{
    json_put(object, key, must(cJSON_CreateNull()));
}

void json_put_bool(json *object, const char *key, bool value)
{
    json_put(object, key, must(cJSON_CreateBool(value)));
}

void json_put_number(json *object, const char *key, double value)
{
    json_put(object, key, new_number(value));
}

void json_put_integer(json *object, const char *key, int64_t value)
{
    json_put(object, key, new_number((double)value));
}

void json_put_string(json *object, const char *key, const char *value)
{
    json_put(object, key, new_string(value));
}

void json_put_text(json *object, const char *key, const char *text)
{
    json_put(object, key, must(cJSON_CreateRaw(text)));
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
    if (!cJSON_SetValuestring(string, value)) must(NULL);
}

void json_append(json *array, json *child)
{
    cJSON_AddItemToArray(array, child);
}

void json_append_number(json *array, double value)
{
    json_append(array, new_number(value));
}

void json_append_string(json *array, const char *value)
{
    json_append(array, new_string(value));
}

json *json_append_object(json *array)
{
    json *child = json_new_object();
    json_append(array, child);
    return child;
}

json *json_copy(const json *node)
{
    return must(cJSON_Duplicate(node, true));
}

/* ---- writing ---- */

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

/* What most numbers are; without printf, which took a good part of an answer's time. */
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

/* How many bytes stand for themselves. */
static size_t plain_length(const char *s)
{
    size_t n = 0;
    while ((unsigned char)s[n] >= 0x20 && (unsigned char)s[n] < 0x80 && s[n] != '"' && s[n] != '\\') n++;
    return n;
}

/* Bytes that are not UTF-8, as a worker's last words may be, become U+FFFD: what we print is always JSON. */
static void add_string(text *t, const char *s)
{
    add(t, "\"", 1);
    for (size_t left = strlen(s), n; left > 0; s += n, left -= n) {
        unsigned char c = (unsigned char)*s;
        char escape[8];
        n = plain_length(s);
        if (n == 0) n = utf8_sequence((const unsigned char *)s, left);
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

/* An array of numbers and words stays on one line even when indented: vectors read better so. */
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

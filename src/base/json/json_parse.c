// SPDX-License-Identifier: Apache-2.0
/* Parses text into a tree. cJSON's own parser accepts more than RFC 8259 and truncates numbers of more than
 * 63 characters. strtod parses numbers, so the programs keep the C locale for LC_NUMERIC.
 */
#include "base/json/json.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cjson/cJSON.h>

#include "base/core/hex.h"
#include "base/core/memory.h"
#include "base/core/utf8.h"
#include "base/json/json_internal.h"

typedef struct parser {
    const unsigned char *text;
    size_t length;
    size_t at;
    char *scratch; /* length + 1 bytes: enough for any decoded string or number */
    error *e;
} parser;

typedef struct member_name {
    const char *text;
    size_t at; /* byte offset of the name, for the message */
} member_name;

/* Sets the error for a fault at byte `at`. Lines and columns (in characters) are counted from 1. */
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
    return fault_at(
        p, p->at,
        p->at < p->length ? words : "the JSON text is incomplete: add the missing bracket, brace or quote");
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

static bool read_hex4(parser *p, unsigned *out)
{
    unsigned value = 0;
    for (int i = 0; i < 4; i++, p->at++) {
        const int digit = hex_digit((char)peek(p));
        if (digit < 0) return fault(p, "\\u needs four hexadecimal digits");
        value = value * 16 + (unsigned)digit;
    }
    *out = value;
    return true;
}

/* Parses the text after "\u": one code unit, or two that form a surrogate pair. */
static bool read_unicode_escape(parser *p, size_t start, size_t *length)
{
    unsigned unit = 0, low = 0;
    if (!read_hex4(p, &unit)) return false;
    if (unit == 0) return fault_at(p, start, "the string contains \\u0000: remove it");
    if (unit >= 0xDC00 && unit <= 0xDFFF)
        return fault_at(p, start,
                        "the string has the escape of a low surrogate without a high one before it: write "
                        "both, or the character itself");
    if (unit >= 0xD800 && unit <= 0xDBFF) {
        if (p->length - p->at < 2 || p->text[p->at] != '\\' || p->text[p->at + 1] != 'u')
            return fault_at(p, start,
                            "the string has the escape of a high surrogate without a low one after it: write "
                            "both, or the character itself");
        p->at += 2;
        if (!read_hex4(p, &low)) return false;
        if (low < 0xDC00 || low > 0xDFFF)
            return fault_at(p, start,
                            "the string has the escape of a high surrogate without a low one after it: write "
                            "both, or the character itself");
        unit = 0x10000 + ((unit - 0xD800) << 10) + (low - 0xDC00);
    }
    *length += utf8_encode(unit, p->scratch + *length);
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
    if (!which) return fault(p, "the string has an unknown escape: write \\\\ for a backslash");
    p->scratch[(*length)++] = meanings[which - letters];
    p->at++;
    return true;
}

/* Parses a string from its opening quote. The decoded text is in p->scratch. */
static bool read_string(parser *p)
{
    size_t length = 0;
    p->at++;
    for (;;) {
        int c = peek(p);
        if (c < 0) return fault(p, "");
        if (c == '"') break;
        if (c < 0x20)
            return fault(p, "the string has a control character: write it as an escape, such as \\n");
        if (c == '\\') {
            if (!read_escape(p, &length)) return false;
            continue;
        }
        size_t n = json_utf8_length(p->text + p->at, p->length - p->at);
        if (n == 0) return fault_at(p, p->at, "the string is not valid UTF-8: save the text as UTF-8");
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
            fault(p, "the number begins with 0: remove the zero");
            return NULL;
        }
    } else if (!skip_digits(p, "the number has no digit here: write one, or put a word in double quotes")) {
        return NULL;
    }
    if (peek(p) == '.') {
        p->at++;
        if (!skip_digits(p, "the number has no digit after its decimal point: add one")) return NULL;
    }
    if (peek(p) == 'e' || peek(p) == 'E') {
        p->at++;
        if (peek(p) == '+' || peek(p) == '-') p->at++;
        if (!skip_digits(p, "the number has no digit in its exponent: add one")) return NULL;
    }
    memcpy(p->scratch, p->text + start, p->at - start);
    p->scratch[p->at - start] = '\0';
    double value = strtod(p->scratch, NULL);
    if (!isfinite(value)) {
        fault_at(p, start, "the number is too large: its magnitude must be below 1.8e308");
        return NULL;
    }
    return json_must(cJSON_CreateNumber(value));
}

/* Sets the error for a character, or a comment, where `words` are expected. */
static bool fault_unexpected(const parser *p, const char *words)
{
    const unsigned char *at = p->text + p->at;
    const size_t left = p->length - p->at;
    const bool slashes = left > 1 && at[0] == '/' && (at[1] == '/' || at[1] == '*');
    return fault(p,
                 slashes || (left && *at == '#') ? "JSON does not allow comments: remove this one" : words);
}

static cJSON *read_value(parser *p, int depth);

static cJSON *read_array(parser *p, int depth)
{
    cJSON *array = json_must(cJSON_CreateArray());
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
            fault_unexpected(p, "expected ',' or ']' in an array: add one");
            goto failed;
        }
        p->at++;
        if (c == ']') return array;
        skip_space(p);
        if (peek(p) == ']') {
            fault(p, "a comma before ']' is not allowed: remove it");
            goto failed;
        }
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

/* Finds duplicate names by sorting, since comparing all pairs would take quadratic time in input of a
 * client. */
static bool check_names(const parser *p, member_name *names, size_t count)
{
    const member_name *twice = NULL;
    if (count > 1) qsort(names, count, sizeof *names, compare_names);
    for (size_t i = 1; i < count; i++)
        if (strcmp(names[i - 1].text, names[i].text) == 0 && (!twice || names[i].at < twice->at))
            twice = &names[i];
    if (!twice) return true;
    char words[256];
    snprintf(words, sizeof words, "the member '%.180s' is given twice in one object: remove one",
             twice->text);
    return fault_at(p, twice->at, words);
}

/* Parses one `"name": value` and adds it to the object. Stores its name for check_names. */
static bool read_member(parser *p, int depth, cJSON *object, member_name *name)
{
    skip_space(p);
    if (peek(p) != '"') return fault_unexpected(p, "expected a member name: write it in double quotes");
    name->at = p->at;
    if (!read_string(p)) return false;
    char *key = mem_strdup(p->scratch);
    bool done = false;
    skip_space(p);
    if (peek(p) != ':') {
        fault_unexpected(p, "expected ':' after a member name: add it");
        goto end;
    }
    p->at++;
    cJSON *value = read_value(p, depth);
    if (!value) goto end;
    cJSON_AddItemToObject(object, key, value);
    if (!value->string) json_must(NULL);
    name->text = value->string;
    done = true;
end:
    free(key);
    return done;
}

static cJSON *read_object(parser *p, int depth)
{
    cJSON *object = json_must(cJSON_CreateObject());
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
            fault_unexpected(p, "expected ',' or '}' in an object: add one");
            goto end;
        }
        p->at++;
        if (c == '}') break;
        skip_space(p);
        if (peek(p) == '}') {
            fault(p, "a comma before '}' is not allowed: remove it");
            goto end;
        }
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
        return json_must(i == 2 ? cJSON_CreateNull() : cJSON_CreateBool(i == 0));
    }
    fault_unexpected(p, "expected a value: write an object, an array, a string in double quotes, a number, "
                        "true, false or null");
    return NULL;
}

/* Parses a value and the white space around it. `depth` is the number of open objects and arrays;
 * JSON_MAX_DEPTH bounds the recursion. */
static cJSON *read_value(parser *p, int depth)
{
    cJSON *value;
    skip_space(p);
    int c = peek(p);
    if ((c == '{' || c == '[') && depth == JSON_MAX_DEPTH) {
        fault(p, "the document nests too many objects and arrays: flatten it");
        return NULL;
    }
    if (c == '{')
        value = read_object(p, depth + 1);
    else if (c == '[')
        value = read_array(p, depth + 1);
    else if (c == '"')
        value = read_string(p) ? json_must(cJSON_CreateString(p->scratch)) : NULL;
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
        fault_at(&p, 0, "the text begins with a byte order mark: save it without one");
        return NULL;
    }
    p.scratch = mem_alloc(length + 1);
    root = read_value(&p, 0);
    if (root && p.at < length) {
        fault(&p, "more text follows the end of the document: remove it");
        cJSON_Delete(root);
        root = NULL;
    }
    free(p.scratch);
    return root;
}

// SPDX-License-Identifier: Apache-2.0
/* json: parses, builds and prints JSON documents. The only user of cJSON.
 *
 * Parsing is strict (RFC 8259), while cJSON itself is lenient: UTF-8, no trailing text, no lone surrogate, no
 * control character in a string, no duplicate member names, at most JSON_MAX_DEPTH levels. A value is
 * addressed by a json_at, which contains the path to it, so that an error can name its JSON Pointer (RFC
 * 6901). Building cannot fail: documents are small, see base/core/memory.h. A document belongs to one thread
 * at a time.
 */
#ifndef HEXAD_BASE_JSON_JSON_H
#define HEXAD_BASE_JSON_JSON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"

#define JSON_MAX_DEPTH 64

typedef struct cJSON json; /* a node: a whole document or a part of one */

typedef enum json_type {
    JSON_NONE, /* no such value */
    JSON_NULL,
    JSON_BOOL,
    JSON_NUMBER,
    JSON_STRING,
    JSON_ARRAY,
    JSON_OBJECT
} json_type;

/* Parses `length` bytes. NULL and the error spec_invalid ("line L column C: ...") if they are not one JSON
 * value. The caller frees the document with json_free, which accepts NULL. */
json *json_parse(const char *text, size_t length, error *e);
void json_free(json *root);

/* A position in a document. Its `parent` must remain valid as long as it; it is usually on the caller's
 * stack. */
typedef struct json_at {
    const json *node; /* NULL: absent */
    const struct json_at *parent;
    const char *key; /* member name, or NULL for an array element */
    size_t index;
} json_at;

json_at json_root(const json *root);
/* node NULL if it is absent or `object` is not an object */
json_at json_member(const json_at *object, const char *key);
/* The elements of an array, or the members of an object with their keys, one after another:
 *     for (json_at at = json_first(&list); at.node; at = json_next(&at))
 * A list has no access by index, because a loop with it would take quadratic time. */
json_at json_first(const json_at *list);
json_at json_next(const json_at *at);
json_type json_type_of(json_at at);
size_t json_size(json_at at); /* number of elements or members, which are counted; 0 for other types */
double json_number(json_at at, double otherwise); /* `otherwise` if it is absent or of another type */
/* Stores pointers to the first `count` elements of an array, of any type, in `out`. Returns their number. */
size_t json_elements(json_at array, const json **out, size_t count);
bool json_bool(json_at at, bool otherwise);
const char *json_string(json_at at, const char *otherwise); /* remains valid as long as the document */
/* Stores the first `count` numbers of an array in `out`. Stops at the first element that is not a number.
 * Returns how many were stored. */
size_t json_numbers(json_at array, double *out, size_t count);

/* Writes the JSON Pointer of a position ("" for the root, "/surface/vdb/path"), truncated if necessary, and
 * returns `buffer`. */
char *json_pointer(const json_at *at, char *buffer, size_t size);

/* The value at a JSON Pointer that starts at `node`, or NULL. */
json *json_find(json *node, const char *pointer);

/* ---- Building. `child` is taken over. json_put replaces an existing member. A number that is not finite
 * becomes null. */
json *json_new_object(void);
json *json_new_array(void);
json *json_new_number(double value);
json *json_new_string(const char *value); /* null for NULL */
/* Puts a value at a JSON Pointer and replaces an existing value. Missing objects on the path are created.
 * False, and `value` stays the caller's, if the path leads through a value that is not an object or array, or
 * to a missing element of an array. */
bool json_set(json *root, const char *pointer, json *value);
void json_put(json *object, const char *key, json *child);
void json_put_null(json *object, const char *key);
void json_remove(json *object, const char *key); /* a missing key is ignored */
void json_put_bool(json *object, const char *key, bool value);
void json_put_number(json *object, const char *key, double value);
void json_put_integer(json *object, const char *key, int64_t value);    /* exact to 2^53 */
void json_put_string(json *object, const char *key, const char *value); /* NULL becomes null */
/* Adds JSON text that json_print has produced or json_parse has accepted. It is printed without change, and
 * its members cannot be found. */
void json_put_text(json *object, const char *key, const char *text);
json *json_put_object(json *object, const char *key); /* a new empty object, owned by `object` */
json *json_put_array(json *object, const char *key);
void json_set_string(json *string, const char *value); /* `string` must be a string */
void json_append(json *array, json *child);
void json_append_number(json *array, double value);
void json_append_string(json *array, const char *value);
json *json_append_object(json *array);
json *json_copy(const json *node);

/* The text of a node with a final NUL; the caller frees it. json_print prints one line; json_print_pretty
 * indents by two spaces and ends with a line break. A number is the shortest text that parses to the same
 * double. Bytes of a string that are not UTF-8 are printed as U+FFFD. */
char *json_print(const json *node);
char *json_print_pretty(const json *node);

/* Whether a text is UTF-8, so that it is printed as it is. */
bool json_is_text(const char *value);

#endif

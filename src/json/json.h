/* json: documents, read and built. The only user of cJSON.
 *
 * Reading is strict (RFC 8259: UTF-8, no trailing text, no lone surrogate, no control character in a
 * string, no duplicate member names, at most JSON_MAX_DEPTH levels) where cJSON itself is lenient.
 * A value is reached through a json_at, which remembers how it was reached, so that a complaint can
 * name its JSON Pointer (RFC 6901). Building cannot fail: small documents, see base/memory.h.
 * A document belongs to one thread at a time.
 */
#ifndef HEXAD_JSON_JSON_H
#define HEXAD_JSON_JSON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"

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

/* Parses `length` bytes; NULL and an error (spec_invalid, "line L column C: ...") when they are not
 * one JSON value. The caller frees with json_free, which accepts NULL. */
json *json_parse(const char *text, size_t length, error *e);
void json_free(json *root);

/* A place in a document. `parent` places live on the caller's stack for as long as their children. */
typedef struct json_at {
    const json *node; /* NULL: absent */
    const struct json_at *parent;
    const char *key; /* member name, or NULL for an array element */
    size_t index;
} json_at;

json_at json_root(const json *root);
json_at json_member(const json_at *object, const char *key); /* node NULL when absent or no object */
json_at json_element(const json_at *array, size_t index);    /* members too: the index-th, with key */
json_type json_type_of(json_at at);
size_t json_size(json_at at);                     /* elements or members; 0 for the rest */
double json_number(json_at at, double otherwise); /* `otherwise` when absent or of another type */
/* The same of elements of any type. */
size_t json_elements(json_at array, const json **out, size_t count);
bool json_bool(json_at at, bool otherwise);
const char *json_string(json_at at, const char *otherwise); /* lives as long as the document */
/* The first `count` elements of an array into out, in one walk (element by element is quadratic). Returns how
 * many there were before the first that is not a number, or before the end. */
size_t json_numbers(json_at array, double *out, size_t count);

/* Writes the JSON Pointer of a place ("" for the root, "/surface/vdb/path"), cut to fit, and
 * returns `buffer`. */
char *json_pointer(const json_at *at, char *buffer, size_t size);

/* The value at a JSON Pointer from a node on, or NULL. */
json *json_find(json *node, const char *pointer);

/* Building. `child` is taken over. Putting a key that is there replaces it. A number that is not
 * finite is put as null. */
json *json_new_object(void);
json *json_new_array(void);
json *json_new_number(double value);
/* Puts a value at a JSON Pointer, in the place of what is there. Objects that are missing on the way are made. False, and
 * `value` stays the caller's, when the way leads through something else or to no element of an array. */
bool json_set(json *root, const char *pointer, json *value);
void json_put(json *object, const char *key, json *child);
void json_put_null(json *object, const char *key);
void json_remove(json *object, const char *key); /* a key that is not there is ignored */
void json_put_bool(json *object, const char *key, bool value);
void json_put_number(json *object, const char *key, double value);
void json_put_integer(json *object, const char *key, int64_t value);    /* exact to 2^53 */
void json_put_string(json *object, const char *key, const char *value); /* NULL puts null */
/* JSON text that json_print or json_parse has produced or accepted. It is printed without change, and its members cannot
 * be found. */
void json_put_text(json *object, const char *key, const char *text);
json *json_put_object(json *object, const char *key); /* a new empty one, returned, owned by `object` */
json *json_put_array(json *object, const char *key);
void json_set_string(json *string, const char *value); /* of a node that is one */
void json_append(json *array, json *child);
void json_append_number(json *array, double value);
void json_append_string(json *array, const char *value);
json *json_append_object(json *array);
json *json_copy(const json *node);

/* The text of a node, NUL-terminated, released with free(): on one line, or indented by two spaces
 * and ended by a line break. Numbers are the shortest text that reads back to the same double;
 * bytes of a string that are not UTF-8 are printed as U+FFFD. */
char *json_print(const json *node);
char *json_print_pretty(const json *node);

#endif

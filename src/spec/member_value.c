// SPDX-License-Identifier: Apache-2.0
#include "spec/member_value.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/utf8.h"
#include "spec/file_names.h"
#include "spec/frame_values.h"

_Static_assert(sizeof(spec_shape) == sizeof(int), "words are stored as int");

static bool is_number(json_at at, const spec_row *row, bool whole)
{
    if (json_type_of(at) != JSON_NUMBER) return false;
    double value = json_number(at, 0);
    if (value == 0 && row->flags & SPEC_OR_ZERO) return true;
    if (!isfinite(value) || value > row->high || value < row->low) return false;
    if (value == row->low && row->flags & SPEC_LOW_OPEN) return false;
    return !whole || value == floor(value);
}

static void read_number(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    bool whole = row->type != SPEC_TYPE_NUMBER;
    double value = json_number(*at, 0);
    if (!is_number(*at, row, whole)) {
        reading_add_wrong_value(r, at, row, whole ? "an integer" : "a number");
        return;
    }
    if (value == 0) value = 0; /* replaces -0, which would print as another text for the same job */
    if (row->type == SPEC_TYPE_LARGE)
        json_put_integer(normal, spec_row_key(row), (int64_t)value);
    else
        json_put_number(normal, spec_row_key(row), value);
    if (row->has != SPEC_NOWHERE) *(bool *)reading_target(r, row->has) = true;
    if (row->offset == SPEC_NOWHERE) return;
    if (row->type == SPEC_TYPE_NUMBER) {
        memcpy(reading_target(r, row->offset), &value, sizeof value);
    } else if (row->type == SPEC_TYPE_INTEGER) {
        int integer = (int)value;
        memcpy(reading_target(r, row->offset), &integer, sizeof integer);
    } else {
        int64_t large = (int64_t)value;
        memcpy(reading_target(r, row->offset), &large, sizeof large);
    }
}

/* Reads three numbers, or three integers. */
static void read_vector(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    bool whole = row->type == SPEC_TYPE_TRIPLE, good = true;
    if (json_type_of(*at) != JSON_ARRAY || json_size(*at) != 3) {
        reading_add_wrong_value(r, at, row,
                                whole ? "an array of three integers" : "an array of three numbers");
        return;
    }
    vec3 v = {0, 0, 0};
    for (json_at element = json_first(at); element.node; element = json_next(&element)) {
        if (is_number(element, row, whole)) {
            double value = json_number(element, 0);
            vec3_set(&v, (int)element.index, value == 0 ? 0 : value);
        } else {
            reading_add_wrong_value(r, &element, row, whole ? "an integer" : "a number");
            good = false;
        }
    }
    if (!good) return;
    if (row->has != SPEC_NOWHERE) *(bool *)reading_target(r, row->has) = true;
    if (whole) {
        const int triple[3] = {(int)v.x, (int)v.y, (int)v.z};
        memcpy(reading_target(r, row->offset), triple, sizeof triple);
    } else {
        memcpy(reading_target(r, row->offset), &v, sizeof v);
    }
    json *list = json_put_array(normal, spec_row_key(row));
    for (int i = 0; i < 3; i++) json_append_number(list, vec3_get(v, i));
}

/* Reads any number of numbers. The fault contains the first bad one. */
static void read_numbers(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    if (json_type_of(*at) != JSON_ARRAY) {
        reading_add_mismatch(r, at, "must be an array of numbers");
        return;
    }
    size_t count = json_size(*at);
    double *numbers = mem_alloc((count + 1) * sizeof *numbers);
    /* stored at once: the spec frees them */
    *(double **)reading_target(r, row->offset) = numbers;
    json *list = json_put_array(normal, spec_row_key(row));
    for (json_at element = json_first(at); element.node; element = json_next(&element)) {
        const double number = json_number(element, NAN);
        if (!(number >= row->low && number <= row->high)) {
            reading_add_wrong_value(r, &element, row, "a number");
            return;
        }
        numbers[element.index] = number;
        json_append_number(list, number == 0 ? 0 : number);
    }
    *(size_t *)reading_target(r, row->has) = count;
}

/* Reads a list of integers. The fault contains the first bad one. */
static void read_list(reading *r, const json_at *at, const spec_row *row, spec_list *out, json *normal)
{
    if (json_type_of(*at) != JSON_ARRAY) {
        reading_add_wrong_value(r, at, row, "an array of integers");
        return;
    }
    out->number = mem_alloc((json_size(*at) + 1) * sizeof *out->number);
    for (json_at element = json_first(at); element.node; element = json_next(&element)) {
        if (!is_number(element, row, true)) {
            reading_add_wrong_value(r, &element, row, "an integer");
            break;
        }
        const double number = json_number(element, 0);
        out->number[out->count++] = number;
        json_append_number(normal, number == 0 ? 0 : number);
    }
}

static void read_integers(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    read_list(r, at, row, reading_target(r, row->offset), json_put_array(normal, spec_row_key(row)));
}

static void read_lists(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    if (json_type_of(*at) != JSON_ARRAY) {
        reading_add_mismatch(r, at, "must be an array of arrays of integers");
        return;
    }
    const size_t count = json_size(*at);
    spec_list *lists = mem_alloc((count + 1) * sizeof *lists);
    memcpy(reading_target(r, row->offset), &lists, sizeof lists); /* stored at once: the spec frees them */
    memcpy(reading_target(r, row->has), &count, sizeof count);
    json *all = json_put_array(normal, spec_row_key(row));
    for (json_at element = json_first(at); element.node; element = json_next(&element)) {
        json *list = json_new_array();
        json_append(all, list);
        read_list(r, &element, row, &lists[element.index], list);
    }
}

static void read_size(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    int size[2];
    bool pair = json_type_of(*at) == JSON_ARRAY && json_size(*at) == 2, good = true;
    if (!pair && !is_number(*at, row, true)) {
        reading_add_wrong_value(r, at, row, "an integer, or an array [width, height] of integers,");
        return;
    }
    size[0] = size[1] = (int)json_number(*at, 0);
    for (json_at side = json_first(at); side.node; side = json_next(&side)) {
        if (!is_number(side, row, true)) {
            reading_add_wrong_value(r, &side, row, "an integer");
            good = false;
        } else {
            size[side.index] = (int)json_number(side, 0);
        }
    }
    if (!good) return;
    memcpy(reading_target(r, row->offset), size, sizeof size);
    json *list = json_put_array(normal, spec_row_key(row));
    for (int i = 0; i < 2; i++) json_append_number(list, size[i]);
}

/* The index of the word in the row's list. -1: it is another value, and a fault was added. */
static int find_word(reading *r, const json_at *at, const spec_row *row)
{
    char allowed[256] = "";
    const char *text = json_string(*at, "");
    for (int i = 0; row->words[i]; i++) {
        if (strcmp(row->words[i], text) == 0) return i;
        size_t n = strlen(allowed);
        snprintf(allowed + n, sizeof allowed - n, "%s\"%s\"", i ? ", " : "", row->words[i]);
    }
    reading_add_mismatch(r, at, "must be %s%s", strchr(allowed, ',') ? "one of " : "", allowed);
    return -1;
}

static void read_word(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    int i = find_word(r, at, row);
    if (i < 0) return;
    if (row->offset != SPEC_NOWHERE) memcpy(reading_target(r, row->offset), &i, sizeof i);
    if (row->has != SPEC_NOWHERE) *(bool *)reading_target(r, row->has) = true;
    if (row->offset == offsetof(spec, surface.analytic.shape)) r->shape_known = true;
    if (row->offset == offsetof(spec, method)) r->methods = 1u << i;
    json_put_string(normal, spec_row_key(row), row->words[i]);
}

/* The normalised list has each word once, in the order of the row. */
static void read_words(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    unsigned found = 0;
    if (json_type_of(*at) != JSON_ARRAY || json_size(*at) == 0) {
        reading_add_mismatch(r, at, "must be an array of at least one word");
        return;
    }
    for (json_at element = json_first(at); element.node; element = json_next(&element)) {
        int i = find_word(r, &element, row);
        if (i < 0) return;
        if (found & 1u << i) {
            reading_add_fault(r, &element, "is a repetition of '%s': remove one", row->words[i]);
            return;
        }
        found |= 1u << i;
    }
    memcpy(reading_target(r, row->offset), &found, sizeof found);
    json *list = json_put_array(normal, spec_row_key(row));
    for (int i = 0; row->words[i]; i++)
        if (found & 1u << i) json_append_string(list, row->words[i]);
}

static void read_bool(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    if (json_type_of(*at) != JSON_BOOL) {
        reading_add_mismatch(r, at, "must be true or false");
        return;
    }
    bool value = json_bool(*at, false);
    memcpy(reading_target(r, row->offset), &value, sizeof value);
    json_put_bool(normal, spec_row_key(row), value);
}

static void read_string(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    const char *text = json_string(*at, NULL);
    size_t length = text ? utf8_count(text) : 0;
    if (!text) {
        reading_add_mismatch(r, at, "must be a string");
    } else if ((double)length < row->low || (double)length > row->high) {
        reading_add_fault(r, at, "must be a string of %.16g to %.16g characters (given %zu)", row->low,
                          row->high, length);
    } else {
        *(char **)reading_target(r, row->offset) = mem_strdup(text);
        json_put_string(normal, spec_row_key(row), text);
    }
}

/* Appends a string to the list at the row's offset. */
static void read_label(reading *r, const json_at *at, const spec_row *row, json *list)
{
    const char *text = json_string(*at, NULL);
    if (!text || !*text || utf8_count(text) > SPEC_LABEL_LENGTH_MAX) {
        reading_add_mismatch(r, at, "must be a string of 1 to %d characters", SPEC_LABEL_LENGTH_MAX);
        return;
    }
    char **labels = *(char ***)reading_target(r, row->offset);
    labels[(*(size_t *)reading_target(r, row->has))++] = mem_strdup(text);
    json_append_string(list, text);
}

static void read_labels(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    bool one = row->flags & SPEC_OR_ONE && json_type_of(*at) == JSON_STRING;
    size_t count = one ? 1 : json_size(*at);
    if (!one && (json_type_of(*at) != JSON_ARRAY || (double)count > row->high)) {
        reading_add_mismatch(r, at, "must be an array of at most %.16g strings", row->high);
        return;
    }
    /* the spec frees them */
    *(char ***)reading_target(r, row->offset) = mem_alloc(count * sizeof(char *));
    json *list = json_put_array(normal, spec_row_key(row));
    if (one) read_label(r, at, row, list);
    for (json_at element = json_first(at); element.node; element = json_next(&element))
        read_label(r, &element, row, list);
}

static void read_file_name(reading *r, const json_at *at, spec_files *files)
{
    const char *text = json_string(*at, NULL);
    if (text && *text && utf8_count(text) <= SPEC_FILE_NAME_MAX)
        files->name[files->count++] = mem_strdup(text);
    else
        reading_add_mismatch(r, at, "must be the name of a file, a string of 1 to %d characters",
                             SPEC_FILE_NAME_MAX);
}

static void read_files(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    spec_files *files = reading_target(r, row->offset);
    const char *pattern = json_string(*at, NULL);
    size_t count = pattern ? 1 : json_size(*at);
    if (pattern && !file_names_is_pattern(pattern)) {
        reading_add_mismatch(r, at,
                             "must have * in its last part, and in no other part; give one file as a list");
        return;
    }
    if (!pattern &&
        (json_type_of(*at) != JSON_ARRAY || (double)count < row->low || (double)count > row->high)) {
        reading_add_mismatch(r, at,
                             "must be an array of %.0f to %.0f names, or a pattern such as \"meshes/*.ply\"",
                             row->low, row->high);
        return;
    }
    files->name = mem_alloc(count * sizeof *files->name);
    files->is_pattern = pattern;
    if (pattern) read_file_name(r, at, files);
    for (json_at element = json_first(at); element.node; element = json_next(&element))
        read_file_name(r, &element, files);
    json_put(normal, spec_row_key(row), json_copy(at->node));
}

void member_value_read(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    switch (row->type) {
    case SPEC_TYPE_NUMBER:
    case SPEC_TYPE_INTEGER:
    case SPEC_TYPE_LARGE:
        read_number(r, at, row, normal);
        break;
    case SPEC_TYPE_BOOL:
        read_bool(r, at, row, normal);
        break;
    case SPEC_TYPE_WORD:
        read_word(r, at, row, normal);
        break;
    case SPEC_TYPE_WORDS:
        read_words(r, at, row, normal);
        break;
    case SPEC_TYPE_STRING:
        read_string(r, at, row, normal);
        break;
    case SPEC_TYPE_VECTOR:
    case SPEC_TYPE_TRIPLE:
        read_vector(r, at, row, normal);
        break;
    case SPEC_TYPE_NUMBERS:
        read_numbers(r, at, row, normal);
        break;
    case SPEC_TYPE_INTEGERS:
        read_integers(r, at, row, normal);
        break;
    case SPEC_TYPE_LISTS:
        read_lists(r, at, row, normal);
        break;
    case SPEC_TYPE_SIZE:
        read_size(r, at, row, normal);
        break;
    case SPEC_TYPE_LABELS:
        read_labels(r, at, row, normal);
        break;
    case SPEC_TYPE_FILES:
        read_files(r, at, row, normal);
        break;
    case SPEC_TYPE_FRAME_VALUES:
        frame_values_read(r, at, row, normal);
        break;
    case SPEC_TYPE_SURFACE:
    case SPEC_TYPE_SURFACES:
    case SPEC_TYPE_GROUPS:
    case SPEC_TYPE_GROUP:
        break; /* groups and surfaces are read in group.c */
    }
}

// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/library_text.h"

#include <ctype.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io/meshes/plain_textures.h"

/* ---- XML */

/* Maximum depth of elements whose parents are known; COLLADA files have about ten levels. */
enum { DEEPEST = 200 };

typedef struct document {
    xml reader;
    plain_mesh *m;
    int depth;
    bool is_node[DEEPEST]; /* by depth: whether the element is a <node> of COLLADA */
    size_t begin;          /* of the text of the innermost element */
    size_t declared;       /* attribute `count` of the last element that has one */
    bool in_triangles;     /* the primitive is <triangles> */
    size_t triangles;      /* its count */
    size_t stride;         /* numbers for each corner of it */
    size_t sets;           /* number of sets of texture coordinates of the primitive */
    size_t gaps;           /* number of sets that have another number than the library gives them */
} document;

static bool refuse(document *d, const char *format, ...) __attribute__((format(printf, 2, 3)));

static bool refuse(document *d, const char *format, ...)
{
    char text[200];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    return plain_mesh_refuse(d->m, ERROR_INPUT_DAMAGED, "line %lu: %s. Save it again.", xml_line(&d->reader),
                             text);
}

/* Reads a number that is whole and not negative, and nothing else. */
static bool read_whole(const char *text, size_t *out)
{
    char *end;
    *out = strtoull(text, &end, 10);
    return isdigit((unsigned char)*text) && *end == 0;
}

/* Counts the numbers between two places of the file. False: the file is refused, because another word is
 * between them. */
static bool count_numbers(document *d, const char *element, size_t *count)
{
    const char *at = d->reader.data + d->begin, *last = d->reader.data + xml_tag_begin(&d->reader);
    for (*count = 0;; ++*count) {
        char *end;
        while (at < last && isspace((unsigned char)*at)) at++;
        if (at >= last) return true;
        strtod(at, &end);
        if (end == at || (end < last && !isspace((unsigned char)*end)))
            return refuse(d, "<%s> has \"%.*s\", which is not a number", element,
                          (int)strcspn(at, " \t\r\n<"), at);
        at = end;
    }
}

/* ---- COLLADA */

/* Numbers of the elements that place a node. */
static const struct {
    const char *name;
    size_t numbers;
} transforms[] = {{"translate", 3}, {"rotate", 4}, {"scale", 3}, {"matrix", 16}, {"lookat", 9}};

/* Counts a set of texture coordinates. The library numbers the sets of a primitive from 0. A single one is found under any
 * number. */
static void count_set(document *d, const char *semantic, const char *set)
{
    if (!semantic || strcmp(semantic, "TEXCOORD") != 0) return;
    d->gaps += d->sets > 0 && strtoull(set ? set : "", NULL, 10) != d->sets;
    d->sets++;
}

static void warn_of_textures(const document *d)
{
    if (d->gaps > 0)
        plain_textures_warn(
            d->m, "%zu sets of texture coordinates are not numbered 0, 1, ...: images may use another set",
            d->gaps);
}

static bool begin_collada(void *context, const char *name, const char **attributes)
{
    document *d = context;
    const char *count = xml_attribute(attributes, "count"), *offset = xml_attribute(attributes, "offset");
    size_t place = 0;
    name = xml_local_name(name);
    if (++d->depth >= DEEPEST) return refuse(d, "its elements are nested more than %d deep", DEEPEST);
    d->is_node[d->depth] = strcmp(name, "node") == 0;
    d->begin = xml_tag_end(&d->reader);
    if (strcmp(name, "skew") == 0 && d->is_node[d->depth - 1])
        return plain_mesh_refuse(d->m, ERROR_INPUT_UNSUPPORTED,
                                 "line %lu: the file has a <skew>, which is not read. Apply the transforms "
                                 "of its nodes to the vertices before you save it.",
                                 xml_line(&d->reader));
    if (count && !read_whole(count, &d->declared))
        return refuse(d, "the count of <%s> is \"%s\", which is not a number", name, count);
    if (strcmp(name, "triangles") == 0) {
        d->in_triangles = true;
        d->triangles = count ? d->declared : 0;
        d->stride = 1;
        d->sets = 0;
    } else if (strcmp(name, "input") == 0 && offset) {
        if (!read_whole(offset, &place))
            return refuse(d, "the offset of <input> is \"%s\", which is not a number", offset);
        if (place >= d->stride) d->stride = place + 1;
        count_set(d, xml_attribute(attributes, "semantic"), xml_attribute(attributes, "set"));
    } else if (strstr(name, "poly") || strstr(name, "tri")) {
        d->in_triangles = false;
        d->sets = 0;
    }
    return true;
}

static void end_collada(void *context, const char *name)
{
    document *d = context;
    size_t count;
    name = xml_local_name(name);
    const bool is_placed = d->is_node[--d->depth];
    if (d->m->refused != ERROR_NONE) return;
    if (strcmp(name, "float_array") == 0) {
        if (count_numbers(d, name, &count) && count != d->declared)
            refuse(d, "<float_array> declares %zu numbers and has %zu", d->declared, count);
    } else if (strcmp(name, "p") == 0) {
        if (count_numbers(d, name, &count) && d->in_triangles && count != 3 * d->stride * d->triangles)
            refuse(d, "<triangles> declares %zu triangles of %zu numbers and has %zu numbers", d->triangles,
                   3 * d->stride, count);
    }
    for (size_t k = 0; k < sizeof transforms / sizeof *transforms && is_placed; k++)
        if (strcmp(name, transforms[k].name) == 0 && count_numbers(d, name, &count) &&
            count != transforms[k].numbers)
            refuse(d, "<%s> has %zu numbers and not %zu", name, count, transforms[k].numbers);
}

/* ---- FBX */

/* Beginning of the name of the property in a line of text; NULL: the line is another. */
static const char *property_of(const char *line)
{
    static const char *const begins[] = {"P: \"", "Property: \""};
    line += strspn(line, " \t");
    for (size_t k = 0; k < sizeof begins / sizeof *begins; k++)
        if (strncmp(line, begins[k], strlen(begins[k])) == 0) return line + strlen(begins[k]);
    return NULL;
}

/* Whether a line between `first` and `last` has a property of the same name. */
static bool is_there(const char *first, const char *last, const char *name, size_t length)
{
    for (const char *at = first; at < last; at = strchr(at, '\n') + 1) {
        const char *other = property_of(at);
        if (other && strncmp(other, name, length + 1) == 0) return true;
    }
    return false;
}

/* Checks that an array of text, "Vertices: *24 {" and "a: 1,2,..." in the next line, has the numbers that it
 * declares. Other lines are accepted. */
static bool check_array(const char *data, const char *line, plain_mesh *m)
{
    const size_t length = strcspn(line, "\n");
    const char *star = memchr(line, '*', length), *at = star ? line + length : NULL, *values;
    char *end;
    size_t count = 1;
    if (!star || star - line < 2 || strncmp(star - 2, ": ", 2) != 0) return true;
    const size_t declared = strtoull(star + 1, &end, 10);
    at += strspn(at, " \t\r\n");
    if (end[strspn(end, " \t")] != '{' || strncmp(at, "a:", 2) != 0) return true;
    values = at + 2;
    const char *last = values + strcspn(values, "}");
    for (at = values; (at = memchr(at, ',', (size_t)(last - at))); at++) count++;
    if (values + strspn(values, " \t\r\n") == last) count = 0;
    return count == declared ||
           plain_mesh_refuse_at(m, data, line,
                                "of the FBX file has an array that declares %zu numbers and has %zu",
                                declared, count);
}

/* Refuses text in which a list of properties has one of them twice, or an array that is not what it declares. */
static bool check_fbx(const char *data, plain_mesh *m)
{
    const char *first = data; /* of the list */
    for (const char *at = data; at; at = strchr(at, '\n')) {
        at += *at == '\n';
        const char *name = property_of(at);
        if (!name) {
            first = at;
            if (!check_array(data, at, m)) return false;
            continue;
        }
        const size_t length = strcspn(name, "\"\n");
        if (name[length] == '"' && is_there(first, at, name, length))
            return plain_mesh_refuse_at(m, data, at,
                                        "of the FBX file has the property \"%.*s\" for the second time",
                                        (int)(length < 60 ? length : 60), name);
    }
    return true;
}

void library_text_move_blanks(char *data)
{
    for (char *at = data; (at = strchr(at, '='));) {
        const char quote = *++at;
        char *value = at + 1, *number = value + strspn(value, " \t\r\n");
        if ((quote != '"' && quote != '\'') || number == value || !strchr("+-.0123456789", *number) ||
            !*number)
            continue;
        char *end = strchr(number, quote);
        if (!end || memchr(number, '<', (size_t)(end - number))) continue;
        const size_t blanks = (size_t)(number - value), length = (size_t)(end - number) + 1;
        memmove(value, number, length);
        memset(value + length, ' ', blanks);
    }
}

bool library_text_check(file_format format, const char *data, size_t size, plain_mesh *m)
{
    document d = {.m = m};
    d.reader = (xml){.data = data, .size = size, .context = &d, .allows_doctype = true};
    switch (format) {
    case FILE_FORMAT_COLLADA:
        d.reader.begin = begin_collada;
        d.reader.end = end_collada;
        if (!plain_mesh_read_xml(m, &d.reader, "the COLLADA file")) return false;
        if (m->textures) warn_of_textures(&d);
        return true;
    case FILE_FORMAT_FBX:
        return strncmp(data, "Kaydara", 7) == 0 || check_fbx(data, m);
    default:
        return true;
    }
}

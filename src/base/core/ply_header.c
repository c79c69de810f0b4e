// SPDX-License-Identifier: Apache-2.0
#include "base/core/ply_header.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum { LINE_MOST = 256 };

static const ply_type types[] = {
    {"char", NUMBER_INT8},      {"uchar", NUMBER_UINT8},    {"int8", NUMBER_INT8},
    {"uint8", NUMBER_UINT8},    {"short", NUMBER_INT16},    {"ushort", NUMBER_UINT16},
    {"int16", NUMBER_INT16},    {"uint16", NUMBER_UINT16},  {"int", NUMBER_INT32},
    {"uint", NUMBER_UINT32},    {"int32", NUMBER_INT32},    {"uint32", NUMBER_UINT32},
    {"float", NUMBER_FLOAT},    {"float32", NUMBER_FLOAT},  {"double", NUMBER_DOUBLE},
    {"float64", NUMBER_DOUBLE}, {"double64", NUMBER_DOUBLE}};

static const ply_type *find_type(const char *name)
{
    for (size_t k = 0; k < sizeof types / sizeof *types; k++)
        if (strcmp(types[k].name, name) == 0) return &types[k];
    return NULL;
}

static bool take_format(ply_header *h, const char *name)
{
    static const char *const names[] = {
        [PLY_TEXT] = "ascii", [PLY_LITTLE] = "binary_little_endian", [PLY_BIG] = "binary_big_endian"};
    for (size_t k = 0; k < sizeof names / sizeof *names; k++)
        if (strcmp(name, names[k]) == 0) {
            h->layout = (ply_layout)k;
            return true;
        }
    return false;
}

static bool take_element(ply_header *h, const char *name, const char *count, size_t line)
{
    if (h->elements == PLY_ELEMENTS_MOST || !*count || count[strspn(count, "0123456789")]) return false;
    ply_element *new = &h->element[h->elements++];
    *new = (ply_element){
        .count = strtoull(count, NULL, 10), .line = line, .property = h->property + h->properties};
    memcpy(new->name, name, sizeof new->name);
    return true;
}

static bool take_property(ply_header *h, char word[5][PLY_NAME_SIZE])
{
    if (h->elements == 0 || h->properties == PLY_PROPERTIES_MOST) return false;
    ply_element *of = &h->element[h->elements - 1];
    ply_property *new = &h->property[h->properties++];
    const bool list = strcmp(word[1], "list") == 0;
    *new = (ply_property){.type = find_type(word[list ? 3 : 1]), .length = list ? find_type(word[2]) : NULL};
    memcpy(new->name, word[list ? 4 : 2], sizeof new->name);
    for (int k = 0; k < of->properties; k++) /* two of a name: which one is meant is not known */
        if (strcmp(of->property[k].name, new->name) == 0) return false;
    of->properties++;
    of->has_list |= list;
    if (!list && new->type) of->row += number_bytes(new->type->number);
    return new->type &&*new->name && (!list || (new->length &&number_is_whole(new->length->number)));
}

/* Takes a line; false: it is not known. */
static bool take_line(ply_header *h, const char *line, size_t at, bool *format)
{
    char word[5][PLY_NAME_SIZE] = {"", "", "", "", ""}, more[2] = "";
    const int words =
        sscanf(line, "%79s %79s %79s %79s %79s %1s", word[0], word[1], word[2], word[3], word[4], more);
    if (strcmp(word[0], "format") == 0) {
        const bool is_first = !*format;
        *format = true;
        return is_first && words <= 3 && take_format(h, word[1]);
    }
    if (strcmp(word[0], "element") == 0) return words == 3 && take_element(h, word[1], word[2], at);
    if (strcmp(word[0], "property") == 0)
        return words == (strcmp(word[1], "list") == 0 ? 5 : 3) && take_property(h, word);
    if (at == 0) return strcasecmp(word[0], "ply") == 0;
    return !*word[0] || strcmp(word[0], "comment") == 0 || strcmp(word[0], "obj_info") == 0;
}

bool ply_header_read(const char *data, size_t size, ply_header *out)
{
    bool format = false;
    memset(out, 0, sizeof *out);
    for (size_t at = 0; at < size;) {
        size_t end = at;
        while (end < size && data[end] != '\n' && data[end] != '\r') end++;
        const size_t length = end - at;
        char line[LINE_MOST], word[LINE_MOST] = "";
        out->fault = at;
        out->body = end + 1 + (end + 1 < size && data[end] == '\r' && data[end + 1] == '\n');
        snprintf(line, sizeof line, "%.*s", (int)(length < sizeof line ? length : sizeof line - 1),
                 data + at);
        sscanf(line, "%255s", word);
        if (end == size) return false;
        if (strcmp(word, "end_header") == 0) return format;
        if (!take_line(out, line, at, &format)) return false;
        at = out->body;
    }
    return false;
}

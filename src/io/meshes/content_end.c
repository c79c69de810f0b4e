// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/content_end.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/core/file_format.h"
#include "io/meshes/ply_rows.h"

/* Bytes of a binary STL file: before its number of triangles, before the triangles, and of each triangle. */
enum { STL_COUNT_AT = 80, STL_HEAD = 84, STL_TRIANGLE = 50 };

static bool is_blank(char c)
{
    return c == ' ' || (c >= '\t' && c <= '\r');
}

static const char *skip_blanks(const char *at, const char *end)
{
    while (at < end && is_blank(*at)) at++;
    return at;
}

static const char *next_line(const char *at, const char *end)
{
    const char *line = memchr(at, '\n', (size_t)(end - at));
    return line ? line + 1 : end;
}

static bool begins_with(const char *at, const char *end, const char *word)
{
    return (size_t)(end - at) >= strlen(word) && strncasecmp(at, word, strlen(word)) == 0;
}

/* Behind the last solid's "endsolid"; NULL: there is none. */
static const char *end_of_solids(const char *at, const char *end)
{
    const char *found = NULL;
    bool within = false;
    while ((at = skip_blanks(at, end)) < end) {
        if (begins_with(at, end, "endsolid")) {
            within = false;
            found = next_line(at, end);
        } else if (!within) {
            if (!begins_with(at, end, "solid")) break;
            within = true;
        }
        at = next_line(at, end);
    }
    return within ? NULL : found;
}

bool content_has_stl_attributes(const char *data, size_t size)
{
    if (size < STL_HEAD) return false;
    const unsigned char *bytes = (const unsigned char *)data, *n = bytes + STL_COUNT_AT;
    const uint64_t count = n[0] | (uint64_t)n[1] << 8 | (uint64_t)n[2] << 16 | (uint64_t)n[3] << 24;
    size_t at = STL_HEAD, more = 0;
    for (uint64_t k = 0; k < count; k++, at += STL_TRIANGLE + more) {
        if (size - at < STL_TRIANGLE) return false;
        more = bytes[at + STL_TRIANGLE - 2] | (size_t)bytes[at + STL_TRIANGLE - 1] << 8;
        if (size - at - STL_TRIANGLE < more) return false;
    }
    return at == size && size > STL_HEAD + STL_TRIANGLE * count;
}

static const char *end_of_stl(const char *data, size_t size)
{
    uint64_t whole = UINT64_MAX;
    if (size >= STL_HEAD) {
        const unsigned char *n = (const unsigned char *)data + STL_COUNT_AT;
        whole = STL_HEAD +
                STL_TRIANGLE * (n[0] | (uint64_t)n[1] << 8 | (uint64_t)n[2] << 16 | (uint64_t)n[3] << 24);
    }
    if (whole == size) return NULL;
    const char *end = data + size, *first = skip_blanks(data, end);
    if (begins_with(first, end, "solid")) return end_of_solids(first, end);
    /* no count, or triangles with attributes: the reader follows them to the end */
    return whole > STL_HEAD && whole < size && !content_has_stl_attributes(data, size) ? data + whole : NULL;
}

/* The line at `at`, or the first after it, that holds something but a comment. */
static const char *line_with_content(const char *at, const char *end)
{
    while ((at = skip_blanks(at, end)) < end && *at == '#') at = next_line(at, end);
    return at;
}

/* The end of a text with one line for each vertex and face. */
static const char *end_of_off(const char *data, size_t size)
{
    const char *end = data + size, *at = line_with_content(data, end);
    char line[128];
    for (int k = 0; k < 2; k++) { /* the counts follow the word, or are on the next line */
        const char *stop = next_line(at, end);
        size_t length = (size_t)(stop - at) < sizeof line ? (size_t)(stop - at) : sizeof line - 1;
        memcpy(line, at, length);
        line[length] = 0;
        char *numbers = k == 0 ? strstr(line, "OFF") : line, *rest;
        if (!numbers || strstr(line, "BINARY") || (k == 0 && strstr(line, "nOFF"))) return NULL;
        if (k == 0) numbers += strlen("OFF");
        unsigned long long vertices = strtoull(numbers, &rest, 10), faces = strtoull(rest, NULL, 10);
        at = line_with_content(stop, end);
        if (rest == numbers) continue;
        if (vertices > size || faces > size) return NULL;
        for (unsigned long long n = vertices + faces; n > 0 && at < end; n--)
            at = line_with_content(next_line(at, end), end);
        return at;
    }
    return NULL;
}

/* The end of the elements of a PLY file. */
static const char *end_of_ply(const char *data, size_t size)
{
    ply_header h;
    if (!ply_header_read(data, size, &h)) return NULL;
    ply_rows r = ply_rows_begin(&h, data, size);
    for (int k = 0; k < h.elements; k++) {
        ply_rows_enter(&r, &h.element[k]);
        if (!ply_rows_skip(&r)) return NULL;
    }
    return r.at;
}

size_t content_end(const char *ending, const char *data, size_t size)
{
    static const char *(*const finders[FILE_FORMATS])(const char *data, size_t size) = {
        [FILE_FORMAT_STL] = end_of_stl, [FILE_FORMAT_OFF] = end_of_off, [FILE_FORMAT_PLY] = end_of_ply};
    const file_format format = file_format_of_name(ending);
    const char *end = finders[format] ? finders[format](data, size) : NULL;
    return end ? (size_t)(end - data) : size;
}

bool content_follows(const char *data, size_t size, size_t end)
{
    while (end < size && (is_blank(data[end]) || !data[end])) end++;
    return end < size;
}

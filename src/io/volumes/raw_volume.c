// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/raw_volume.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "base/core/precision.h"
#include "io/volumes/volume_header.h"
#include "io/volumes/inflated.h"
#include "io/volumes/numbers.h"

/* Maximum ratio of unpacked to packed bytes of zlib. */
static const int64_t most_packed = 1032;

enum { BUFFER = 1 << 16 };

typedef struct raw_volume {
    slices base; /* first: the slices' functions get this pointer */
    volume_header head;
    const char *path;
    const slices_files *files;
    int fd;               /* descriptor of the header's file, owned by the caller */
    char *text;           /* names of the data files, as one text */
    char **names;         /* address of each name in `text` */
    uint32_t at;          /* index of the open data file */
    int64_t left;         /* number of values left in the open file */
    int data;             /* descriptor of the open data file, or -1 */
    inflated *unpacked;   /* decompressor; NULL: the data are not packed */
    int64_t offset;       /* offset of the next byte of the data, after they are unpacked */
    int64_t packed_begin; /* offset of packed data in their file */
    size_t filled, used;
    char buffer[BUFFER + 16];
} raw_volume;

static int size_of(const volume_header *h)
{
    return (int)number_bytes((number_type)h->type);
}

static const char *name_at(const raw_volume *s)
{
    return s->head.file_count ? s->names[s->at] : s->path;
}

static bool damaged(const raw_volume *s, error *e, const char *what)
{
    return error_set(e, ERROR_INPUT_DAMAGED, "%s%s%s", s->head.file_count ? name_at(s) : "",
                     s->head.file_count ? ": " : "", what);
}

static void close_data(raw_volume *s)
{
    inflated_free(s->unpacked);
    if (s->data >= 0) close(s->data);
    s->unpacked = NULL;
    s->data = -1;
    s->filled = s->used = 0;
}

/* ---- bytes */

/* Reads up to `count` bytes. Returns the number of bytes read, less than `count` only at the end; -1:
 * error. */
static int64_t fill(raw_volume *s, void *to, int64_t count)
{
    int64_t done = 0;
    while (done < count) {
        int64_t step = count - done < INT32_MAX / 2 ? count - done : INT32_MAX / 2, got;
        if (s->unpacked)
            got = inflated_read(s->unpacked, (char *)to + done, step);
        else
            got = pread(s->data, (char *)to + done, (size_t)step, (off_t)s->offset);
        if (got < 0 && !s->unpacked && errno == EINTR) continue;
        if (got < 0) return -1;
        if (got == 0) break;
        done += got;
        s->offset += got;
    }
    return done;
}

static bool skip(raw_volume *s, int64_t count, error *e)
{
    if (!s->unpacked) {
        s->offset += count;
        return true;
    }
    while (count > 0) {
        int64_t step = count < BUFFER ? count : BUFFER;
        if (fill(s, s->buffer, step) != step)
            return damaged(s, e,
                           "the file ends before its data begin: it is damaged. Copy or save it again.");
        count -= step;
    }
    return true;
}

static bool skip_lines(raw_volume *s, error *e)
{
    uint32_t lines = s->head.line_skip;
    while (lines > 0) {
        int64_t got = fill(s, s->buffer, BUFFER);
        if (got <= 0)
            return damaged(
                s, e,
                "the file has fewer lines than its header states for lines to skip: correct its header");
        char *p = s->buffer, *end = s->buffer + got;
        while (lines > 0 && (p = memchr(p, '\n', (size_t)(end - p)))) {
            p++;
            if (--lines == 0) s->offset -= end - p;
        }
    }
    return true;
}

static void start_unpacking(raw_volume *s)
{
    if (s->head.encoding != VOLUME_HEADER_GZIP) return;
    s->unpacked = inflated_new(s->data, s->offset);
    s->packed_begin = s->offset;
    s->offset = 0;
}

/* The length of packed data, which are unpacked once to find it; -1: error. */
static int64_t unpacked_length(raw_volume *s)
{
    int64_t length = 0, got;
    while ((got = fill(s, s->buffer, BUFFER)) > 0) length += got;
    inflated_rewind(s->unpacked);
    return got < 0 ? -1 : length;
}

/* Seeks to the first of `needed` bytes of data, which is counted from the end if byte_skip is negative. */
static bool skip_bytes(raw_volume *s, int64_t needed, error *e)
{
    struct stat st;
    if (s->head.byte_skip >= 0) return skip(s, s->head.byte_skip, e);
    int64_t length = 0, start = s->offset;
    if (s->unpacked) {
        length = unpacked_length(s);
        start = 0;
    } else if (fstat(s->data, &st) == 0) {
        length = st.st_size;
    }
    s->offset = 0;
    int64_t at = length - needed + s->head.byte_skip + 1;
    return (at >= start && skip(s, at, e)) ||
           damaged(s, e,
                   "the file has less data than its header states: it is damaged. Copy or save it again.");
}

/* Checks that the file can have `values` values, before any of them is read. */
static bool check_length(const raw_volume *s, int64_t values, error *e)
{
    struct stat st;
    if (fstat(s->data, &st) != 0) return damaged(s, e, "the file cannot be read");
    int64_t have = st.st_size - s->offset, needed = values * size_of(&s->head);
    /* at least a digit and a blank for each value */
    if (s->head.encoding == VOLUME_HEADER_ASCII) needed = 2 * values - 1;
    if (s->head.encoding == VOLUME_HEADER_RAW && s->head.byte_skip > 0) needed += s->head.byte_skip;
    if (s->head.encoding == VOLUME_HEADER_GZIP) needed /= most_packed;
    if (have >= needed) return true;
    char text[200];
    snprintf(text, sizeof text,
             "the file has %lld bytes, but its header states %s%lld (%lld values): it is damaged "
             "or truncated. Copy or save it again.",
             (long long)(have > 0 ? have : 0), s->head.encoding == VOLUME_HEADER_RAW ? "" : "at least ",
             (long long)needed, (long long)values);
    return damaged(s, e, text);
}

static int64_t values_in_all(const raw_volume *s)
{
    return s->head.size[0] * s->head.size[1] * s->head.size[2] * s->base.components;
}

static bool open_data(raw_volume *s, uint32_t index, error *e)
{
    close_data(s);
    s->at = index;
    s->left = values_in_all(s) / (s->head.file_count ? s->head.file_count : 1);
    s->offset = index == 0 ? s->head.offset : 0;
    s->data = s->head.file_count ? s->files->open(s->files->context, s->names[index], e) : dup(s->fd);
    if (s->data < 0)
        return s->head.file_count
                   ? false
                   : error_set(e, ERROR_INTERNAL, "the file cannot be read: %s", strerror(errno));
    if (!skip_lines(s, e) || !check_length(s, s->left, e)) return false;
    start_unpacking(s);
    return skip_bytes(s, s->left * size_of(&s->head), e);
}

/* ---- values */

static bool is_scaled(const raw_volume *s)
{
    return s->head.slope != 1 || s->head.intercept != 0;
}

static bool read_numbers(raw_volume *s, double *values, int64_t count, error *e)
{
    const int size = size_of(&s->head);
    const double slope = s->head.slope, intercept = s->head.intercept;
    while (count > 0) {
        int64_t some = count < BUFFER / size ? count : BUFFER / size;
        if (fill(s, s->buffer, some * size) != some * size)
            return damaged(
                s, e,
                "the file ends before its last value, or is not compressed correctly: it is damaged "
                "or truncated. Copy or save it again.");
        for (int64_t k = 0; k < some; k++) {
            const unsigned char *p = (unsigned char *)s->buffer + k * size;
            if (size == sizeof(int64_t) && !is_scaled(s)) /* scaled values need not be whole */
                numbers_note_inexact(p, (number_type)s->head.type, s->head.swapped, s->base.inexact);
            *values++ = slope * number_value(p, (number_type)s->head.type, s->head.swapped) + intercept;
        }
        count -= some;
    }
    return true;
}

/* Reads the next word of a text file. */
static bool next_word(raw_volume *s, char word[64])
{
    size_t length = 0;
    for (;;) {
        if (s->used == s->filled) {
            int64_t got = fill(s, s->buffer, BUFFER);
            if (got <= 0) break;
            s->filled = (size_t)got;
            s->used = 0;
        }
        char c = s->buffer[s->used++];
        bool blank = c == ' ' || c == '\n' || c == '\t' || c == '\r' || c == ',';
        if (blank && length > 0) break;
        if (!blank && length == 63) return false;
        if (!blank) word[length++] = c;
    }
    word[length] = '\0';
    return length > 0;
}

static bool read_words(raw_volume *s, double *values, int64_t count, error *e)
{
    char word[64], *end;
    const bool single = s->head.type == NUMBER_FLOAT,
               whole = s->head.type == NUMBER_INT64 || s->head.type == NUMBER_UINT64;
    for (int64_t k = 0; k < count; k++) {
        if (!next_word(s, word))
            return damaged(
                s, e,
                "the file ends before its last value: it is damaged or truncated. Copy or save it again.");
        const double number = single ? (double)strtof(word, &end) : strtod(word, &end);
        if (*end) return damaged(s, e, "the file has text among its numbers: it is damaged. Save it again.");
        if (whole && fabs(number) > (double)PRECISION_WHOLE_MOST && !*s->base.inexact && !is_scaled(s))
            snprintf(s->base.inexact, sizeof s->base.inexact, "%.23s", word);
        values[k] = s->head.slope * number + s->head.intercept;
    }
    return true;
}

static bool raw_volume_read(slices *base, int64_t k, double *values, error *e)
{
    raw_volume *s = (raw_volume *)base;
    if (k == 0 && !open_data(s, 0, e)) return false;
    for (int64_t wanted = s->head.size[0] * s->head.size[1] * base->components; wanted > 0;) {
        if (s->left == 0 && !open_data(s, s->at + 1, e)) return false;
        int64_t some = wanted < s->left ? wanted : s->left;
        bool ok = s->head.encoding == VOLUME_HEADER_ASCII ? read_words(s, values, some, e)
                                                          : read_numbers(s, values, some, e);
        if (!ok) return false;
        values += some;
        wanted -= some;
        s->left -= some;
    }
    return true;
}

static void raw_volume_close(slices *base)
{
    raw_volume *s = (raw_volume *)base;
    close_data(s);
    mem_free_texts(s->names, s->head.file_count);
    free(s->text);
    free(s);
}

static const slices_ops raw_volume_ops = {raw_volume_read, raw_volume_close};

/* Converts the names of data files to paths: they are relative to the directory of the header. */
static bool place_files(raw_volume *s, error *e)
{
    const char *slash = strrchr(s->path, '/');
    int folder = slash ? (int)(slash - s->path) + 1 : 0;
    if (s->head.file_count == 0) return true;
    if (values_in_all(s) % s->head.file_count)
        return error_set(e, ERROR_INPUT_DAMAGED,
                         "its %lld values cannot be divided evenly among %u data files: correct its header",
                         (long long)values_in_all(s), s->head.file_count);
    s->names = mem_alloc(s->head.file_count * sizeof *s->names);
    char *name = s->text;
    for (uint32_t k = 0; k < s->head.file_count; k++) {
        char *end = strchr(name, '\n');
        if (!end)
            return error_set(e, ERROR_INPUT_DAMAGED,
                             "the file made its reader return an invalid answer: save it in another format");
        *end = '\0';
        s->names[k] = mem_printf("%.*s%s", *name == '/' ? 0 : folder, s->path, name);
        name = end + 1;
    }
    return true;
}

/* Chooses one of several volumes by its index; -1: none was requested. */
static bool choose_volume(raw_volume *s, int64_t index, error *e)
{
    volume_header *h = &s->head;
    memcpy(s->base.size, h->size, sizeof s->base.size);
    s->base.volumes = h->volumes > 1 ? h->volumes : 1;
    if (!slices_choose_volume(&s->base, &index, e)) return false;
    h->byte_skip += index * h->size[0] * h->size[1] * h->size[2] * size_of(h);
    return true;
}

/* Bytes that follow the first `bytes` of packed data, by the length at the end of a gzip file; 0: unknown. This
 * length is modulo 2^32, and in a file of several members it is that of the last one. */
static int64_t more_packed_bytes(const raw_volume *s, int64_t bytes, int64_t file_bytes)
{
    unsigned char magic[2], end[4];
    if (bytes > INT32_MAX || pread(s->data, magic, 2, (off_t)s->packed_begin) != 2 || magic[0] != 0x1F ||
        magic[1] != 0x8B || pread(s->data, end, 4, (off_t)file_bytes - 4) != 4)
        return 0;
    const int64_t length = end[0] | (int64_t)end[1] << 8 | (int64_t)end[2] << 16 | (int64_t)end[3] << 24;
    return length > bytes ? length - bytes : 0;
}

/* Whether a word follows `values` words of the open file. Moves behind them. */
static bool has_more_words(raw_volume *s, int64_t values)
{
    char word[64];
    while (values-- > 0)
        if (!next_word(s, word)) return false;
    return next_word(s, word);
}

/* Adds a warning if more than a line break follows the data of the open file: a size in the header may be too
 * small. `volumes`: from the chosen one on. Moves in the file. */
static void note_more_data(raw_volume *s, int64_t volumes)
{
    struct stat st;
    if (fstat(s->data, &st) != 0) return;
    const int64_t end = s->offset + volumes * s->left * size_of(&s->head);
    const bool follows = s->head.encoding == VOLUME_HEADER_ASCII  ? has_more_words(s, s->left)
                         : s->head.encoding == VOLUME_HEADER_GZIP ? more_packed_bytes(s, end, st.st_size) > 2
                                                                  : st.st_size - end > 2;
    if (!follows) return;
    dense_warn(&s->base.warnings,
               "more data follow those of %lld x %lld x %lld samples, and are not read. Compare the sizes in "
               "the header with the data.",
               (long long)s->head.size[0], (long long)s->head.size[1], (long long)s->head.size[2]);
}

/* Adds a warning if the length of the data in the header differs from that of the file. Whether all values
 * are present is found only by reading. */
static void note_length(raw_volume *s)
{
    struct stat st;
    const int64_t begin = s->head.offset, said = s->head.packed_bytes;
    if (said == 0 || fstat(s->data, &st) != 0 || st.st_size - begin == said) return;
    dense_warn(&s->base.warnings,
               "its header states %lld bytes of compressed data, but there are %lld; all values are "
               "present",
               (long long)said, (long long)(st.st_size - begin));
}

slices *raw_vectors_open(int fd, const char *path, const char *program, int64_t index,
                         const slices_files *files, error *e)
{
    raw_volume *s = mem_alloc(sizeof *s);
    *s = (raw_volume){.base = {.ops = &raw_volume_ops}, .path = path, .files = files, .fd = fd, .data = -1};
    bool ok = volume_header_read(fd, path, program, &s->head, &s->text, e);
    s->base.components = s->head.components > 1 ? (int)s->head.components : 1;
    if (!ok || !choose_volume(s, index, e) || !place_files(s, e) || !open_data(s, 0, e)) {
        raw_volume_close(&s->base);
        return NULL;
    }
    memcpy(s->base.vector_to_world, s->head.vector_to_world, sizeof s->base.vector_to_world);
    memcpy(s->base.index_to_world, s->head.index_to_world, sizeof s->base.index_to_world);
    strcpy(s->base.format, s->head.format);
    strcpy(s->base.space, s->head.space);
    s->base.type = numbers_name((number_type)s->head.type);
    for (uint32_t k = 0; k < s->head.warnings.count; k++)
        dense_warn(&s->base.warnings, "%s", s->head.warnings.text[k]);
    memcpy(s->base.warnings.no_data, s->head.warnings.no_data, sizeof s->base.warnings.no_data - 1);
    s->base.fine = numbers_need_doubles((number_type)s->head.type);
    note_length(s);
    note_more_data(s, s->base.volumes - (index > 0 ? index : 0));
    return &s->base;
}

slices *raw_volume_open(int fd, const char *path, const char *program, int64_t index,
                        const slices_files *files, error *e)
{
    slices *s = raw_vectors_open(fd, path, program, index, files, e);
    if (!s || s->components == 1) return s;
    error_set(e, ERROR_INPUT_UNSUPPORTED,
              "the file has %d values at each sample: extract one for the surface (`unu slice -a 0 "
              "-p 0` extracts the first), and use the file for an attribute to have all values at "
              "the points",
              s->components);
    s->ops->close(s);
    return NULL;
}

// SPDX-License-Identifier: Apache-2.0
#include "client/stack.h"

#include <errno.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <minizip/zip.h>

#include "base/core/memory.h"
#include "files/file.h"

enum { MOST_PROPERTIES = 256, LONGEST_NAME = 63, NPY_PREAMBLE = 10, BLOCK_RECORDS = 4096 };

/* Types of properties in a PLY file, and in NumPy. */
static const struct {
    const char *ply[2], *numpy;
    size_t bytes;
} types[] = {{{"char", "int8"}, "|i1", 1},     {{"uchar", "uint8"}, "|u1", 1},
             {{"short", "int16"}, "<i2", 2},   {{"ushort", "uint16"}, "<u2", 2},
             {{"int", "int32"}, "<i4", 4},     {{"uint", "uint32"}, "<u4", 4},
             {{"float", "float32"}, "<f4", 4}, {{"double", "float64"}, "<f8", 8}};

typedef struct column {
    char name[LONGEST_NAME + 1];
    size_t type;
} column;

/* The header of a PLY file: its vertices, which come first. */
typedef struct layout {
    column column[MOST_PROPERTIES];
    size_t count;
    size_t points, record; /* number of points; bytes of one */
} layout;

typedef struct texts {
    char **item;
    size_t count;
} texts;

struct stack {
    char *path;
    FILE *records; /* the points of all results, one after another; it has no name */
    layout layout;
    texts names, missing;
    int32_t *frame;
};

static void texts_add(texts *t, const char *text)
{
    t->item = mem_resize(t->item, (t->count + 1) * sizeof *t->item);
    t->item[t->count++] = mem_strdup(text);
}

static void texts_clear(texts *t)
{
    for (size_t i = 0; i < t->count; i++) free(t->item[i]);
    free(t->item);
}

stack *stack_begin(const char *path, error *e)
{
    stack *s = mem_alloc(sizeof *s);
    char *place = mem_printf("%s.XXXXXX", path);
    int fd = mkstemp(place);
    *s = (stack){.path = mem_strdup(path), .records = fd < 0 ? NULL : fdopen(fd, "w+b")};
    if (!s->records) error_set(e, error_code_of_errno(errno), "cannot write %s: %s", path, strerror(errno));
    if (fd >= 0) unlink(place);
    free(place);
    if (s->records) return s;
    if (fd >= 0) close(fd);
    stack_free(s);
    return NULL;
}

void stack_free(stack *s)
{
    if (!s) return;
    if (s->records) fclose(s->records);
    texts_clear(&s->names);
    texts_clear(&s->missing);
    free(s->frame);
    free(s->path);
    free(s);
}

/* Adds the property that a line describes. */
static bool read_property(const char *line, layout *l)
{
    char type[16];
    column *c = &l->column[l->count];
    if (l->count == MOST_PROPERTIES || sscanf(line, "property %15s %63s", type, c->name) != 2) return false;
    for (size_t i = 0; i < sizeof types / sizeof *types; i++) {
        if (strcmp(type, types[i].ply[0]) != 0 && strcmp(type, types[i].ply[1]) != 0) continue;
        c->type = i;
        l->record += types[i].bytes;
        l->count++;
        return true;
    }
    return false;
}

static bool read_header(FILE *ply, layout *l)
{
    char line[1024];
    size_t elements = 0;
    bool good = fgets(line, sizeof line, ply) && strcmp(line, "ply\n") == 0;
    *l = (layout){0};
    while (good && fgets(line, sizeof line, ply)) {
        if (strcmp(line, "end_header\n") == 0) return elements > 0;
        if (strncmp(line, "format ", 7) == 0)
            good = strcmp(line, "format binary_little_endian 1.0\n") == 0;
        else if (strncmp(line, "element ", 8) == 0)
            good = elements++ > 0 || sscanf(line, "element vertex %zu", &l->points) == 1;
        else if (strncmp(line, "property ", 9) == 0 && elements == 1)
            good = read_property(line, l);
    }
    return false;
}

static bool is_same(const layout *a, const layout *b)
{
    bool same = a->count == b->count;
    for (size_t i = 0; same && i < a->count; i++)
        same = a->column[i].type == b->column[i].type && strcmp(a->column[i].name, b->column[i].name) == 0;
    return same;
}

static bool copy_records(FILE *from, FILE *to, size_t bytes)
{
    char block[1 << 16];
    while (bytes > 0) {
        size_t wanted = bytes < sizeof block ? bytes : sizeof block;
        if (fread(block, 1, wanted, from) != wanted || fwrite(block, 1, wanted, to) != wanted) return false;
        bytes -= wanted;
    }
    return true;
}

bool stack_add(stack *s, FILE *ply, const char *name, int frame, error *e)
{
    layout l;
    if (!read_header(ply, &l))
        return error_set(
            e, ERROR_INPUT_DAMAGED,
            "%s: points.ply is not a binary PLY file of hexad: set output.ply.format to \"binary_little_endian\"",
            name);
    if (!s->names.count) s->layout = l;
    if (l.points != s->layout.points)
        return error_set(
            e, ERROR_INPUT_UNSUPPORTED,
            "%s has %zu points, and %s has %zu: a stack requires equal numbers. Set sampling.count", name,
            l.points, s->names.item[0], s->layout.points);
    if (!is_same(&l, &s->layout))
        return error_set(e, ERROR_INPUT_UNSUPPORTED,
                         "%s has other properties than %s: a stack requires the same ones", name,
                         s->names.item[0]);
    if (!copy_records(ply, s->records, l.points * l.record))
        return ferror(s->records)
                   ? error_set(e, error_code_of_errno(errno), "cannot write %s: %s", s->path, strerror(errno))
                   : error_set(e, ERROR_INPUT_DAMAGED, "%s: points.ply ends early", name);
    s->frame = mem_resize(s->frame, (s->names.count + 1) * sizeof *s->frame);
    s->frame[s->names.count] = (int32_t)frame;
    texts_add(&s->names, name);
    return true;
}

void stack_add_missing(stack *s, const char *name)
{
    texts_add(&s->missing, name);
}

bool stack_ids_differ(stack *s)
{
    const layout *l = &s->layout;
    size_t k = 0, offset = 0;
    while (k < l->count && strcmp(l->column[k].name, "id") != 0) offset += types[l->column[k++].type].bytes;
    if (k == l->count) return false;
    const size_t bytes = types[l->column[k].type].bytes, all = s->names.count * l->points;
    char *ids = mem_alloc(l->points * bytes), *record = mem_alloc(l->record);
    bool differ = false;
    rewind(s->records);
    for (size_t i = 0; !differ && i < all && fread(record, l->record, 1, s->records) == 1; i++) {
        char *id = ids + i % l->points * bytes;
        if (i < l->points) memcpy(id, record + offset, bytes);
        differ = memcmp(id, record + offset, bytes) != 0;
    }
    free(ids);
    free(record);
    return differ;
}

/* ---- the archive */

static bool put(zipFile archive, const void *bytes, size_t size)
{
    return zipWriteInFileInZip(archive, bytes, (unsigned)size) == ZIP_OK;
}

/* Begins an array of `bytes` bytes: an entry of the archive, with the header of a .npy file, version 1.0. */
static bool begin_array(zipFile archive, const char *name, const char *type, const char *shape, size_t bytes)
{
    static const zip_fileinfo no_date = {.tmz_date = {.tm_mday = 1, .tm_year = 1980}};
    char text[192], *entry = mem_printf("%s.npy", name);
    char head[NPY_PREAMBLE] = "\x93NUMPY\x01";
    int n =
        snprintf(text, sizeof text, "{'descr': '%s', 'fortran_order': False, 'shape': (%s), }", type, shape);
    size_t length = ((size_t)n + 1 + NPY_PREAMBLE + 63) / 64 * 64 - NPY_PREAMBLE;
    memset(text + n, ' ', length - (size_t)n);
    text[length - 1] = '\n';
    head[8] = (char)length;
    bool good = zipOpenNewFileInZip64(archive, entry, &no_date, NULL, 0, NULL, 0, NULL, 0, 0,
                                      bytes + length >= UINT32_MAX) == ZIP_OK &&
                put(archive, head, NPY_PREAMBLE) && put(archive, text, length);
    free(entry);
    return good;
}

/* Writes `width` columns from number `first` as one array. */
static bool write_columns(zipFile archive, const stack *s, const char *name, size_t first, size_t width)
{
    const layout *l = &s->layout;
    const size_t bytes = types[l->column[first].type].bytes * width, all = s->names.count * l->points;
    char shape[80];
    size_t offset = 0;
    for (size_t i = 0; i < first; i++) offset += types[l->column[i].type].bytes;
    snprintf(shape, sizeof shape, width > 1 ? "%zu, %zu, %zu" : "%zu, %zu", s->names.count, l->points, width);
    char *block = mem_alloc(BLOCK_RECORDS * (l->record + bytes)), *out = block + BLOCK_RECORDS * l->record;
    bool good = begin_array(archive, name, types[l->column[first].type].numpy, shape, all * bytes);
    rewind(s->records);
    for (size_t done = 0; good && done < all;) {
        size_t count = all - done < BLOCK_RECORDS ? all - done : BLOCK_RECORDS;
        good = fread(block, l->record, count, s->records) == count;
        for (size_t k = 0; k < count; k++) memcpy(out + k * bytes, block + k * l->record + offset, bytes);
        good = good && put(archive, out, count * bytes);
        done += count;
    }
    free(block);
    return good && zipCloseFileInZip(archive) == ZIP_OK;
}

/* Whether three columns from number `first` have these names and the same type. */
static bool is_vector(const layout *l, size_t first, const char *const names[3])
{
    bool is = first + 3 <= l->count;
    for (size_t i = 0; is && i < 3; i++)
        is = strcmp(l->column[first + i].name, names[i]) == 0 &&
             l->column[first + i].type == l->column[first].type;
    return is;
}

static bool write_points(zipFile archive, const stack *s)
{
    static const struct {
        const char *name, *columns[3];
    } vectors[] = {{"positions", {"x", "y", "z"}}, {"normals", {"nx", "ny", "nz"}}};
    bool good = true;
    for (size_t i = 0, width; good && i < s->layout.count; i += width) {
        const char *name = s->layout.column[i].name;
        width = 1;
        for (size_t k = 0; k < sizeof vectors / sizeof *vectors; k++)
            if (is_vector(&s->layout, i, vectors[k].columns)) {
                name = vectors[k].name;
                width = 3;
            }
        good = write_columns(archive, s, name, i, width);
    }
    return good;
}

/* Code points of a text in UTF-8. A byte that is not part of a character counts as U+FFFD. Returns their
 * number; `out` NULL: only counts. */
static size_t decode(const char *text, uint32_t *out)
{
    size_t count = 0;
    for (const unsigned char *t = (const unsigned char *)text; *t; count++) {
        size_t more = *t >= 0xF0 && *t < 0xF8 ? 3 : *t >= 0xE0 ? 2 : *t >= 0xC0 ? 1 : 0, k = 1;
        uint32_t code = more ? *t & (0x3Fu >> more) : *t;
        while (k <= more && (t[k] & 0xC0) == 0x80) code = code << 6 | (t[k++] & 0x3F);
        bool whole = k > more && *t < 0xF8 && (*t & 0xC0) != 0x80;
        if (out) out[count] = whole ? code : 0xFFFD;
        t += whole ? more + 1 : 1;
    }
    return count;
}

/* Writes texts as an array of NumPy's type U, which has 32 bits for each character. */
static bool write_texts(zipFile archive, const char *name, const texts *t)
{
    size_t longest = 1;
    char type[32], shape[32];
    for (size_t i = 0; i < t->count; i++) {
        size_t length = decode(t->item[i], NULL);
        if (length > longest) longest = length;
    }
    snprintf(type, sizeof type, "<U%zu", longest);
    snprintf(shape, sizeof shape, "%zu,", t->count);
    uint32_t *codes = mem_alloc(longest * sizeof *codes);
    bool good = begin_array(archive, name, type, shape, t->count * longest * sizeof *codes);
    for (size_t i = 0; good && i < t->count; i++) {
        memset(codes, 0, longest * sizeof *codes);
        decode(t->item[i], codes);
        good = put(archive, codes, longest * sizeof *codes);
    }
    free(codes);
    return good && zipCloseFileInZip(archive) == ZIP_OK;
}

static bool write_frames(zipFile archive, const stack *s)
{
    char shape[32];
    size_t bytes = s->names.count * sizeof *s->frame;
    snprintf(shape, sizeof shape, "%zu,", s->names.count);
    return begin_array(archive, "frames", "<i4", shape, bytes) && put(archive, s->frame, bytes) &&
           zipCloseFileInZip(archive) == ZIP_OK;
}

bool stack_write(stack *s, error *e)
{
    store_file file = {0};
    if (!s->names.count) return true;
    if (!store_file_begin(s->path, &file, e)) return false;
    zipFile archive = zipOpen64(file.temporary, APPEND_STATUS_CREATE);
    bool good = archive && write_points(archive, s) && write_frames(archive, s) &&
                write_texts(archive, "names", &s->names) && write_texts(archive, "missing", &s->missing);
    int why = errno;
    if (archive && zipClose(archive, NULL) != ZIP_OK && good) {
        why = errno;
        good = false;
    }
    if (good) return store_file_commit(&file, e);
    store_file_abort(&file);
    return error_set(e, error_code_of_errno(why), "cannot write %s: %s", s->path, strerror(why));
}

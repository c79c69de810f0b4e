// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/exr_reader.h"

#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define IMATH_HALF_NO_LOOKUP_TABLE
#include <half.h>
#include <openexr.h>

#include "base/core/error.h"
#include "base/core/file_format.h"
#include "base/core/reader.h"
#include "base/core/transfer.h"
#include "io/volumes/dwa_image.h"

/* Maximum number of open descriptors: three standard ones, one for a slice, and one for temporary use by the
 * libraries. */
enum { DESCRIPTORS = 5 };

typedef struct image {
    int fd;
    size_t memory;              /* memory limit for the pixels */
    const char *channel, *part; /* NULL: the only one */
    exr_context_t file;
    int part_index;
    const char *found; /* full name of the chosen channel, as in the file */
    bool whole;        /* the channel has whole numbers */
    exr_storage_t storage;
    exr_attr_box2i_t window;
    uint32_t *values; /* pixels of the data window: floats as bits, or whole numbers */
    error fault;
} image;

/* The last message of the library, which reports errors only through a callback without context. */
static char complaint[256];

static void note_complaint(exr_const_context_t file, exr_result_t code, const char *message)
{
    (void)file, (void)code;
    if (!*complaint) snprintf(complaint, sizeof complaint, "%s", message);
}

static int64_t file_size(exr_const_context_t file, void *data)
{
    struct stat st;
    (void)file;
    return fstat(((image *)data)->fd, &st) == 0 ? st.st_size : -1;
}

static int64_t read_at(exr_const_context_t file, void *data, void *to, uint64_t size, uint64_t offset,
                       exr_stream_error_func_ptr_t fail)
{
    (void)file, (void)fail;
    return transfer_read_at(((image *)data)->fd, to, size, offset);
}

static bool damaged(image *m, const char *what)
{
    if (m->fault.code == ERROR_NONE)
        error_set(&m->fault, ERROR_INPUT_DAMAGED, "%s%s%s", what, *complaint ? ": " : "", complaint);
    return false;
}

/* ---- choice of part and channel */

static void append(char *list, size_t size, const char *word)
{
    size_t n = strlen(list);
    snprintf(list + n, size - n, "%s%s", n ? ", " : "", word);
}

static const char *name_of(const image *m, int part)
{
    const char *name = NULL;
    return exr_get_name(m->file, part, &name) == EXR_ERR_SUCCESS && name ? name : "";
}

static bool is_wanted(const image *m, const char *channel, int channels)
{
    return m->channel ? strcmp(channel, m->channel) == 0 : channels == 1;
}

/* Returns the requested channel of a part, or NULL. *of_part: the names of all channels of the part. */
static const exr_attr_chlist_entry_t *find_channel(const image *m, int part, char *of_part, size_t size)
{
    const exr_attr_chlist_t *list;
    const exr_attr_chlist_entry_t *found = NULL;
    if (exr_get_channels(m->file, part, &list) != EXR_ERR_SUCCESS) return NULL;
    for (int k = 0; k < list->num_channels; k++) {
        append(of_part, size, list->entries[k].name.str);
        if (is_wanted(m, list->entries[k].name.str, list->num_channels)) found = &list->entries[k];
    }
    return found;
}

static bool no_part(image *m, int wanted, int found, const char *parts, const char *with,
                    const char *channels)
{
    if (wanted == 0)
        error_set(&m->fault, ERROR_GRID_MISSING, "the file has no part \"%.200s\": choose one of %s", m->part,
                  parts);
    else if (found > 1)
        error_set(&m->fault, ERROR_GRID_AMBIGUOUS,
                  "%d parts of the file have %s (%s): choose one with exr.part", found,
                  m->channel ? "that channel" : "just one channel", with);
    else if (m->channel)
        error_set(&m->fault, ERROR_GRID_MISSING, "the file has no channel \"%.200s\": choose one of %s",
                  m->channel, channels);
    else
        error_set(&m->fault, ERROR_GRID_AMBIGUOUS,
                  "the file has the channels %s: choose one with exr.channel", channels);
    return false;
}

static bool choose(image *m)
{
    /* `with`: names of the parts that have the channel */
    char parts[256] = "", with[256] = "", channels[256] = "";
    int count = 0, wanted = 0, found = 0;
    exr_get_count(m->file, &count);
    for (int part = 0; part < count; part++) {
        char quoted[80];
        snprintf(quoted, sizeof quoted, "\"%.70s\"", name_of(m, part));
        append(parts, sizeof parts, quoted);
        if (m->part && strcmp(name_of(m, part), m->part) != 0) continue;
        wanted++;
        const exr_attr_chlist_entry_t *channel = find_channel(m, part, channels, sizeof channels);
        if (!channel) continue;
        append(with, sizeof with, quoted);
        if (found++ > 0) continue;
        m->part_index = part;
        m->found = channel->name.str;
        m->whole = channel->pixel_type == EXR_PIXEL_UINT;
        if (channel->x_sampling != 1 || channel->y_sampling != 1)
            return error_set(
                &m->fault, ERROR_INPUT_UNSUPPORTED,
                "channel \"%s\" is subsampled by %d x %d: save it with one sample for each pixel",
                channel->name.str, channel->x_sampling, channel->y_sampling);
    }
    return found == 1 || no_part(m, wanted, found, parts, with, channels);
}

/* Refuses the file if it has another known format. */
static bool refuse_other(image *m)
{
    const char *other = file_formats[file_format_of_file(m->fd, "")].as_image;
    if (other) error_set(&m->fault, ERROR_INPUT_UNSUPPORTED, "%s", other);
    return other != NULL;
}

static bool open_file(image *m)
{
    exr_context_initializer_t with = EXR_DEFAULT_CONTEXT_INITIALIZER;
    with.error_handler_fn = note_complaint;
    with.user_data = m;
    with.read_fn = read_at;
    with.size_fn = file_size;
    complaint[0] = '\0';
    if (refuse_other(m)) return false;
    if (exr_start_read(&m->file, "slice", &with) != EXR_ERR_SUCCESS)
        return damaged(m, "the file is not an OpenEXR file, or its header is damaged: save it again");
    return true;
}

/* ---- list of parts and channels */

static void list_channel(const image *m, int part, const exr_attr_chlist_entry_t *channel, FILE *out)
{
    static const char *const storages[] = {"scanlines", "tiles", "deep scanlines", "deep tiles"};
    static const char *const types[] = {"uint", "half", "float"};
    exr_storage_t storage = EXR_STORAGE_LAST_TYPE;
    exr_attr_box2i_t w = {0};
    unsigned type = (unsigned)channel->pixel_type;
    exr_get_storage(m->file, part, &storage);
    exr_get_data_window(m->file, part, &w);
    bool known = (unsigned)storage < sizeof storages / sizeof *storages;
    fprintf(out, "%s\t%s\t%d\t%d\t%d\t%d\t%s\t%s\n", name_of(m, part), known ? storages[storage] : "unknown",
            w.min.x, w.min.y, w.max.x, w.max.y, channel->name.str,
            type < sizeof types / sizeof *types ? types[type] : "unknown");
}

/* Lists the channels as text. The caller frees it. */
static char *list_channels(const image *m)
{
    char *text = NULL;
    size_t length = 0;
    int parts = 0;
    FILE *out = open_memstream(&text, &length);
    if (!out) return NULL;
    exr_get_count(m->file, &parts);
    for (int part = 0; part < parts; part++) {
        const exr_attr_chlist_t *list;
        if (exr_get_channels(m->file, part, &list) != EXR_ERR_SUCCESS) continue;
        for (int k = 0; k < list->num_channels && ftell(out) < EXR_READER_LIST_MAX / 2; k++)
            list_channel(m, part, &list->entries[k], out);
    }
    fclose(out);
    return text;
}

static bool open_image(image *m)
{
    if (!open_file(m) || !choose(m)) return false;
    if (exr_get_storage(m->file, m->part_index, &m->storage) != EXR_ERR_SUCCESS ||
        exr_get_data_window(m->file, m->part_index, &m->window) != EXR_ERR_SUCCESS)
        return damaged(m, "the header of the file is damaged: save it again");
    if (m->storage != EXR_STORAGE_SCANLINE && m->storage != EXR_STORAGE_TILED) {
        error_set(&m->fault, ERROR_INPUT_UNSUPPORTED,
                  "part \"%.200s\" is deep (several samples per pixel): flatten it to one value per pixel",
                  name_of(m, m->part_index));
        return false;
    }
    return true;
}

/* ---- pixels */

static int64_t width_of(const image *m)
{
    return (int64_t)m->window.max.x - m->window.min.x + 1;
}

static int64_t height_of(const image *m)
{
    return (int64_t)m->window.max.y - m->window.min.y + 1;
}

/* Bytes of a row of a channel in a decoded chunk. A channel may have fewer samples than the image. */
static size_t row_bytes(const exr_coding_channel_info_t *c, int64_t row)
{
    if (c->y_samples > 1 && row % c->y_samples != 0) return 0;
    return (size_t)c->width * (size_t)c->bytes_per_element;
}

static uint32_t number_at(const uint8_t *p, uint16_t type)
{
    uint32_t bits = p[0] | (uint32_t)p[1] << 8;
    if (type == EXR_PIXEL_HALF) {
        const float value = imath_half_to_float((imath_half_bits_t)bits);
        memcpy(&bits, &value, sizeof bits);
        return bits;
    }
    return bits | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

/* Where the values of a chunk are stored. */
typedef struct target {
    const image *m;
    uint32_t *to; /* address of the chunk's first pixel */
} target;

/* Replaces the library's unpacking. For some layouts, version 3.1.5 writes all channels even if one is
 * requested. If a channel has fewer samples, it reads the other channels at wrong offsets, also beyond the
 * end of the chunk. In a decoded chunk, rows are consecutive, and each row has its channels one after the
 * other. */
static exr_result_t take_channel(exr_decode_pipeline_t *d)
{
    const target *t = d->decoding_user_data;
    const uint8_t *from = d->unpacked_buffer;
    size_t left = d->chunk.unpacked_size;
    for (int32_t row = 0; row < d->chunk.height; row++)
        for (int k = 0; k < d->channel_count; k++) {
            const exr_coding_channel_info_t *c = &d->channels[k];
            size_t bytes = row_bytes(c, (int64_t)d->chunk.start_y + row);
            uint32_t *to = t->to + row * width_of(t->m);
            if (bytes > left) return EXR_ERR_CORRUPT_CHUNK;
            if (bytes > 0 && is_wanted(t->m, c->channel_name, d->channel_count))
                for (int32_t x = 0; x < c->width; x++)
                    to[x] = number_at(from + (size_t)x * (size_t)c->bytes_per_element, c->data_type);
            from += bytes;
            left -= bytes;
        }
    return EXR_ERR_SUCCESS;
}

/* Decodes one chunk, whose first pixel is (x, y) in the data window. */
static bool decode(image *m, const exr_chunk_info_t *chunk, int64_t x, int64_t y)
{
    exr_decode_pipeline_t d = EXR_DECODE_PIPELINE_INITIALIZER;
    target to = {m, m->values + y * width_of(m) + x};
    bool ok = x + chunk->width <= width_of(m) && y + chunk->height <= height_of(m) &&
              /* the library does not check this */
              (chunk->compression != EXR_COMPRESSION_NONE || chunk->packed_size == chunk->unpacked_size) &&
              exr_decoding_initialize(m->file, m->part_index, chunk, &d) == EXR_ERR_SUCCESS;
    ok = ok && exr_decoding_choose_default_routines(m->file, m->part_index, &d) == EXR_ERR_SUCCESS;
    if (ok) {
        d.decoding_user_data = &to;
        d.unpack_and_convert_fn = take_channel;
        /* a chunk that compression did not make smaller is stored raw; for B44 the library ignores this */
        if (chunk->packed_size == chunk->unpacked_size) d.decompress_fn = NULL;
        ok = exr_decoding_run(m->file, m->part_index, &d) == EXR_ERR_SUCCESS;
    }
    exr_decoding_destroy(m->file, &d);
    return ok;
}

static bool decode_rows(image *m)
{
    int32_t rows = 0;
    char where[80];
    if (exr_get_scanlines_per_chunk(m->file, m->part_index, &rows) != EXR_ERR_SUCCESS || rows < 1)
        return damaged(m, "the header of the file is damaged: save it again");
    for (int64_t y = 0; y < height_of(m); y += rows) {
        exr_chunk_info_t chunk;
        snprintf(where, sizeof where, "its rows from %lld on are missing or damaged",
                 (long long)(m->window.min.y + y));
        if (exr_read_scanline_chunk_info(m->file, m->part_index, (int)(m->window.min.y + y), &chunk) !=
                EXR_ERR_SUCCESS ||
            !decode(m, &chunk, 0, chunk.start_y - (int64_t)m->window.min.y))
            return damaged(m, where);
    }
    return true;
}

static bool decode_tiles(image *m)
{
    int32_t wide = 0, high = 0;
    char where[80];
    if (exr_get_tile_sizes(m->file, m->part_index, 0, 0, &wide, &high) != EXR_ERR_SUCCESS || wide < 1 ||
        high < 1)
        return damaged(m, "the header of the file is damaged: save it again");
    for (int64_t y = 0; y * high < height_of(m); y++)
        for (int64_t x = 0; x * wide < width_of(m); x++) {
            exr_chunk_info_t chunk;
            snprintf(where, sizeof where, "its tile (%lld, %lld) is missing or damaged", (long long)x,
                     (long long)y);
            if (exr_read_tile_chunk_info(m->file, m->part_index, (int)x, (int)y, 0, 0, &chunk) !=
                    EXR_ERR_SUCCESS ||
                !decode(m, &chunk, x * wide, y * high))
                return damaged(m, where);
        }
    return true;
}

static bool read_pixels(image *m)
{
    double count = (double)width_of(m) * (double)height_of(m);
    if (count * sizeof *m->values > (double)m->memory / 2) {
        error_set(&m->fault, ERROR_LIMIT_MEMORY,
                  "the file has %lld x %lld pixels, which exceed the memory limit: raise limits.memory_mb",
                  (long long)width_of(m), (long long)height_of(m));
        return false;
    }
    m->values = calloc((size_t)count, sizeof *m->values);
    if (!m->values) return damaged(m, "the file exceeds the memory limit: raise limits.memory_mb");
    exr_compression_t packed = EXR_COMPRESSION_NONE;
    exr_get_compression(m->file, m->part_index, &packed);
    if (packed == EXR_COMPRESSION_DWAA || packed == EXR_COMPRESSION_DWAB) {
        const int32_t low[2] = {m->window.min.x, m->window.min.y},
                      high[2] = {m->window.max.x, m->window.max.y};
        return dwa_image_read(m->fd, m->part_index, m->found, m->whole, low, high, m->values, &m->fault);
    }
    return m->storage == EXR_STORAGE_TILED ? decode_tiles(m) : decode_rows(m);
}

/* ---- the program */

static bool answer(image *m, char what)
{
    char *list = NULL;
    bool ok = what == EXR_READER_LIST ? open_file(m) && (list = list_channels(m))
                                      : open_image(m) && (what == EXR_READER_WINDOW || read_pixels(m));
    exr_reader_answer a = {0};
    if (ok && !list) {
        memcpy(a.low, &m->window.min, sizeof a.low);
        memcpy(a.high, &m->window.max, sizeof a.high);
        a.whole = m->whole;
        a.aspect = 1;
        exr_get_pixel_aspect_ratio(m->file, m->part_index, &a.aspect);
    }
    bool written = ok ? reader_answer(&a, sizeof a, list, list ? strnlen(list, EXR_READER_LIST_MAX) : 0)
                      : reader_refuse(m->fault.code, m->fault.message);
    if (written && ok && what == EXR_READER_PIXELS)
        written = reader_write(m->values, (size_t)(width_of(m) * height_of(m)) * sizeof *m->values);
    free(list);
    free(m->values);
    if (m->file) exr_finish(&m->file);
    close(m->fd);
    return written;
}

int exr_reader_main(int argc, char **argv)
{
    size_t memory = reader_limit(argc, argv, DESCRIPTORS);
    if (!memory) return 2;
    char *channel = argv[1], *part = strchr(argv[1], '\n');
    if (!part) return 2;
    *part++ = '\0';
    image asked = {.memory = memory,
                   .channel = *channel == '=' ? channel + 1 : NULL,
                   .part = *part == '=' ? part + 1 : NULL};
    for (;;) {
        image m = asked;
        char what = 0;
        if (!reader_receive(&what, 1, &m.fd) || m.fd < 0)
            _exit(0); /* _exit: freeing the library's memory takes time */
        if (!answer(&m, what)) _exit(1);
    }
}

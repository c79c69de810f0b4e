// SPDX-License-Identifier: Apache-2.0
#include "io/pictures/preview_exr.h"

#include <endian.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include <libdeflate.h>
#include <openexr.h>

#include "base/core/isa.h"
#include "base/core/memory.h"

/* In the order of the file: sorted by name. */
enum { A, B, G, N_X, N_Y, N_Z, P_X, P_Y, P_Z, R, Z, ID, KAPPA, SPACING, CHANNELS };

typedef struct channel {
    const char *name;
    exr_pixel_type_t type;
    int bytes;
    bool is_extra; /* only with all_channels */
} channel;

static const channel channels[CHANNELS] = {
    [A] = {"A", EXR_PIXEL_HALF, 2, false},         [B] = {"B", EXR_PIXEL_HALF, 2, false},
    [G] = {"G", EXR_PIXEL_HALF, 2, false},         [N_X] = {"N.X", EXR_PIXEL_FLOAT, 4, true},
    [N_Y] = {"N.Y", EXR_PIXEL_FLOAT, 4, true},     [N_Z] = {"N.Z", EXR_PIXEL_FLOAT, 4, true},
    [P_X] = {"P.X", EXR_PIXEL_FLOAT, 4, true},     [P_Y] = {"P.Y", EXR_PIXEL_FLOAT, 4, true},
    [P_Z] = {"P.Z", EXR_PIXEL_FLOAT, 4, true},     [R] = {"R", EXR_PIXEL_HALF, 2, false},
    [Z] = {"Z", EXR_PIXEL_FLOAT, 4, false},        [ID] = {"id", EXR_PIXEL_UINT, 4, false},
    [KAPPA] = {"kappa", EXR_PIXEL_FLOAT, 4, true}, [SPACING] = {"spacing", EXR_PIXEL_FLOAT, 4, true},
};

static const struct packing {
    exr_compression_t compression;
    int lines; /* lines per chunk of the file */
} packings[] = {
    [PREVIEW_EXR_NONE] = {EXR_COMPRESSION_NONE, 1},
    [PREVIEW_EXR_RLE] = {EXR_COMPRESSION_RLE, 1},
    [PREVIEW_EXR_ZIPS] = {EXR_COMPRESSION_ZIPS, 1},
    [PREVIEW_EXR_ZIP] = {EXR_COMPRESSION_ZIP, 16},
};

/* The library requires a name although callbacks do the I/O; it occurs in messages only. */
static const char library_name[] = "preview.exr";

/* Lines of a chunk of the file: channel by channel, little-endian. */
typedef struct chunk_lines {
    unsigned char *bytes;
    int lines; /* the last chunk of a picture may have fewer */
} chunk_lines;

/* A line of the picture in a chunk. */
typedef struct line {
    bool all_channels;
    int count, channel[CHANNELS];    /* channels of the file */
    size_t length, offset[CHANNELS]; /* in bytes, by channel */
    unsigned char *bytes;            /* start of the line in the chunk */
    chunk_lines chunk;
    float *depth; /* one per pixel */
} line;

static line line_make(int width, const preview_exr_options *options)
{
    const bool all_channels = options->all_channels;
    line l = {.all_channels = all_channels, .chunk.lines = packings[options->packing].lines};
    for (int c = 0; c < CHANNELS; c++) {
        if (channels[c].is_extra && !all_channels) continue;
        l.channel[l.count++] = c;
        l.offset[c] = l.length;
        l.length += (size_t)width * (size_t)channels[c].bytes;
    }
    l.chunk.bytes = mem_alloc(l.length * (size_t)l.chunk.lines);
    l.depth = mem_alloc((size_t)width * sizeof *l.depth);
    return l;
}

static void line_free(line *l)
{
    free(l->chunk.bytes);
    free(l->depth);
}

static void put_whole(unsigned char *bytes, size_t at, uint32_t value)
{
    uint32_t little = htole32(value);
    memcpy(bytes + 4 * at, &little, sizeof little);
}

static void put_float(unsigned char *bytes, size_t at, double value)
{
    float single = (float)value;
    uint32_t bits;
    memcpy(&bits, &single, sizeof bits);
    put_whole(bytes, at, bits);
}

static void put_half(unsigned char *bytes, size_t at, uint16_t value)
{
    uint16_t little = htole16(value);
    memcpy(bytes + 2 * at, &little, sizeof little);
}

static void fill_with(const line *l, int which, int x, int end, double value)
{
    unsigned char *bytes = l->bytes + l->offset[which];
    for (size_t at = (size_t)x; at < (size_t)end; at++) put_float(bytes, at, value);
}

static void fill_constants(const line *l, const preview_span *s, int x)
{
    unsigned char *ids = l->bytes + l->offset[ID];
    const uint32_t id = s->id;
    for (size_t at = (size_t)x, end = (size_t)s->end; at < end; at++) put_whole(ids, at, id);
    if (!l->all_channels) return;
    fill_with(l, N_X, x, s->end, s->normal.x);
    fill_with(l, N_Y, x, s->end, s->normal.y);
    fill_with(l, N_Z, x, s->end, s->normal.z);
    fill_with(l, KAPPA, x, s->end, s->kappa);
    fill_with(l, SPACING, x, s->end, s->spacing);
}

static void fill_places(const line *l, const image *m, const preview_span *s, int x, int y)
{
    unsigned char *restrict depths = l->bytes + l->offset[Z];
    float *restrict depth = l->depth;
    preview_depths(m, s, x, y, depth + x);
    for (size_t at = (size_t)x, end = (size_t)s->end; at < end; at++)
        put_float(depths, at, (double)depth[at]);
    for (; l->all_channels && x < s->end; x++) {
        vec3 world = camera_to_world(&m->camera, preview_place(m, s, x, y));
        put_float(l->bytes + l->offset[P_X], (size_t)x, world.x);
        put_float(l->bytes + l->offset[P_Y], (size_t)x, world.y);
        put_float(l->bytes + l->offset[P_Z], (size_t)x, world.z);
    }
}

/* Four pixels of four channels each, for shuffles. */
typedef uint16_t quads __attribute__((vector_size(16)));
#define LOW(a, b) __builtin_shufflevector(a, b, 0, 8, 1, 9, 2, 10, 3, 11)
#define HIGH(a, b) __builtin_shufflevector(a, b, 4, 12, 5, 13, 6, 14, 7, 15)

/* Separates the four interleaved channels of the picture, eight pixels at a time. */
static void fill_halves(const line *l, const uint16_t *rgba, int width)
{
    unsigned char *const to[4] = {l->bytes + l->offset[R], l->bytes + l->offset[G], l->bytes + l->offset[B],
                                  l->bytes + l->offset[A]};
    size_t x = 0, count = (size_t)width;
    for (; BYTE_ORDER == LITTLE_ENDIAN && x + 8 <= count; x += 8) {
        quads in[4], rg[2], ba[2];
        memcpy(in, rgba + 4 * x, sizeof in);
        for (int k = 0; k < 2; k++) {
            const quads even = LOW(in[2 * k], in[2 * k + 1]), odd = HIGH(in[2 * k], in[2 * k + 1]);
            rg[k] = LOW(even, odd);
            ba[k] = HIGH(even, odd);
        }
        const quads out[4] = {__builtin_shufflevector(rg[0], rg[1], 0, 1, 2, 3, 8, 9, 10, 11),
                              __builtin_shufflevector(rg[0], rg[1], 4, 5, 6, 7, 12, 13, 14, 15),
                              __builtin_shufflevector(ba[0], ba[1], 0, 1, 2, 3, 8, 9, 10, 11),
                              __builtin_shufflevector(ba[0], ba[1], 4, 5, 6, 7, 12, 13, 14, 15)};
        for (int c = 0; c < 4; c++) memcpy(to[c] + 2 * x, &out[c], sizeof out[c]);
    }
    for (; x < count; x++)
        for (int c = 0; c < 4; c++) put_half(to[c], x, rgba[4 * x + (size_t)c]);
}

static void fill_line(const line *l, const image *m, int y)
{
    const uint16_t *rgba = m->rgba + 4 * (size_t)y * (size_t)m->width;
    if (l->all_channels) /* otherwise only identifiers may be missing in a pixel */
        memset(l->bytes, 0, l->length);
    else
        memset(l->bytes + l->offset[ID], 0, (size_t)m->width * (size_t)channels[ID].bytes);
    fill_halves(l, rgba, m->width);
    for (int x = 0; x < m->width;) {
        preview_span s = preview_span_at(m, x, y);
        if (s.id > 0) {
            fill_constants(l, &s, x);
            fill_places(l, m, &s, x, y);
        } else
            fill_with(l, Z, x, s.end, (double)PREVIEW_FAR);
        x = s.end;
    }
}

/* Fills the lines of the chunk that starts at line y; returns their number. */
static int fill_chunk(line *l, const image *m, int y)
{
    int k = 0;
    for (; k < l->chunk.lines && y + k < m->height; k++) {
        l->bytes = l->chunk.bytes + (size_t)k * l->length;
        fill_line(l, m, y + k);
    }
    return k;
}

/* State of the library's callbacks. */
typedef struct stream {
    FILE *file;
    uint64_t at; /* position in the file */
    error e;     /* the first error, which later ones follow from */
} stream;

/* Keeps the library from writing to standard error. The library may hold its lock, so this must not call the
 * library, not even to find the stream: results carry the code. */
static void on_error(exr_const_context_t context, exr_result_t code, const char *words)
{
    (void)context;
    (void)code;
    (void)words;
}

static bool write_failed(stream *s)
{
    return error_set(&s->e, error_code_of_errno(errno), "EXR file: it cannot be written: %s",
                     strerror(errno));
}

/* The library writes the table of chunks, which is before them, at the end. */
static int64_t on_write(exr_const_context_t context, void *place, const void *bytes, uint64_t count,
                        uint64_t offset, exr_stream_error_func_ptr_t report)
{
    stream *s = place;
    (void)context;
    (void)report; /* see on_error */
    if ((offset != s->at && fseeko(s->file, (off_t)offset, SEEK_SET) != 0) ||
        fwrite(bytes, 1, count, s->file) != count) {
        write_failed(s);
        return -1;
    }
    s->at = offset + count;
    return (int64_t)count;
}

static exr_context_initializer_t initializer(stream *s)
{
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    init.error_handler_fn = on_error;
    init.user_data = s;
    init.write_fn = on_write;
    init.max_image_width = PREVIEW_SIZE_MAX;
    init.max_image_height = PREVIEW_SIZE_MAX;
    return init;
}

/* ---- writing ---- */

/* OpenEXR's convention: row vectors times matrix; the camera's space is left-handed. */
static exr_attr_m44f_t world_to_camera(const camera *c)
{
    vec3 shift = camera_point(c, vec3_make(0, 0, 0));
    return (exr_attr_m44f_t){{(float)c->right.x, (float)c->up.x, (float)c->forward.x, 0, //
                              (float)c->right.y, (float)c->up.y, (float)c->forward.y, 0, //
                              (float)c->right.z, (float)c->up.z, (float)c->forward.z, 0, //
                              (float)shift.x, (float)shift.y, (float)shift.z, 1}};
}

/* Sets a column of worldToNDC: coefficients of the camera's right, up and forward, and the value at the
 * eye. */
static void put_column(const camera *c, vec3 of, double at_eye, int column, float *out)
{
    vec3 shift = camera_point(c, vec3_make(0, 0, 0));
    vec3 world = vec3_axpy(of.x, c->right, vec3_axpy(of.y, c->up, vec3_scale(c->forward, of.z)));
    out[column] = (float)world.x;
    out[4 + column] = (float)world.y;
    out[8 + column] = (float)world.z;
    out[12 + column] = (float)(vec3_dot(of, shift) + at_eye);
}

/* Maps to (0, 0) at the upper left and (1, 1) at the lower right corner of the picture, after division by the
 * fourth coordinate. The third coordinate, which readers discard, increases with depth. */
static exr_attr_m44f_t world_to_ndc(const image *m)
{
    const camera *c = &m->camera;
    double x = c->focal / m->width, y = -c->focal / m->height;
    double middle_x = c->center_x / m->width, middle_y = c->center_y / m->height;
    exr_attr_m44f_t out;
    put_column(c, (vec3){x, 0, c->parallel ? 0 : middle_x}, c->parallel ? middle_x : 0, 0, out.m);
    put_column(c, (vec3){0, y, c->parallel ? 0 : middle_y}, c->parallel ? middle_y : 0, 1, out.m);
    put_column(c, (vec3){0, 0, 1}, c->parallel ? 0 : -1, 2, out.m);
    put_column(c, (vec3){0, 0, c->parallel ? 0 : 1}, c->parallel ? 1 : 0, 3, out.m);
    return out;
}

/* The screen window is the extent of the picture at depth 1. */
static exr_result_t write_required(exr_context_t file, int part, const image *m, preview_exr_packing packing)
{
    const camera *c = &m->camera;
    const exr_attr_box2i_t window = {.max = {.x = m->width - 1, .y = m->height - 1}};
    const exr_attr_v2f_t middle = {.x = (float)((0.5 * m->width - c->center_x) / c->focal),
                                   .y = (float)((c->center_y - 0.5 * m->height) / c->focal)};
    return exr_initialize_required_attr(file, part, &window, &window, 1, &middle,
                                        (float)(m->width / c->focal), EXR_LINEORDER_INCREASING_Y,
                                        packings[packing].compression);
}

static exr_result_t write_head(exr_context_t file, const image *m, const preview_exr_options *options,
                               const line *l)
{
    int part = 0;
    exr_attr_m44f_t to_camera = world_to_camera(&m->camera), to_ndc = world_to_ndc(m);
    exr_result_t r = exr_add_part(file, "preview", EXR_STORAGE_SCANLINE, &part);
    if (!r) r = write_required(file, part, m, options->packing);
    for (int k = 0; !r && k < l->count; k++) {
        const channel *c = &channels[l->channel[k]];
        r = exr_add_channel(file, part, c->name, c->type, EXR_PERCEPTUALLY_LINEAR, 1, 1);
    }
    if (!r) r = exr_attr_set_m44f(file, part, "worldToCamera", &to_camera);
    if (!r) r = exr_attr_set_m44f(file, part, "worldToNDC", &to_ndc);
    return r ? r : exr_write_header(file);
}

/* ---- compression ---- */

/* Level of libdeflate. Levels 1 to 4 differ by a fifth in time, and by 1 % in the size of files. Higher levels take
 * longer. */
enum { ZIP_LEVEL = 2 };

/* The compressor of zip and zips. The library itself calls zlib: with level 6, its default, that takes three times
 * as long for files of the same size. */
typedef struct zip {
    struct libdeflate_compressor *compressor;
    unsigned char *predicted, *compressed; /* each has the size of a chunk */
} zip;

static bool zip_begin(zip *z, size_t bytes)
{
    *z = (zip){libdeflate_alloc_compressor(ZIP_LEVEL), mem_alloc(bytes), mem_alloc(bytes)};
    return z->compressor != NULL;
}

static void zip_free(zip *z)
{
    libdeflate_free_compressor(z->compressor);
    free(z->predicted);
    free(z->compressed);
}

/* The transform of the file format: the bytes of even index, then those of odd index, and of this sequence the
 * differences between consecutive bytes, plus 128. `count` is even. */
ISA_CLONES static void predict(const unsigned char *restrict bytes, size_t count, unsigned char *restrict out)
{
    const size_t half = count / 2;
    out[0] = bytes[0];
    for (size_t i = 1; i < half; i++) out[i] = (unsigned char)(bytes[2 * i] - bytes[2 * i - 2] + 128);
    out[half] = (unsigned char)(bytes[1] - bytes[count - 2] + 128);
    for (size_t i = 1; i < half; i++)
        out[half + i] = (unsigned char)(bytes[2 * i + 1] - bytes[2 * i - 1] + 128);
}

/* A callback of the library. A chunk that does not become smaller is stored without compression. */
static exr_result_t zip_chunk(exr_encode_pipeline_t *encoder)
{
    const zip *z = encoder->encoding_user_data;
    const size_t count = encoder->packed_bytes;
    predict(encoder->packed_buffer, count, z->predicted);
    const size_t made =
        libdeflate_zlib_compress(z->compressor, z->predicted, count, z->compressed, count - 1);
    encoder->compressed_buffer = made > 0 ? z->compressed : encoder->packed_buffer;
    encoder->compressed_bytes = made > 0 ? made : count;
    return EXR_ERR_SUCCESS;
}

static bool is_zip(exr_compression_t compression)
{
    return compression == EXR_COMPRESSION_ZIPS || compression == EXR_COMPRESSION_ZIP;
}

static exr_result_t write_chunk(exr_context_t file, int y, const line *l, zip *z,
                                exr_encode_pipeline_t *encoder)
{
    exr_chunk_info_t chunk;
    bool first = y == 0;
    exr_result_t r = exr_write_scanline_chunk_info(file, 0, y, &chunk);
    if (!r && first) r = exr_encoding_initialize(file, 0, &chunk, encoder);
    if (!r && !first) r = exr_encoding_update(file, 0, &chunk, encoder);
    for (int k = 0; !r && k < encoder->channel_count; k++) {
        exr_coding_channel_info_t *to = &encoder->channels[k];
        int c = l->channel[k];
        to->encode_from_ptr = l->chunk.bytes + l->offset[c];
        to->user_pixel_stride = channels[c].bytes;
        to->user_line_stride = (int32_t)l->length;
        to->user_bytes_per_element = (int16_t)channels[c].bytes;
        to->user_data_type = (uint16_t)channels[c].type;
    }
    if (!r && first) {
        r = exr_encoding_choose_default_routines(file, 0, encoder);
        encoder->encoding_user_data = z;
        if (is_zip((exr_compression_t)chunk.compression)) encoder->compress_fn = zip_chunk;
    }
    return r ? r : exr_encoding_run(file, 0, encoder);
}

static exr_result_t write_chunks(exr_context_t file, const image *m, line *l)
{
    zip z;
    exr_result_t r =
        zip_begin(&z, l->length * (size_t)l->chunk.lines) ? EXR_ERR_SUCCESS : EXR_ERR_OUT_OF_MEMORY;
    exr_encode_pipeline_t encoder = {0};
    for (int y = 0; !r && y < m->height; y += l->chunk.lines) {
        fill_chunk(l, m, y);
        r = write_chunk(file, y, l, &z, &encoder);
    }
    exr_encoding_destroy(file, &encoder);
    zip_free(&z);
    return r;
}

bool preview_exr_write(FILE *file, const image *m, const preview_exr_options *options, error *e)
{
    stream s = {.file = file};
    line l = line_make(m->width, options);
    exr_context_t context = NULL;
    exr_context_initializer_t init = initializer(&s);
    exr_result_t r = exr_start_write(&context, library_name, EXR_WRITE_FILE_DIRECTLY, &init);
    if (!r) r = write_head(context, m, options, &l);
    if (!r) r = write_chunks(context, m, &l);
    if (context) {
        exr_result_t closed = exr_finish(&context);
        if (!r) r = closed;
    }
    line_free(&l);
    if (s.e.code == ERROR_NONE && r)
        error_set(&s.e, ERROR_INTERNAL, "EXR file: %s", exr_get_default_error_message(r));
    if (s.e.code == ERROR_NONE && fflush(file) != 0) write_failed(&s);
    if (s.e.code != ERROR_NONE && e) *e = s.e;
    return s.e.code == ERROR_NONE;
}

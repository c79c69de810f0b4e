// SPDX-License-Identifier: Apache-2.0
#include "picture_readers.h"

#include <png.h>
#include <setjmp.h>
#include <stdlib.h>
#include <string.h>

#include <openexr.h>

#include "base/core/memory.h"
#include "io/points/half.h"

/* ---- PNG ---- */

static void compare_rows(png_structp png, png_infop info, FILE *file, const image *m, unsigned char *row)
{
    png_init_io(png, file);
    png_read_info(png, info);
    if (png_get_image_width(png, info) != (png_uint_32)m->width ||
        png_get_image_height(png, info) != (png_uint_32)m->height || png_get_bit_depth(png, info) != 8 ||
        png_get_color_type(png, info) != PNG_COLOR_TYPE_RGB)
        png_error(png, "another size or type");
    for (int y = 0; y < m->height; y++) {
        png_read_row(png, row, NULL);
        if (memcmp(row, m->rgb + 3 * (size_t)y * (size_t)m->width, 3 * (size_t)m->width) != 0)
            png_error(png, "other pixels");
    }
    png_read_end(png, NULL);
    if (fgetc(file) != EOF) png_error(png, "data behind the end");
}

static void on_error(png_structp png, png_const_charp words)
{
    (void)words;
    png_longjmp(png, 1);
}

bool png_shows(const char *path, const image *m)
{
    FILE *file = fopen(path, "rb");
    unsigned char *row = mem_alloc(3 * (size_t)m->width);
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, NULL, on_error, NULL);
    png_infop info = png_create_info_struct(png);
    volatile bool same = false;
    if (setjmp(png_jmpbuf(png)) == 0) {
        compare_rows(png, info, file, m, row);
        same = true;
    }
    png_destroy_read_struct(&png, &info, NULL);
    free(row);
    fclose(file);
    return same;
}

/* ---- EXR ---- */

/* In the order of the file. */
enum { A, B, G, N_X, N_Y, N_Z, P_X, P_Y, P_Z, R, Z, ID, KAPPA, SPACING, CHANNELS };
static const char *const names[CHANNELS] = {"A",   "B",   "G", "N.X", "N.Y", "N.Z",   "P.X",
                                            "P.Y", "P.Z", "R", "Z",   "id",  "kappa", "spacing"};
static const bool is_extra[CHANNELS] = {[N_X] = true, [N_Y] = true, [N_Z] = true,   [P_X] = true,
                                        [P_Y] = true, [P_Z] = true, [KAPPA] = true, [SPACING] = true};

/* A pixel of a channel: halves as floats. */
typedef union value {
    float real;
    uint32_t whole;
} value;

/* The channels of a picture, all pixels of each. */
static value *expected_values(const image *m)
{
    const size_t all = (size_t)m->width * (size_t)m->height;
    value *to = mem_alloc(CHANNELS * all * sizeof *to);
    float *depth = mem_alloc((size_t)m->width * sizeof *depth);
    for (int y = 0; y < m->height; y++)
        for (int x = 0; x < m->width;) {
            const preview_span s = preview_span_at(m, x, y);
            if (s.id > 0) preview_depths(m, &s, x, y, depth + x);
            for (; x < s.end; x++) {
                const size_t at = (size_t)y * (size_t)m->width + (size_t)x;
                const uint16_t *rgba = m->rgba + 4 * at;
                const int colors[] = {R, G, B, A};
                for (int c = 0; c < 4; c++) to[(size_t)colors[c] * all + at].real = half_to_float(rgba[c]);
                to[ID * all + at].whole = s.id;
                to[Z * all + at].real = s.id > 0 ? depth[x] : (float)PREVIEW_FAR;
                if (s.id == 0) continue;
                const vec3 world = camera_to_world(&m->camera, preview_place(m, &s, x, y));
                for (int k = 0; k < 3; k++) {
                    to[(size_t)(N_X + k) * all + at].real = (float)vec3_get(s.normal, k);
                    to[(size_t)(P_X + k) * all + at].real = (float)vec3_get(world, k);
                }
                to[KAPPA * all + at].real = (float)s.kappa;
                to[SPACING * all + at].real = (float)s.spacing;
            }
        }
    free(depth);
    return to;
}

/* The number of a channel of the file; CHANNELS: the name is unknown. */
static int channel_of(const char *name)
{
    int c = 0;
    while (c < CHANNELS && strcmp(names[c], name) != 0) c++;
    return c;
}

static bool has_head(exr_context_t file, const image *m, const preview_exr_options *options)
{
    static const exr_compression_t packings[] = {EXR_COMPRESSION_NONE, EXR_COMPRESSION_RLE,
                                                 EXR_COMPRESSION_ZIPS, EXR_COMPRESSION_ZIP};
    int parts = 0;
    exr_attr_box2i_t w;
    exr_compression_t compression;
    const exr_attr_chlist_t *list = NULL;
    if (exr_get_count(file, &parts) || parts != 1 || exr_get_data_window(file, 0, &w) ||
        exr_get_compression(file, 0, &compression) || exr_get_channels(file, 0, &list))
        return false;
    bool same = w.min.x == 0 && w.min.y == 0 && w.max.x == m->width - 1 && w.max.y == m->height - 1 &&
                compression == packings[options->packing];
    int found = 0;
    for (int c = 0; same && c < CHANNELS; c++)
        if (options->all_channels || !is_extra[c])
            same = found < list->num_channels && strcmp(list->entries[found++].name.str, names[c]) == 0;
    return same && found == list->num_channels;
}

/* Reads a chunk into `to`, the first line of the first of all channels. */
static exr_result_t read_chunk(exr_context_t file, int y, int width, size_t all, value *to,
                               exr_decode_pipeline_t *decoder)
{
    exr_chunk_info_t chunk;
    exr_result_t r = exr_read_scanline_chunk_info(file, 0, y, &chunk);
    if (!r)
        r = y == 0 ? exr_decoding_initialize(file, 0, &chunk, decoder)
                   : exr_decoding_update(file, 0, &chunk, decoder);
    for (int k = 0; !r && k < decoder->channel_count; k++) {
        exr_coding_channel_info_t *c = &decoder->channels[k];
        const int which = channel_of(c->channel_name);
        if (which == CHANNELS) return EXR_ERR_INVALID_ARGUMENT;
        c->decode_to_ptr = (uint8_t *)(to + (size_t)which * all + (size_t)y * (size_t)width);
        c->user_pixel_stride = c->user_bytes_per_element = sizeof(value);
        c->user_line_stride = width * (int)sizeof(value);
        c->user_data_type = which == ID ? EXR_PIXEL_UINT : EXR_PIXEL_FLOAT;
    }
    if (!r && y == 0) r = exr_decoding_choose_default_routines(file, 0, decoder);
    return r ? r : exr_decoding_run(file, 0, decoder);
}

static void on_exr_error(exr_const_context_t context, exr_result_t code, const char *words)
{
    (void)context, (void)code, (void)words;
}

bool exr_shows(const char *path, const image *m, const preview_exr_options *options)
{
    const size_t all = (size_t)m->width * (size_t)m->height;
    value *expected = expected_values(m), *read = mem_alloc(CHANNELS * all * sizeof *read);
    exr_context_t file = NULL;
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    exr_decode_pipeline_t decoder = {0};
    int32_t lines = 1;
    init.error_handler_fn = on_exr_error;
    bool same = exr_start_read(&file, path, &init) == EXR_ERR_SUCCESS && has_head(file, m, options) &&
                exr_get_scanlines_per_chunk(file, 0, &lines) == EXR_ERR_SUCCESS;
    for (int y = 0; same && y < m->height; y += lines)
        same = read_chunk(file, y, m->width, all, read, &decoder) == EXR_ERR_SUCCESS;
    for (size_t c = 0; same && c < CHANNELS; c++)
        if (options->all_channels || !is_extra[c])
            same = memcmp(expected + c * all, read + c * all, all * sizeof *read) == 0;
    if (file) {
        exr_decoding_destroy(file, &decoder);
        exr_finish(&file);
    }
    free(expected);
    free(read);
    return same;
}

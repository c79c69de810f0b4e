// SPDX-License-Identifier: Apache-2.0
#include "io/images/image_decode.h"

#include <endian.h>
#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <jpeglib.h>

#include <jerror.h>
#include <png.h>

#include "base/core/file_format.h"

/* Limit of one chunk of a PNG file that libpng holds, such as a palette, bytes. Pixels are not held. */
static const png_alloc_size_t chunk_bytes = 1 << 20;

/* An image that is being decoded. */
typedef struct decoding {
    const unsigned char *data;
    size_t size, at;
    const image_limits *limits;
    image_facts *facts;
    error *e;
    unsigned char *pixels; /* owned until image_decode returns */
    png_bytep *rows;       /* owned; PNG */
    jmp_buf leave;
} decoding;

/* Sets the error unless it is set already, and leaves the library. */
_Noreturn static void leave(decoding *d, error_code code, const char *text)
{
    error_set(d->e, code, "%s", text);
    longjmp(d->leave, 1);
}

/* Checks the size, and allocates the pixels, of `bits` for each component. */
static void make_pixels(decoding *d, uint64_t width, uint64_t height, uint32_t bits)
{
    char text[256];
    const uint64_t bytes = 4 * (bits / 8) * width * height; /* both are below 2^31 */
    if (width == 0 || height == 0) leave(d, ERROR_INPUT_DAMAGED, "it has no pixels. Save it again.");
    if (width * height > d->limits->pixels) {
        snprintf(text, sizeof text,
                 "it has %llu x %llu pixels, more than the limit of %llu: save it smaller, or raise "
                 "limits.image_pixels",
                 (unsigned long long)width, (unsigned long long)height,
                 (unsigned long long)d->limits->pixels);
        leave(d, ERROR_INPUT_UNSUPPORTED, text);
    }
    if (bytes / (bits / 8) / 4 / width != height || bytes > d->limits->memory ||
        !(d->pixels = malloc((size_t)bytes))) {
        snprintf(text, sizeof text,
                 "its %llu x %llu pixels require more memory than is left: raise limits.memory_mb",
                 (unsigned long long)width, (unsigned long long)height);
        leave(d, ERROR_LIMIT_MEMORY, text);
    }
    d->facts->width = (uint32_t)width;
    d->facts->height = (uint32_t)height;
    d->facts->bits = bits;
}

/* ---- PNG */

enum { PNG_SIGNATURE = 8, PNG_CHUNK = 12 };

/* Chunks that may be compressed, and are not used. */
static const png_byte ignored_chunks[] = "iCCP\0eXIf\0zTXt\0iTXt\0tEXt";

_Noreturn static void stop_png(png_structp png, png_const_charp text)
{
    decoding *d = png_get_error_ptr(png);
    char whole[200];
    if (strstr(text, "memory"))
        leave(d, ERROR_LIMIT_MEMORY, "reading it requires more memory than is left: raise limits.memory_mb");
    snprintf(whole, sizeof whole, "it is damaged (%.100s). Save it again.", text);
    leave(d, ERROR_INPUT_DAMAGED, whole);
}

static void pass_warning(png_structp png, png_const_charp text)
{
    (void)png, (void)text;
}

static void read_png_bytes(png_structp png, png_bytep to, size_t count)
{
    decoding *d = png_get_io_ptr(png);
    if (count > d->size - d->at) png_error(png, "the file ends early");
    memcpy(to, d->data + d->at, count);
    d->at += count;
}

/* Finds chunks that are not used, by their names. */
static void find_png_chunks(decoding *d)
{
    for (size_t at = PNG_SIGNATURE; d->size - at >= PNG_CHUNK;) {
        uint32_t length;
        memcpy(&length, d->data + at, sizeof length);
        length = be32toh(length);
        d->facts->has_profile |= memcmp(d->data + at + 4, "iCCP", 4) == 0;
        d->facts->has_exif |= memcmp(d->data + at + 4, "eXIf", 4) == 0;
        if (length > d->size - at - PNG_CHUNK) break;
        at += PNG_CHUNK + length;
    }
}

static void read_png_rows(decoding *d, png_structp png, png_infop info)
{
    png_read_info(png, info);
    const uint32_t width = png_get_image_width(png, info), height = png_get_image_height(png, info);
    const int depth = png_get_bit_depth(png, info), type = png_get_color_type(png, info);
    const bool has_holes = png_get_valid(png, info, PNG_INFO_tRNS) != 0;
    make_pixels(d, width, height, depth == 16 ? 16 : 8);
    if (!(d->rows = malloc(height * sizeof *d->rows))) png_error(png, "out of memory");
    for (uint32_t y = 0; y < height; y++)
        d->rows[y] = d->pixels + 4 * (size_t)(depth == 16 ? 2 : 1) * width * y;
    if (type == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(png);
    if (type == PNG_COLOR_TYPE_GRAY && depth < 8) png_set_expand_gray_1_2_4_to_8(png);
    if (has_holes) png_set_tRNS_to_alpha(png);
    if (depth == 16 && htobe16(1) != 1) png_set_swap(png);
    if (!(type & PNG_COLOR_MASK_COLOR)) png_set_gray_to_rgb(png);
    if (!(type & PNG_COLOR_MASK_ALPHA) && !has_holes) png_set_add_alpha(png, 0xFFFF, PNG_FILLER_AFTER);
    png_set_interlace_handling(png);
    png_read_update_info(png, info);
    if (png_get_rowbytes(png, info) != 4 * (size_t)(depth == 16 ? 2 : 1) * width)
        png_error(png, "wrong layout");
    png_read_image(png, d->rows);
    png_read_end(png, NULL);
}

static void read_png(decoding *d)
{
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, d, stop_png, pass_warning);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    if (!info) {
        error_set(d->e, ERROR_LIMIT_MEMORY,
                  "reading it requires more memory than is left: raise limits.memory_mb");
    } else if (setjmp(d->leave) == 0) {
        find_png_chunks(d);
        png_set_read_fn(png, d, read_png_bytes);
        png_set_user_limits(png, PNG_UINT_31_MAX, PNG_UINT_31_MAX); /* make_pixels checks the product */
        png_set_chunk_malloc_max(png, chunk_bytes);
        png_set_keep_unknown_chunks(png, PNG_HANDLE_CHUNK_NEVER, ignored_chunks, sizeof ignored_chunks / 5);
        read_png_rows(d, png, info);
    }
    png_destroy_read_struct(&png, &info, NULL);
}

/* ---- JPEG */

typedef struct jpeg_state {
    struct jpeg_decompress_struct jpeg;
    struct jpeg_error_mgr errors;
    struct jpeg_progress_mgr progress;
    decoding *d;
} jpeg_state;

_Noreturn static void stop_jpeg(j_common_ptr jpeg)
{
    jpeg_state *s = (jpeg_state *)jpeg->client_data;
    char text[JMSG_LENGTH_MAX], whole[JMSG_LENGTH_MAX + 64];
    const int code = jpeg->err->msg_code;
    jpeg->err->format_message(jpeg, text);
    if (code == JERR_OUT_OF_MEMORY)
        leave(s->d, ERROR_LIMIT_MEMORY,
              "reading it requires more memory than is left: raise limits.memory_mb");
    const bool is_unsupported = code == JERR_SOF_UNSUPPORTED || code == JERR_BAD_PRECISION ||
                                code == JERR_CONVERSION_NOTIMPL || code == JERR_NOT_COMPILED ||
                                code == JERR_ARITH_NOTIMPL;
    snprintf(
        whole, sizeof whole,
        is_unsupported
            ? "it is a JPEG image of a kind that is not read (%.150s). Save it as baseline or progressive."
            : "it is damaged (%.150s). Save it again.",
        text);
    leave(s->d, is_unsupported ? ERROR_INPUT_UNSUPPORTED : ERROR_INPUT_DAMAGED, whole);
}

/* Stops at warnings of damaged or missing data, for which the library would invent pixels. */
static void check_jpeg_warning(j_common_ptr jpeg, int level)
{
    static const int damages[] = {JWRN_HIT_MARKER, JWRN_HUFF_BAD_CODE, JWRN_JPEG_EOF, JWRN_MUST_RESYNC,
                                  JWRN_ARITH_BAD_CODE};
    for (size_t k = 0; level < 0 && k < sizeof damages / sizeof *damages; k++)
        if (jpeg->err->msg_code == damages[k]) stop_jpeg(jpeg);
}

static void pass_message(j_common_ptr jpeg)
{
    (void)jpeg;
}

static void check_scans(j_common_ptr jpeg)
{
    jpeg_state *s = (jpeg_state *)jpeg->client_data;
    char text[128];
    if ((uint64_t)s->jpeg.input_scan_number <= s->d->limits->scans) return;
    snprintf(text, sizeof text, "it has more than %llu scans: save it again, or raise limits.image_scans",
             (unsigned long long)s->d->limits->scans);
    leave(s->d, ERROR_INPUT_UNSUPPORTED, text);
}

static void find_jpeg_markers(jpeg_state *s)
{
    for (jpeg_saved_marker_ptr m = s->jpeg.marker_list; m; m = m->next) {
        s->d->facts->has_exif |= m->data_length >= 5 && memcmp(m->data, "Exif", 5) == 0;
        s->d->facts->has_profile |= m->data_length >= 12 && memcmp(m->data, "ICC_PROFILE", 12) == 0;
    }
}

static void read_jpeg_rows(jpeg_state *s)
{
    j_decompress_ptr jpeg = &s->jpeg;
    jpeg_mem_src(jpeg, s->d->data, (unsigned long)s->d->size);
    jpeg_save_markers(jpeg, JPEG_APP0 + 1, 16);
    jpeg_save_markers(jpeg, JPEG_APP0 + 2, 16);
    jpeg_read_header(jpeg, TRUE);
    find_jpeg_markers(s);
    if (jpeg->jpeg_color_space == JCS_CMYK || jpeg->jpeg_color_space == JCS_YCCK)
        leave(s->d, ERROR_INPUT_UNSUPPORTED, "its colours are CMYK, which is not read. Save it with RGB.");
    if (jpeg->num_components != 1 && jpeg->num_components != 3)
        leave(s->d, ERROR_INPUT_UNSUPPORTED, "it has neither one nor three components. Save it with RGB.");
    make_pixels(s->d, jpeg->image_width, jpeg->image_height, 8);
    jpeg->out_color_space = JCS_EXT_RGBA;
    jpeg->dct_method = JDCT_ISLOW; /* the accurate one */
    jpeg_start_decompress(jpeg);
    while (jpeg->output_scanline < jpeg->output_height) {
        JSAMPROW row = s->d->pixels + 4 * (size_t)jpeg->output_width * jpeg->output_scanline;
        jpeg_read_scanlines(jpeg, &row, 1);
    }
    jpeg_finish_decompress(jpeg);
}

static void read_jpeg(decoding *d)
{
    jpeg_state s = {.d = d};
    s.jpeg.err = jpeg_std_error(&s.errors);
    s.jpeg.client_data = &s;
    s.errors.error_exit = stop_jpeg;
    s.errors.emit_message = check_jpeg_warning;
    s.errors.output_message = pass_message;
    s.progress.progress_monitor = check_scans;
    if (setjmp(d->leave) == 0) {
        jpeg_create_decompress(&s.jpeg);
        s.jpeg.progress = &s.progress;
        read_jpeg_rows(&s);
    }
    jpeg_destroy_decompress(&s.jpeg);
}

/* ---- formats */

static bool is_unread(file_format format)
{
    return format != FILE_FORMAT_PNG && format != FILE_FORMAT_JPEG &&
           (file_formats[format].kind == FILE_FORMAT_IMAGES || file_formats[format].as_image);
}

/* The format of an image that is not read, by its bytes or its name; NULL: it is unknown. */
static const char *find_unread(const unsigned char *data, size_t size, const char *name)
{
    char head[FILE_FORMAT_HEAD + 1];
    const size_t length = size < FILE_FORMAT_HEAD ? size : FILE_FORMAT_HEAD;
    memcpy(head, data, length);
    head[length] = 0;
    const file_format found = file_format_of_bytes(head, length), named = file_format_of_name(name);
    return is_unread(found) ? file_formats[found].name : is_unread(named) ? file_formats[named].name : NULL;
}

void *image_decode(const unsigned char *data, size_t size, const char *name, const image_limits *limits,
                   image_facts *facts, error *e)
{
    error fault = {0};
    decoding d = {.data = data, .size = size, .limits = limits, .facts = facts, .e = &fault};
    *facts = (image_facts){0};
    if (size >= PNG_SIGNATURE && png_sig_cmp((png_bytep)(uintptr_t)data, 0, PNG_SIGNATURE) == 0) {
        read_png(&d);
    } else if (size >= 3 && memcmp(data, "\xFF\xD8\xFF", 3) == 0) {
        read_jpeg(&d);
    } else {
        const char *unread = find_unread(data, size, name);
        if (unread)
            snprintf(facts->unread, sizeof facts->unread, "%s", unread);
        else
            error_set(&fault, ERROR_INPUT_DAMAGED,
                      "it is neither a PNG nor a JPEG image. Save it as one of these.");
    }
    free(d.rows);
    if (fault.code == ERROR_NONE) return d.pixels;
    free(d.pixels);
    *e = fault;
    return NULL;
}

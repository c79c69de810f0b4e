// SPDX-License-Identifier: Apache-2.0
#include "io/pictures/picture_png.h"

#include <errno.h>
#include <png.h>
#include <setjmp.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

/* Runs of one colour along a row become runs of zeros after the filter. A full search for matches makes files
 * a fifth smaller and takes five times as long. */
enum { COMPRESSION_LEVEL = 1, COMPRESSION_STRATEGY = 3 /* zlib's Z_RLE */ };

static void on_error(png_structp png, png_const_charp words)
{
    error_set(png_get_error_ptr(png), ERROR_INTERNAL, "PNG file: %s", words);
    png_longjmp(png, 1);
}

static void on_write(png_structp png, png_bytep bytes, size_t count)
{
    if (fwrite(bytes, 1, count, png_get_io_ptr(png)) == count) return;
    error_set(png_get_error_ptr(png), error_code_of_errno(errno), "PNG file: it cannot be written: %s",
              strerror(errno));
    png_longjmp(png, 1);
}

static void on_flush(png_structp png)
{
    (void)png; /* picture_png_write flushes */
}

static void on_warning(png_structp png, png_const_charp words)
{
    (void)png;
    (void)words;
}

static void write_rows(png_structp png, png_infop info, const canvas *m)
{
    png_set_compression_level(png, COMPRESSION_LEVEL);
    png_set_compression_strategy(png, COMPRESSION_STRATEGY);
    png_set_filter(png, PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB);
    png_set_IHDR(png, info, (png_uint_32)m->width, (png_uint_32)m->height, 8, PNG_COLOR_TYPE_RGB,
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_sRGB(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
    png_write_info(png, info);
    for (int y = 0; y < m->height; y++) png_write_row(png, m->rgb + 3 * (size_t)y * (size_t)m->width);
    png_write_end(png, info);
}

bool picture_png_write(FILE *file, const canvas *m, error *e)
{
    error local = {0}; /* libpng needs an error object even if the caller has none */
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &local, on_error, on_warning);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    bool done = false;
    if (!info) {
        error_set(&local, ERROR_LIMIT_MEMORY, "no memory to write a PNG file");
    } else if (setjmp(png_jmpbuf(png)) == 0) { /* libpng returns here with 1 after on_error */
        png_set_write_fn(png, file, on_write, on_flush);
        write_rows(png, info, m);
        if (fflush(file) == 0)
            done = true;
        else
            error_set(&local, error_code_of_errno(errno), "PNG file: it cannot be written: %s",
                      strerror(errno));
    }
    png_destroy_write_struct(&png, &info);
    if (!done && e) *e = local;
    return done;
}

// SPDX-License-Identifier: Apache-2.0
/* image_decode: JPEG images against libjpeg's own accurate decoder, and what is refused. PNG images are in
 * tests/service/test_base_color.py. */
// clang-format off
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
// clang-format on
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <jpeglib.h>

#include "io/images/image_decode.h"

enum { WIDTH = 37, HEIGHT = 29 };

/* How an image is written. */
typedef struct writing {
    J_COLOR_SPACE space;
    int components;
    bool is_progressive;
    int factor;         /* of the sampling of luminance: 2 means that colours have half of the resolution */
    const char *marker; /* APP1 or APP2, or NULL */
    int marker_length, marker_number;
} writing;

static unsigned char *write_jpeg(const writing *w, unsigned long *size)
{
    struct jpeg_compress_struct jpeg;
    struct jpeg_error_mgr errors;
    unsigned char *data = NULL;
    *size = 0;
    jpeg.err = jpeg_std_error(&errors);
    jpeg_create_compress(&jpeg);
    jpeg_mem_dest(&jpeg, &data, size);
    jpeg.image_width = WIDTH;
    jpeg.image_height = HEIGHT;
    jpeg.input_components = w->components;
    jpeg.in_color_space = w->space;
    jpeg_set_defaults(&jpeg);
    jpeg_set_quality(&jpeg, 80, TRUE);
    if (w->components == 3) jpeg.comp_info[0].h_samp_factor = jpeg.comp_info[0].v_samp_factor = w->factor;
    if (w->is_progressive) jpeg_simple_progression(&jpeg);
    jpeg_start_compress(&jpeg, TRUE);
    if (w->marker)
        jpeg_write_marker(&jpeg, JPEG_APP0 + w->marker_number, (const JOCTET *)w->marker,
                          (unsigned)w->marker_length);
    for (int y = 0; y < HEIGHT; y++) {
        JSAMPLE line[4 * WIDTH], *row = line;
        for (int x = 0; x < WIDTH * w->components; x++)
            line[x] = (JSAMPLE)((x * 7 + y * y * 3 + (x % 5) * 40) & 255);
        jpeg_write_scanlines(&jpeg, &row, 1);
    }
    jpeg_finish_compress(&jpeg);
    jpeg_destroy_compress(&jpeg);
    return data;
}

/* Decodes to RGB with the library's defaults, which are accurate. */
static void read_reference(const unsigned char *data, unsigned long size, unsigned char rgb[HEIGHT][WIDTH][3])
{
    struct jpeg_decompress_struct jpeg;
    struct jpeg_error_mgr errors;
    jpeg.err = jpeg_std_error(&errors);
    jpeg_create_decompress(&jpeg);
    jpeg_mem_src(&jpeg, data, size);
    jpeg_read_header(&jpeg, TRUE);
    jpeg.out_color_space = JCS_RGB;
    assert_int_equal(jpeg.dct_method, JDCT_ISLOW);
    jpeg_start_decompress(&jpeg);
    while (jpeg.output_scanline < jpeg.output_height) {
        JSAMPROW row = rgb[jpeg.output_scanline][0];
        jpeg_read_scanlines(&jpeg, &row, 1);
    }
    jpeg_finish_decompress(&jpeg);
    jpeg_destroy_decompress(&jpeg);
}

static const image_limits limits = {.pixels = WIDTH * HEIGHT, .scans = 20, .memory = 4 * WIDTH * HEIGHT};

static void jpeg_images_equal_those_of_the_accurate_decoder(void **state)
{
    static const writing all[] = {{JCS_RGB, 3, false, 1, NULL, 0, 0},
                                  {JCS_RGB, 3, false, 2, NULL, 0, 0},
                                  {JCS_RGB, 3, true, 2, NULL, 0, 0},
                                  {JCS_GRAYSCALE, 1, false, 1, NULL, 0, 0},
                                  {JCS_GRAYSCALE, 1, true, 1, NULL, 0, 0}};
    (void)state;
    for (size_t k = 0; k < sizeof all / sizeof *all; k++) {
        unsigned char expected[HEIGHT][WIDTH][3];
        unsigned long size;
        unsigned char *data = write_jpeg(&all[k], &size);
        image_facts facts;
        error e = {0};
        read_reference(data, size, expected);
        unsigned char *pixels = image_decode(data, size, "a.jpg", &limits, &facts, &e);
        assert_non_null(pixels);
        assert_true(facts.width == WIDTH && facts.height == HEIGHT && facts.bits == 8 && !facts.has_exif &&
                    !facts.has_profile);
        for (size_t n = 0; n < WIDTH * HEIGHT; n++) {
            assert_memory_equal(pixels + 4 * n, expected[n / WIDTH][n % WIDTH], 3);
            assert_int_equal(pixels[4 * n + 3], 255);
        }
        free(pixels);
        free(data);
    }
}

/* Expects that an image is refused with this code and these words. */
static void expect_refused(const unsigned char *data, size_t size, const image_limits *most, error_code code,
                           const char *words)
{
    image_facts facts;
    error e = {0};
    assert_null(image_decode(data, size, "a.jpg", most, &facts, &e));
    assert_int_equal(e.code, code);
    assert_non_null(strstr(e.message, words));
}

static void cmyk_and_limits_are_refused(void **state)
{
    static const writing cmyk = {JCS_CMYK, 4, false, 1, NULL, 0, 0},
                         progressive = {JCS_RGB, 3, true, 1, NULL, 0, 0};
    image_limits few = limits;
    unsigned long size;
    unsigned char *data = write_jpeg(&cmyk, &size);
    (void)state;
    expect_refused(data, size, &limits, ERROR_INPUT_UNSUPPORTED, "CMYK");
    free(data);
    data = write_jpeg(&progressive, &size);
    few.scans = 5;
    expect_refused(data, size, &few, ERROR_INPUT_UNSUPPORTED, "limits.image_scans");
    few = limits;
    few.pixels--;
    expect_refused(data, size, &few, ERROR_INPUT_UNSUPPORTED, "limits.image_pixels");
    few = limits;
    few.memory--;
    expect_refused(data, size, &few, ERROR_LIMIT_MEMORY, "limits.memory_mb");
    free(data);
}

static void damaged_images_are_refused(void **state)
{
    static const writing w = {JCS_RGB, 3, false, 1, NULL, 0, 0};
    unsigned long size;
    unsigned char *data = write_jpeg(&w, &size);
    (void)state;
    for (size_t part = 4; part < size - 2; part += 7) {
        unsigned char *cut = malloc(part); /* the sanitizers see what is read behind it */
        memcpy(cut, data, part);
        image_facts facts;
        error e = {0};
        assert_null(image_decode(cut, part, "a.jpg", &limits, &facts, &e));
        assert_true(e.code == ERROR_INPUT_DAMAGED || e.code == ERROR_INPUT_UNSUPPORTED);
        free(cut);
    }
    free(data);
    expect_refused((const unsigned char *)"no image", 8, &limits, ERROR_INPUT_DAMAGED,
                   "neither a PNG nor a JPEG");
}

static void exif_and_profiles_are_noticed(void **state)
{
    static const writing exif = {JCS_RGB, 3, false, 1, "Exif\0\0MM\0*", 10, 1},
                         icc = {JCS_RGB, 3, false, 1, "ICC_PROFILE\0\1\1abcd", 18, 2};
    (void)state;
    for (int k = 0; k < 2; k++) {
        unsigned long size;
        unsigned char *data = write_jpeg(k ? &icc : &exif, &size);
        image_facts facts;
        error e = {0};
        void *pixels = image_decode(data, size, "a.jpg", &limits, &facts, &e);
        assert_non_null(pixels);
        assert_true(facts.has_exif == (k == 0) && facts.has_profile == (k == 1));
        free(pixels);
        free(data);
    }
}

static void other_formats_are_named(void **state)
{
    static const struct {
        const char *bytes, *name, *format;
    } all[] = {{"RIFF....WEBPVP8 ", "a.png", "WebP"},
               {"\xABKTX 20\xBB", "a", "KTX"},
               {"\1\1\1 any bytes", "A.TGA", "TGA"}};
    (void)state;
    for (size_t k = 0; k < sizeof all / sizeof *all; k++) {
        image_facts facts;
        error e = {0};
        assert_null(image_decode((const unsigned char *)all[k].bytes, strlen(all[k].bytes), all[k].name,
                                 &limits, &facts, &e));
        assert_int_equal(e.code, ERROR_NONE);
        assert_string_equal(facts.unread, all[k].format);
    }
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(jpeg_images_equal_those_of_the_accurate_decoder),
        cmocka_unit_test(cmyk_and_limits_are_refused),
        cmocka_unit_test(damaged_images_are_refused),
        cmocka_unit_test(exif_and_profiles_are_noticed),
        cmocka_unit_test(other_formats_are_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

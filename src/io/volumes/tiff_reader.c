// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/tiff_reader.h"

#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define IMATH_HALF_NO_LOOKUP_TABLE
#include <half.h>
#include <tiffio.h>

#include "base/core/error.h"
#include "base/core/reader.h"
#include "base/core/transfer.h"
#include "io/volumes/volume_header.h"
#include "io/volumes/numbers.h"

/* Maximum number of open descriptors: three standard ones, one for the file, and one for temporary use by
 * the libraries. */
enum { DESCRIPTORS = 5 };

/* Maximum number of pages of a file, close to the limit of the library. */
static const size_t most_pages = 1 << 20;

/* Properties that all pages of a file must share. */
typedef struct layout {
    uint32_t width, height;
    uint16_t bits, format, compression; /* compressions may differ */
    uint16_t orientation, fill_order;
    bool white_is_zero; /* large numbers are dark */
    /* where the pixels are: the tags of resolution and position; 0: absent */
    float placing[4];
    uint16_t unit;
} layout;

typedef struct tiff_file {
    int fd; /* the file; -1: none is open */
    int64_t bytes;
    size_t memory; /* memory limit for the pixels of a page */
    TIFF *tiff;
    uint64_t *offset; /* per page: offset of its directory */
    size_t count, room;
    layout layout;
    number_type type; /* type of the numbers in answers */
    tiff_description description;
    double size[3];
    char unit[TIFF_UNIT_SIZE];
    bool is_contiguous;  /* the file has one directory, and the numbers of all pages are consecutive */
    uint64_t first_byte; /* offset of these numbers */
    size_t reduced;      /* number of skipped pages of reduced resolution */
    bool is_placing_warned;
    dense_warnings warnings;
    error fault;
    char complaint[256]; /* the first message of the library */
} tiff_file;

/* ---- the library */

static int note_complaint(TIFF *tiff, void *context, const char *module, const char *format,
                          va_list arguments)
{
    tiff_file *f = context;
    (void)tiff, (void)module;
    if (!*f->complaint) vsnprintf(f->complaint, sizeof f->complaint, format, arguments);
    return 1;
}

static int drop_warning(TIFF *tiff, void *context, const char *module, const char *format, va_list arguments)
{
    (void)tiff, (void)context, (void)module, (void)format, (void)arguments;
    return 1;
}

/* State of the library's I/O callbacks: the read position. */
typedef struct place {
    tiff_file *file;
    int64_t at;
} place;

static tmsize_t read_bytes(thandle_t handle, void *to, tmsize_t count)
{
    place *p = handle;
    const int64_t got = transfer_read_at(p->file->fd, to, (size_t)count, (uint64_t)p->at);
    if (got > 0) p->at += got;
    return (tmsize_t)got;
}

static tmsize_t refuse_writing(thandle_t handle, void *from, tmsize_t count)
{
    (void)handle, (void)from, (void)count;
    return -1;
}

static toff_t seek(thandle_t handle, toff_t to, int from)
{
    place *p = handle;
    const int64_t base = from == SEEK_SET ? 0 : from == SEEK_CUR ? p->at : p->file->bytes;
    if (to > INT64_MAX / 2) return (toff_t)-1;
    p->at = base + (int64_t)to;
    return (toff_t)p->at;
}

static int close_nothing(thandle_t handle)
{
    free(handle);
    return 0;
}

static toff_t size_of_file(thandle_t handle)
{
    return (toff_t)((place *)handle)->file->bytes;
}

static bool refuse(tiff_file *f, error_code code, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

static bool refuse(tiff_file *f, error_code code, const char *format, ...)
{
    char text[512];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    if (f->fault.code == ERROR_NONE) error_set(&f->fault, code, "%s", text);
    return false;
}

/* Sets the fault to `what` with the message of the library. */
static bool damaged(tiff_file *f, const char *what)
{
    return refuse(f, ERROR_INPUT_DAMAGED, "%s%s%s. Copy or save it again.", what, *f->complaint ? ": " : "",
                  f->complaint);
}

static bool open_library(tiff_file *f)
{
    TIFFOpenOptions *options = TIFFOpenOptionsAlloc();
    place *p = malloc(sizeof *p);
    struct stat st;
    if (!options || !p || fstat(f->fd, &st) != 0) {
        free(p);
        if (options) TIFFOpenOptionsFree(options);
        return refuse(f, ERROR_INTERNAL, "the file cannot be examined");
    }
    f->bytes = st.st_size;
    *p = (place){f, 0};
    TIFFOpenOptionsSetMaxSingleMemAlloc(options, (tmsize_t)f->memory);
    TIFFOpenOptionsSetErrorHandlerExtR(options, note_complaint, f);
    TIFFOpenOptionsSetWarningHandlerExtR(options, drop_warning, NULL);
    f->tiff = TIFFClientOpenExt("file", "rm", p, read_bytes, refuse_writing, seek, close_nothing,
                                size_of_file, NULL, NULL, options);
    TIFFOpenOptionsFree(options);
    if (f->tiff) return true;
    free(p);
    return damaged(f, "the file is not a TIFF file, or its first directory is damaged");
}

/* ---- pages */

static number_type type_of(const layout *l, bool *known)
{
    static const struct {
        uint16_t format, bits;
        number_type type;
    } types[] = {{SAMPLEFORMAT_UINT, 1, NUMBER_UINT8},    {SAMPLEFORMAT_UINT, 2, NUMBER_UINT8},
                 {SAMPLEFORMAT_UINT, 4, NUMBER_UINT8},    {SAMPLEFORMAT_UINT, 8, NUMBER_UINT8},
                 {SAMPLEFORMAT_UINT, 16, NUMBER_UINT16},  {SAMPLEFORMAT_UINT, 32, NUMBER_UINT32},
                 {SAMPLEFORMAT_UINT, 64, NUMBER_UINT64},  {SAMPLEFORMAT_INT, 8, NUMBER_INT8},
                 {SAMPLEFORMAT_INT, 16, NUMBER_INT16},    {SAMPLEFORMAT_INT, 32, NUMBER_INT32},
                 {SAMPLEFORMAT_INT, 64, NUMBER_INT64},    {SAMPLEFORMAT_IEEEFP, 16, NUMBER_FLOAT},
                 {SAMPLEFORMAT_IEEEFP, 32, NUMBER_FLOAT}, {SAMPLEFORMAT_IEEEFP, 64, NUMBER_DOUBLE}};
    for (size_t k = 0; k < sizeof types / sizeof *types; k++)
        if (types[k].format == l->format && types[k].bits == l->bits) {
            *known = true;
            return types[k].type;
        }
    *known = false;
    return NUMBER_UINT8;
}

static const char *format_name(uint16_t format)
{
    return format == SAMPLEFORMAT_INT      ? "signed integers"
           : format == SAMPLEFORMAT_IEEEFP ? "floating-point numbers"
           : format == SAMPLEFORMAT_UINT   ? "integers"
                                           : "other numbers";
}

/* Reads the layout of the current directory. Refuses pages with more than one sample per pixel. */
static bool read_layout(tiff_file *f, size_t page, layout *out)
{
    static const uint32_t placing[4] = {TIFFTAG_XRESOLUTION, TIFFTAG_YRESOLUTION, TIFFTAG_XPOSITION,
                                        TIFFTAG_YPOSITION};
    uint16_t samples = 1, photometric = PHOTOMETRIC_MINISBLACK;
    uint32_t depth = 1;
    bool known;
    *out = (layout){0};
    for (int k = 0; k < 4; k++) TIFFGetField(f->tiff, placing[k], &out->placing[k]);
    TIFFGetFieldDefaulted(f->tiff, TIFFTAG_RESOLUTIONUNIT, &out->unit);
    TIFFGetField(f->tiff, TIFFTAG_IMAGEWIDTH, &out->width);
    TIFFGetField(f->tiff, TIFFTAG_IMAGELENGTH, &out->height);
    TIFFGetFieldDefaulted(f->tiff, TIFFTAG_BITSPERSAMPLE, &out->bits);
    TIFFGetFieldDefaulted(f->tiff, TIFFTAG_SAMPLEFORMAT, &out->format);
    TIFFGetFieldDefaulted(f->tiff, TIFFTAG_COMPRESSION, &out->compression);
    TIFFGetFieldDefaulted(f->tiff, TIFFTAG_SAMPLESPERPIXEL, &samples);
    TIFFGetFieldDefaulted(f->tiff, TIFFTAG_IMAGEDEPTH, &depth);
    TIFFGetField(f->tiff, TIFFTAG_PHOTOMETRIC, &photometric);
    TIFFGetFieldDefaulted(f->tiff, TIFFTAG_ORIENTATION, &out->orientation);
    TIFFGetFieldDefaulted(f->tiff, TIFFTAG_FILLORDER, &out->fill_order);
    out->white_is_zero = photometric == PHOTOMETRIC_MINISWHITE;
    if (out->format == SAMPLEFORMAT_VOID) out->format = SAMPLEFORMAT_UINT;
    if (out->width == 0 || out->height == 0) return damaged(f, "a page has no pixels");
    if (samples != 1)
        return refuse(
            f, ERROR_INPUT_UNSUPPORTED,
            "page %zu has %u numbers at each pixel (%s): save it with one number, as grey values or "
            "labels",
            page, samples, samples >= 3 ? "a colour image" : "with transparency, for example");
    f->type = type_of(out, &known);
    if (!known)
        return refuse(f, ERROR_INPUT_UNSUPPORTED,
                      "page %zu has %s of %u bits: save it with integers of 8, 16 or 32 bits or with floats",
                      page, format_name(out->format), out->bits);
    if (depth > 1)
        return refuse(f, ERROR_INPUT_UNSUPPORTED,
                      "page %zu has the tag ImageDepth %u: save it as one page for each slice", page, depth);
    if (out->compression == COMPRESSION_OJPEG || !TIFFIsCODECConfigured(out->compression))
        return refuse(f, ERROR_INPUT_UNSUPPORTED,
                      "page %zu has the compression %u, which is not read: save it with LZW or Deflate "
                      "(`tiffcp -c lzw FILE OUT` converts it)",
                      page, out->compression);
    return true;
}

static bool is_same(const layout *a, const layout *b)
{
    return a->width == b->width && a->height == b->height && a->bits == b->bits && a->format == b->format &&
           a->orientation == b->orientation && a->fill_order == b->fill_order &&
           a->white_is_zero == b->white_is_zero;
}

/* Refuses the page if its numbers do not have the meaning of those of page 0. */
static bool check_page(tiff_file *f, size_t page, const layout *own)
{
    const layout *first = &f->layout;
    if (own->width != first->width || own->height != first->height || own->bits != first->bits ||
        own->format != first->format)
        return refuse(
            f, ERROR_INPUT_UNSUPPORTED,
            "page %zu has %u x %u pixels of %u bits (%s), and page 0 has %u x %u of %u bits (%s): save pages "
            "of one size and type",
            page, own->width, own->height, own->bits, format_name(own->format), first->width, first->height,
            first->bits, format_name(first->format));
    if (own->orientation != first->orientation)
        return refuse(
            f, ERROR_INPUT_UNSUPPORTED,
            "page %zu has the Orientation %u, and page 0 has %u: save all pages with one Orientation", page,
            own->orientation, first->orientation);
    if (own->fill_order != first->fill_order)
        return refuse(f, ERROR_INPUT_UNSUPPORTED,
                      "page %zu has the FillOrder %u, and page 0 has %u: save all pages with one FillOrder",
                      page, own->fill_order, first->fill_order);
    if (own->white_is_zero != first->white_is_zero)
        return refuse(
            f, ERROR_INPUT_UNSUPPORTED,
            "PhotometricInterpretation of page %zu is %sWhiteIsZero, and that of page 0 is %s: save all pages "
            "with one",
            page, own->white_is_zero ? "" : "not ", own->white_is_zero ? "not" : "WhiteIsZero");
    if (!f->is_placing_warned &&
        (memcmp(own->placing, first->placing, sizeof own->placing) != 0 || own->unit != first->unit)) {
        dense_warn(
            &f->warnings,
            "page %zu has another resolution or position (tags XResolution, YResolution, XPosition, YPosition) "
            "than page 0: those of page 0 are used for all pages",
            page);
        f->is_placing_warned = true;
    }
    return true;
}

/* Warns about tags that all pages have and that are not applied. */
static void warn_of_layout(tiff_file *f)
{
    if (f->layout.white_is_zero)
        dense_warn(&f->warnings, "PhotometricInterpretation is WhiteIsZero: the numbers of the file are used "
                                 "and not inverted");
    if (f->layout.orientation != ORIENTATION_TOPLEFT)
        dense_warn(&f->warnings, "Orientation is %u and is ignored: the first row of the file is row 0",
                   f->layout.orientation);
}

/* Whether the current directory is a reduced image or a transparency mask. */
static bool is_reduced(const tiff_file *f)
{
    uint32_t kind = 0;
    TIFFGetFieldDefaulted(f->tiff, TIFFTAG_SUBFILETYPE, &kind);
    return (kind & (FILETYPE_REDUCEDIMAGE | FILETYPE_MASK)) != 0;
}

/* The entries of a directory as they are in the file. */
typedef struct directory_entries {
    uint64_t first, count; /* offset of the first entry, number of entries */
    size_t bytes;          /* of an entry */
    bool is_little;        /* byte order */
} directory_entries;

/* Adds the current directory as the next page. */
static bool add_page(tiff_file *f)
{
    layout own;
    if (!read_layout(f, f->count, &own)) return false;
    if (f->count == 0) f->layout = own;
    if (!check_page(f, f->count, &own)) return false;
    if (f->count == most_pages)
        return refuse(f, ERROR_INPUT_UNSUPPORTED, "the file has more than %zu pages: cut it into parts",
                      most_pages);
    if (f->count == f->room) {
        const size_t room = f->room ? 2 * f->room : 64;
        uint64_t *grown = realloc(f->offset, room * sizeof *grown);
        if (!grown) return refuse(f, ERROR_LIMIT_MEMORY, "its pages exceed the memory limit");
        f->offset = grown;
        f->room = room;
    }
    f->offset[f->count++] = TIFFCurrentDirOffset(f->tiff);
    return true;
}

/* Reads the head of a directory. False: the file ends before the offset of the next directory, which the library
 * accepts in the last directory. */
static bool read_entries(const tiff_file *f, uint64_t directory, directory_entries *out)
{
    unsigned char head[8];
    *out = (directory_entries){0};
    if (transfer_read_at(f->fd, head, sizeof head, 0) != sizeof head) return false;
    out->is_little = head[0] == 'I';
    const bool is_big_file = (out->is_little ? head[2] : head[3]) == 43;
    const uint64_t size = is_big_file ? 8 : 2;
    if (directory > (uint64_t)f->bytes || transfer_read_at(f->fd, head, size, directory) != (int64_t)size)
        return false;
    for (uint64_t k = 0; k < size; k++)
        out->count = out->count << 8 | head[out->is_little ? size - 1 - k : k];
    out->first = directory + size;
    out->bytes = is_big_file ? 20 : 12;
    return out->count <= (uint64_t)f->bytes &&
           out->first + out->count * out->bytes + (is_big_file ? 8 : 4) <= (uint64_t)f->bytes;
}

/* Refuses a tag with two entries, of which the library uses the first. */
static bool check_entries(tiff_file *f, uint64_t directory)
{
    directory_entries d;
    if (!read_entries(f, directory, &d) || d.count > UINT16_MAX)
        return damaged(f, "a directory of the file is damaged");
    unsigned char *bytes = malloc(d.count * d.bytes + 1), seen[(UINT16_MAX + 1) / 8] = {0};
    bool ok =
        bytes && transfer_read_at(f->fd, bytes, d.count * d.bytes, d.first) == (int64_t)(d.count * d.bytes);
    if (!ok) damaged(f, "a directory of the file is damaged");
    for (uint64_t k = 0; ok && k < d.count; k++) {
        const unsigned char *entry = bytes + k * d.bytes;
        const unsigned tag = d.is_little ? entry[0] | entry[1] << 8 : entry[1] | entry[0] << 8;
        if (seen[tag / 8] >> tag % 8 & 1)
            ok = refuse(f, ERROR_INPUT_DAMAGED, "page %zu has the tag %u twice: save the file again",
                        f->count, tag);
        seen[tag / 8] |= (unsigned char)(1u << tag % 8);
    }
    free(bytes);
    return ok;
}

static bool list_pages(tiff_file *f)
{
    uint64_t last;
    do {
        last = TIFFCurrentDirOffset(f->tiff);
        if (is_reduced(f))
            f->reduced++;
        else if (!check_entries(f, last) || !add_page(f))
            return false;
    } while (TIFFReadDirectory(f->tiff));
    if (*f->complaint) return damaged(f, "a directory of the file is damaged");
    if (f->count == 0)
        return refuse(
            f, ERROR_INPUT_UNSUPPORTED,
            "the file has only images of reduced resolution and masks: save it with its full images");
    warn_of_layout(f);
    if (f->reduced > 0)
        dense_warn(&f->warnings, "%zu pages of reduced resolution or of masks are skipped", f->reduced);
    return true;
}

static int64_t page_bytes(const layout *l)
{
    return ((int64_t)l->width * l->bits + 7) / 8 * l->height;
}

/* Detects large stacks of ImageJ: one directory, with the numbers of all pages after each other. */
static void find_contiguous(tiff_file *f)
{
    const tiff_description *d = &f->description;
    uint64_t next = TIFFGetStrileOffset(f->tiff, 0);
    if (f->count != 1 || d->images < 2 || f->layout.compression != COMPRESSION_NONE || f->layout.bits < 8 ||
        TIFFIsTiled(f->tiff))
        return;
    f->first_byte = next;
    for (uint32_t k = 0; k < TIFFNumberOfStrips(f->tiff); k++) {
        if (TIFFGetStrileOffset(f->tiff, k) != next) return;
        next += TIFFGetStrileByteCount(f->tiff, k);
    }
    f->is_contiguous = true;
}

/* Counts the pages, and checks that the file is large enough for them. */
static bool check_size(tiff_file *f)
{
    const int64_t pages = f->is_contiguous ? f->description.images : (int64_t)f->count,
                  bytes = page_bytes(&f->layout);
    const double answered = (double)f->layout.width * f->layout.height * (double)number_bytes(f->type);
    if (answered > (double)f->memory)
        return refuse(f, ERROR_LIMIT_MEMORY,
                      "a page of %u x %u pixels requires %.0f MiB, and %zu MiB of the limit are left: raise "
                      "limits.memory_mb by at least %.0f",
                      f->layout.width, f->layout.height, ceil(answered / (1 << 20)), f->memory >> 20,
                      ceil((answered - (double)f->memory) / (1 << 20)));
    if (f->layout.compression == COMPRESSION_NONE &&
        bytes > (f->bytes - (int64_t)(f->is_contiguous ? f->first_byte : 0)) / (f->is_contiguous ? pages : 1))
        return refuse(f, ERROR_INPUT_DAMAGED,
                      "the file has %lld bytes, fewer than %lld pages of %lld bytes: it is damaged or "
                      "truncated. Copy or save it again.",
                      (long long)f->bytes, (long long)pages, (long long)bytes);
    return true;
}

/* Sets the pixel size from the resolution tags, in pixels per unit. 1 x 1 without a unit means that the
 * resolution is unknown. */
static void read_size(tiff_file *f)
{
    const tiff_description *d = &f->description;
    float x = 0, y = 0;
    uint16_t unit = RESUNIT_NONE;
    memcpy(f->size, d->size, sizeof f->size);
    memcpy(f->unit, d->unit, sizeof f->unit);
    if (d->size[0] > 0 || d->size[1] > 0) return; /* OME-XML */
    TIFFGetField(f->tiff, TIFFTAG_XRESOLUTION, &x);
    TIFFGetField(f->tiff, TIFFTAG_YRESOLUTION, &y);
    TIFFGetFieldDefaulted(f->tiff, TIFFTAG_RESOLUTIONUNIT, &unit);
    const bool are_positive = x > 0 && y > 0 && isfinite(x) && isfinite(y);
    if (!are_positive || (x == 1 && y == 1 && unit == RESUNIT_NONE && !*f->unit)) return;
    f->size[0] = 1 / (double)x * d->in_unit[0];
    f->size[1] = 1 / (double)y * d->in_unit[1];
    if (!*f->unit) strcpy(f->unit, unit == RESUNIT_INCH ? "inch" : unit == RESUNIT_CENTIMETER ? "cm" : "");
}

/* Warns of sizes, types and numbers of pages of a description that differ from those of the image. */
static void compare_description(tiff_file *f)
{
    const tiff_description *d = &f->description;
    const layout *l = &f->layout;
    const char *type = numbers_name(f->type);
    if ((d->width > 0 && d->width != l->width) || (d->height > 0 && d->height != l->height))
        dense_warn(
            &f->warnings,
            "its OME-XML has SizeX %lld and SizeY %lld, and the image %u x %u pixels: the image counts",
            (long long)d->width, (long long)d->height, l->width, l->height);
    if (*d->type && strcmp(d->type, type) != 0 && l->bits >= 8)
        dense_warn(&f->warnings, "its OME-XML has the Type \"%s\", and the image has %s: the image counts",
                   d->type, type);
    if (d->kind && d->images > 1 && !f->is_contiguous && d->images != (int64_t)f->count)
        dense_warn(&f->warnings,
                   "ImageJ's description has %lld images, and the file has %zu: the file counts",
                   (long long)d->images, (size_t)f->count);
}

/* The tag of GDAL with the number that means "no data", as text. */
enum { GDAL_NODATA = 42113 };

static bool read_description(tiff_file *f)
{
    const char *text = NULL, *no_data = NULL;
    uint32_t length = 0;
    char fault[TIFF_FAULT_SIZE];
    if (!TIFFSetSubDirectory(f->tiff, f->offset[0])) return damaged(f, "the first directory is damaged");
    TIFFGetField(f->tiff, TIFFTAG_IMAGEDESCRIPTION, &text);
    if (TIFFGetField(f->tiff, GDAL_NODATA, &length, &no_data) && length < sizeof f->warnings.no_data) {
        char number[sizeof f->warnings.no_data], *end;
        snprintf(number, sizeof number, "%.*s", (int)length, no_data);
        const double value = strtod(number, &end);
        if (end != number) snprintf(f->warnings.no_data, sizeof f->warnings.no_data, "%.9g", value);
    }
    if (!tiff_describe(text ? text : "", &f->description, &f->warnings, fault))
        return refuse(f, ERROR_INPUT_UNSUPPORTED, "%s", fault);
    find_contiguous(f);
    compare_description(f);
    read_size(f);
    tiff_description *d = &f->description;
    const int64_t pages = f->is_contiguous ? d->images : (int64_t)f->count;
    if (d->kind && d->slices * d->channels * d->frames != pages) {
        if (strcmp(d->kind, "ImageJ") != 0)
            return refuse(f, ERROR_INPUT_UNSUPPORTED,
                          "its OME-XML describes %lld slices, %lld channels and %lld times, and the file has "
                          "%lld pages: save all of them as one file (Fiji, Bio-Formats Exporter)",
                          (long long)d->slices, (long long)d->channels, (long long)d->frames,
                          (long long)pages);
        dense_warn(&f->warnings,
                   "ImageJ's description has %lld slices, %lld channels and %lld frames, and the file %lld "
                   "pages: each page is a slice",
                   (long long)d->slices, (long long)d->channels, (long long)d->frames, (long long)pages);
        d->kind = NULL;
    }
    if (!d->kind) {
        d->slices = pages;
        d->channels = d->frames = d->slice_step = 1;
        d->channel_step = d->frame_step = pages;
    }
    return true;
}

static void close_file(tiff_file *f)
{
    const size_t memory = f->memory;
    if (f->tiff) TIFFClose(f->tiff);
    if (f->fd >= 0) close(f->fd);
    free(f->offset);
    *f = (tiff_file){.fd = -1, .memory = memory};
}

static bool open_file(tiff_file *f)
{
    return open_library(f) && list_pages(f) && read_description(f) && check_size(f);
}

/* ---- pixels */

/* Unpacks `count` numbers from the start of a row. */
static void unpack(const tiff_file *f, const unsigned char *from, size_t count, unsigned char *to)
{
    const unsigned bits = f->layout.bits;
    if (bits < 8) {
        const unsigned each = 8 / bits, most = (1u << bits) - 1;
        for (size_t k = 0; k < count; k++)
            to[k] = (unsigned char)(from[k / each] >> (8 - bits * (k % each + 1)) & most);
    } else if (f->layout.format == SAMPLEFORMAT_IEEEFP && bits == 16) {
        for (size_t k = 0; k < count; k++) {
            imath_half_bits_t number;
            memcpy(&number, from + 2 * k, sizeof number);
            const float value = imath_half_to_float(number);
            memcpy(to + 4 * k, &value, sizeof value);
        }
    } else {
        memcpy(to, from, count * bits / 8);
    }
}

/* Allocates a buffer for a strip or a tile. */
static unsigned char *make_room(tiff_file *f, tmsize_t size)
{
    unsigned char *room = size > 0 && (size_t)size <= f->memory ? malloc((size_t)size) : NULL;
    if (!room && size <= 0)
        damaged(f, "the size of a strip or tile is invalid");
    else if (!room)
        refuse(
            f, ERROR_LIMIT_MEMORY,
            "a strip or tile requires %lld MiB, and %zu MiB of the limit are left: raise limits.memory_mb by at least %lld",
            (long long)(size >> 20) + 1, f->memory >> 20, ((long long)(size - (int64_t)f->memory) >> 20) + 1);
    return room;
}

static bool read_strips(tiff_file *f, unsigned char *to)
{
    const uint32_t width = f->layout.width, height = f->layout.height;
    const size_t row = (size_t)TIFFScanlineSize(f->tiff), own = (size_t)width * number_bytes(f->type);
    uint32_t rows = height;
    unsigned char *strip = make_room(f, TIFFStripSize(f->tiff));
    TIFFGetFieldDefaulted(f->tiff, TIFFTAG_ROWSPERSTRIP, &rows);
    if (rows == 0 || rows > height) rows = height;
    bool ok = strip != NULL;
    if (ok && row < ((size_t)width * f->layout.bits + 7) / 8) ok = damaged(f, "its rows are too short");
    for (uint32_t y = 0, k = 0; ok && y < height; y += rows, k++) {
        const uint32_t some = height - y < rows ? height - y : rows;
        const tmsize_t bytes = (tmsize_t)(some * row);
        if (bytes > TIFFStripSize(f->tiff) || TIFFReadEncodedStrip(f->tiff, k, strip, bytes) != bytes)
            ok = damaged(f, "rows of a page are missing or damaged");
        for (uint32_t n = 0; ok && n < some; n++) unpack(f, strip + n * row, width, to + (y + n) * own);
    }
    free(strip);
    return ok;
}

static bool read_tiles(tiff_file *f, unsigned char *to)
{
    const uint32_t width = f->layout.width, height = f->layout.height;
    const size_t number = number_bytes(f->type), own = width * number, row = (size_t)TIFFTileRowSize(f->tiff);
    uint32_t wide = 0, high = 0;
    const tmsize_t size = TIFFTileSize(f->tiff);
    unsigned char *tile = make_room(f, size);
    TIFFGetField(f->tiff, TIFFTAG_TILEWIDTH, &wide);
    TIFFGetField(f->tiff, TIFFTAG_TILELENGTH, &high);
    bool ok = tile != NULL;
    if (ok && (wide == 0 || high == 0 || row < ((size_t)wide * f->layout.bits + 7) / 8 ||
               row > (size_t)size / high))
        ok = damaged(f, "the size of its tiles is invalid");
    for (uint32_t y = 0; ok && y < height; y += high)
        for (uint32_t x = 0; ok && x < width; x += wide) {
            const uint32_t columns = width - x < wide ? width - x : wide,
                           rows = height - y < high ? height - y : high;
            if (TIFFReadEncodedTile(f->tiff, TIFFComputeTile(f->tiff, x, y, 0, 0), tile, size) != size)
                ok = damaged(f, "a tile of a page is missing or damaged");
            for (uint32_t n = 0; ok && n < rows; n++)
                unpack(f, tile + n * row, columns, to + (y + n) * own + x * number);
            if (wide > UINT32_MAX - x) break;
        }
    free(tile);
    return ok;
}

static bool read_contiguous(tiff_file *f, uint32_t page, unsigned char *to)
{
    const int64_t bytes = page_bytes(&f->layout);
    unsigned char *packed = make_room(f, (tmsize_t)bytes);
    bool ok = packed != NULL;
    if (ok &&
        transfer_read_at(f->fd, packed, (size_t)bytes, f->first_byte + (uint64_t)(page * bytes)) != bytes)
        ok = damaged(f, "the file ends before its last page");
    const size_t numbers = (size_t)f->layout.width * f->layout.height;
    if (ok && TIFFIsByteSwapped(f->tiff)) {
        if (f->layout.bits == 16) TIFFSwabArrayOfShort((uint16_t *)(void *)packed, (tmsize_t)numbers);
        if (f->layout.bits == 32) TIFFSwabArrayOfLong((uint32_t *)(void *)packed, (tmsize_t)numbers);
        if (f->layout.bits == 64) TIFFSwabArrayOfLong8((uint64_t *)(void *)packed, (tmsize_t)numbers);
    }
    if (ok) unpack(f, packed, numbers, to);
    free(packed);
    return ok;
}

/* Reads the numbers of a page; the caller frees them. NULL: the fault is set. */
static unsigned char *read_page(tiff_file *f, uint32_t page)
{
    layout own;
    const size_t bytes = (size_t)f->layout.width * f->layout.height * number_bytes(f->type);
    unsigned char *to = bytes <= f->memory ? malloc(bytes) : NULL;
    if (!to) {
        refuse(f, ERROR_LIMIT_MEMORY, "a page exceeds the memory limit: raise limits.memory_mb");
        return NULL;
    }
    bool ok;
    if (f->is_contiguous)
        ok = read_contiguous(f, page, to);
    else
        ok = (TIFFSetSubDirectory(f->tiff, f->offset[page]) ||
              damaged(f, "the directory of a page is damaged")) &&
             read_layout(f, page, &own) && (is_same(&own, &f->layout) || damaged(f, "a page has changed")) &&
             (TIFFIsTiled(f->tiff) ? read_tiles(f, to) : read_strips(f, to));
    if (ok) return to;
    free(to);
    return NULL;
}

/* ---- the program */

static void describe(const tiff_file *f, tiff_answer *a)
{
    const tiff_description *d = &f->description;
    a->width = f->layout.width;
    a->height = f->layout.height;
    a->pages = f->is_contiguous ? d->images : (int64_t)f->count;
    a->slices = d->slices;
    a->channels = d->channels;
    a->frames = d->frames;
    a->slice_step = d->slice_step;
    a->channel_step = d->channel_step;
    a->frame_step = d->frame_step;
    a->type = f->type;
    memcpy(a->size, f->size, sizeof a->size);
    memcpy(a->origin, d->origin, sizeof a->origin);
    memcpy(a->unit, f->unit, sizeof a->unit);
    a->orientation = f->layout.orientation;
    a->fill_order = f->layout.fill_order;
    a->white_is_zero = f->layout.white_is_zero;
    a->warnings = f->warnings;
}

static bool answer(tiff_file *f, const tiff_request *request)
{
    unsigned char *page = NULL;
    tiff_answer a = {0};
    f->fault = (error){0};
    if (request->what == TIFF_READER_OPEN) {
        open_file(f);
    } else {
        f->complaint[0] = 0;
        if (f->tiff && (f->is_contiguous ? request->page < f->description.images : request->page < f->count))
            page = read_page(f, request->page);
        else
            refuse(f, ERROR_INPUT_DAMAGED, "the file has no page %u", request->page);
    }
    if (f->fault.code != ERROR_NONE) return reader_refuse(f->fault.code, f->fault.message);
    describe(f, &a);
    bool written = reader_answer(&a, sizeof a, NULL, 0);
    if (written && page)
        written = reader_write(page, (size_t)f->layout.width * f->layout.height * number_bytes(f->type));
    free(page);
    return written;
}

__attribute__((visibility("default"))) int tiff_reader_main(int argc, char **argv)
{
    tiff_file f = {.fd = -1, .memory = reader_limit(argc, argv, DESCRIPTORS)};
    tiff_request request;
    int file;
    if (!f.memory) return 2;
    while (reader_receive(&request, sizeof request, &file)) {
        if (request.what == TIFF_READER_OPEN) {
            close_file(&f);
            f.fd = file;
        } else if (file >= 0) {
            close(file);
        }
        if (!answer(&f, &request)) _exit(1);
    }
    _exit(0); /* _exit: freeing the library's memory takes time */
}

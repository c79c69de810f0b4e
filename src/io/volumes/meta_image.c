// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/meta_image.h"

#include <ctype.h>
#include <endian.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WORD_SIZE = 64 };

/* The fields that are used. NAN: a number is missing. */
typedef struct fields {
    double dimensions, channels, header_size, packed_bytes, slope, intercept;
    double size[3], spacing[3], element_size[3], origin[3], turn[9], center[3];
    bool big_endian, packed, binary;
    char type[WORD_SIZE], unit[WORD_SIZE], orientation[WORD_SIZE];
    char bad[WORD_SIZE]; /* name of a field that has too few numbers, or "" */
} fields;

/* Names of the fields; some fields have several. */
static const struct {
    const char *key;
    size_t offset;
    int count;
} numbers[] = {{"NDims", offsetof(fields, dimensions), 1},
               {"ElementNumberOfChannels", offsetof(fields, channels), 1},
               {"HeaderSize", offsetof(fields, header_size), 1},
               {"CompressedDataSize", offsetof(fields, packed_bytes), 1},
               {"ElementToIntensityFunctionSlope", offsetof(fields, slope), 1},
               {"ElementToIntensityFunctionOffset", offsetof(fields, intercept), 1},
               {"DimSize", offsetof(fields, size), 3},
               {"ElementSpacing", offsetof(fields, spacing), 3},
               {"ElementSize", offsetof(fields, element_size), 3},
               {"Offset", offsetof(fields, origin), 3},
               {"Position", offsetof(fields, origin), 3},
               {"Origin", offsetof(fields, origin), 3},
               {"TransformMatrix", offsetof(fields, turn), 9},
               {"Rotation", offsetof(fields, turn), 9},
               {"Orientation", offsetof(fields, turn), 9},
               {"CenterOfRotation", offsetof(fields, center), 3}};

static const struct {
    const char *key;
    size_t offset;
} switches[] = {{"BinaryData", offsetof(fields, binary)},
                {"CompressedData", offsetof(fields, packed)},
                {"ElementByteOrderMSB", offsetof(fields, big_endian)},
                {"BinaryDataByteOrderMSB", offsetof(fields, big_endian)}};

static const struct {
    const char *key;
    size_t offset;
} words[] = {{"ElementType", offsetof(fields, type)},
             {"DistanceUnits", offsetof(fields, unit)},
             {"AnatomicalOrientation", offsetof(fields, orientation)}};

static const struct {
    const char *name;
    number_type type;
} types[] = {{"MET_CHAR", NUMBER_INT8},       {"MET_UCHAR", NUMBER_UINT8},       {"MET_SHORT", NUMBER_INT16},
             {"MET_USHORT", NUMBER_UINT16},   {"MET_INT", NUMBER_INT32},         {"MET_UINT", NUMBER_UINT32},
             {"MET_LONG_LONG", NUMBER_INT64}, {"MET_ULONG_LONG", NUMBER_UINT64}, {"MET_FLOAT", NUMBER_FLOAT},
             {"MET_DOUBLE", NUMBER_DOUBLE}};

bool meta_image_is(const char *text)
{
    static const char *const first[] = {"ObjectType", "NDims", "Comment"};
    const char *dimensions = strstr(text, "NDims");
    for (size_t k = 0; k < sizeof first / sizeof *first; k++) {
        size_t n = strlen(first[k]);
        if (strncmp(text, first[k], n) == 0 && text[n + strspn(text + n, " \t")] == '=')
            return dimensions != NULL;
    }
    return isalpha((unsigned char)*text) && text[strcspn(text, "=\n")] == '=' && dimensions &&
           strstr(text, "ElementDataFile");
}

static void take_numbers(fields *f, const char *key, const char *value, double *out, int count)
{
    char *end;
    for (int k = 0; k < count; k++, value = end) {
        double number = strtod(value, &end);
        if (end == value) {
            snprintf(f->bad, sizeof f->bad, "%s", key);
            return;
        }
        out[k] = number;
    }
}

static void take(fields *f, const char *key, const char *value)
{
    for (size_t k = 0; k < sizeof numbers / sizeof *numbers; k++)
        if (strcmp(key, numbers[k].key) == 0)
            take_numbers(f, key, value, (double *)(void *)((char *)f + numbers[k].offset), numbers[k].count);
    for (size_t k = 0; k < sizeof switches / sizeof *switches; k++)
        if (strcmp(key, switches[k].key) == 0)
            *((bool *)f + switches[k].offset) = *value == 'T' || *value == 't' || *value == '1';
    for (size_t k = 0; k < sizeof words / sizeof *words; k++)
        if (strcmp(key, words[k].key) == 0) snprintf((char *)f + words[k].offset, WORD_SIZE, "%s", value);
}

static bool is_between(double value, double low, double high)
{
    return value >= low && value <= high && value == rint(value);
}

static bool check(const fields *f, char fault[META_IMAGE_FAULT_SIZE], error_code *code)
{
    *code = ERROR_INPUT_UNSUPPORTED;
    if (f->dimensions != 3)
        return snprintf(fault, META_IMAGE_FAULT_SIZE,
                        "the file is a MetaImage that is not of three dimensions") < 0;
    if (!f->binary && f->packed)
        return snprintf(
                   fault, META_IMAGE_FAULT_SIZE,
                   "the file has BinaryData = False and CompressedData = True. Save it with one of them") < 0;
    if (!f->binary && f->header_size == -1)
        return snprintf(fault, META_IMAGE_FAULT_SIZE,
                        "the file has BinaryData = False and HeaderSize = -1, which needs binary data") < 0;
    *code = ERROR_INPUT_DAMAGED;
    if (*f->bad)
        return snprintf(fault, META_IMAGE_FAULT_SIZE,
                        "its field %.63s has too few numbers: it is damaged. Correct the header.",
                        f->bad) < 0;
    if (!is_between(f->channels, 1, 4))
        return snprintf(fault, META_IMAGE_FAULT_SIZE, "claims %g values at each sample: 1 to 4 are read",
                        f->channels) < 0;
    if (!is_between(f->header_size, -1, 1e15) || !is_between(f->packed_bytes, 0, 1e15))
        return snprintf(fault, META_IMAGE_FAULT_SIZE,
                        "claims a HeaderSize of %g and a CompressedDataSize of %g: it is damaged",
                        f->header_size, f->packed_bytes) < 0;
    for (int k = 0; k < 3; k++)
        if (!is_between(f->size[k], 0, 1 << 30))
            return snprintf(fault, META_IMAGE_FAULT_SIZE, "has no numeric sizes") < 0;
    return true;
}

static bool find_type(const fields *f, volume_header *out, char fault[META_IMAGE_FAULT_SIZE],
                      error_code *code)
{
    for (size_t k = 0; k < sizeof types / sizeof *types; k++)
        if (strcmp(f->type, types[k].name) == 0) {
            out->type = types[k].type;
            return true;
        }
    *code = ERROR_INPUT_UNSUPPORTED;
    snprintf(
        fault, META_IMAGE_FAULT_SIZE,
        "the file is a MetaImage of values that are not read (%.63s): numbers of MET_CHAR to MET_DOUBLE are",
        *f->type ? f->type : "without an ElementType");
    return false;
}

/* Whether the orientation letters match the axes. A letter names the side where the axis starts; the world
 * axes point to the left (L), to posterior (P) and to superior (S). */
static bool is_oriented(const volume_header *out, const char *letters)
{
    static const char from[3][2] = {{'R', 'L'}, {'A', 'P'}, {'I', 'S'}};
    for (int k = 0; k < 3; k++) {
        int along = 0;
        for (int row = 1; row < 3; row++)
            if (fabs(out->index_to_world[4 * row + k]) > fabs(out->index_to_world[4 * along + k]))
                along = row;
        if (letters[k] != from[along][out->index_to_world[4 * along + k] < 0]) return false;
    }
    return true;
}

static void warn(const fields *f, volume_header *out)
{
    static const double none[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    const bool turned = memcmp(f->turn, none, sizeof none) != 0;
    if (turned && (f->center[0] != 0 || f->center[1] != 0 || f->center[2] != 0))
        dense_warn(
            &out->warnings,
            "CenterOfRotation is ignored, as ITK does: TransformMatrix turns the volume about Offset. Move Offset if it "
            "is to be turned about another point.");
    dense_warn_of_unit(&out->warnings, f->unit);
    if (*f->orientation && !strchr(f->orientation, '?') &&
        (strlen(f->orientation) != 3 || !is_oriented(out, f->orientation)))
        dense_warn(&out->warnings,
                   "AnatomicalOrientation = %.20s contradicts TransformMatrix and is ignored. Correct "
                   "one of the two.",
                   f->orientation);
}

/* Sets the location of the data. HeaderSize counts from the start of the data file, before decompression. */
static void place_data(const fields *f, int64_t after_header, bool local, volume_header *out)
{
    out->encoding = !f->binary ? VOLUME_HEADER_ASCII : f->packed ? VOLUME_HEADER_GZIP : VOLUME_HEADER_RAW;
    out->swapped = f->big_endian != (__BYTE_ORDER == __BIG_ENDIAN);
    out->packed_bytes = f->packed ? (int64_t)f->packed_bytes : 0;
    out->offset = f->header_size > 0 ? (int64_t)f->header_size : local ? after_header : 0;
    out->byte_skip = f->header_size == -1 ? -1 : 0;
}

static void place_samples(const fields *f, volume_header *out)
{
    const double *spacing = !isnan(f->spacing[0]) ? f->spacing : f->element_size;
    for (int k = 0; k < 3; k++) {
        const double step = isnan(spacing[k]) ? 1 : spacing[k];
        out->size[k] = (int64_t)f->size[k];
        for (int row = 0; row < 3; row++) /* each three numbers are the direction of an axis */
            out->index_to_world[4 * row + k] = f->turn[3 * k + row] * step;
        out->index_to_world[4 * k + 3] = f->origin[k];
    }
    out->index_to_world[15] = 1;
}

static char *trim(char *text)
{
    size_t length = strlen(text);
    while (length > 0 && isspace((unsigned char)text[length - 1])) text[--length] = '\0';
    return text + strspn(text, " \t");
}

/* Sets *out from the fields. `at`: offset of the data after the field ElementDataFile, which is the last
 * one. */
static bool describe(const fields *f, const char *value, int64_t at, volume_header *out,
                     char name[META_IMAGE_NAME_SIZE], char fault[META_IMAGE_FAULT_SIZE], error_code *code)
{
    const bool local =
        strcmp(value, "LOCAL") == 0 || strcmp(value, "Local") == 0 || strcmp(value, "local") == 0;
    if (strncmp(value, "LIST", 4) == 0 || strchr(value, '%')) {
        *code = ERROR_INPUT_UNSUPPORTED;
        snprintf(fault, META_IMAGE_FAULT_SIZE, "the file is a MetaImage in many files: save it as one");
        return false;
    }
    if (!check(f, fault, code) || !find_type(f, out, fault, code)) return false;
    strcpy(name, local ? "" : value);
    place_samples(f, out);
    place_data(f, at, local, out);
    out->components = (int64_t)f->channels;
    out->slope = f->slope;
    out->intercept = f->intercept;
    strcpy(out->format, "MetaImage");
    warn(f, out);
    return true;
}

/* Keys of users and of DICOM (0020|000d) may be any text; values may be empty. */
bool meta_image_parse(const char *text, volume_header *out, char name[META_IMAGE_NAME_SIZE],
                      char fault[META_IMAGE_FAULT_SIZE], error_code *code)
{
    fields f = {.channels = 1,
                .slope = 1,
                .size = {NAN, NAN, NAN},
                .spacing = {NAN, NAN, NAN},
                .element_size = {NAN, NAN, NAN},
                .turn = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                .binary = true};
    const char *at = text;
    *code = ERROR_INPUT_DAMAGED;
    for (const char *end; (end = strchr(at, '\n')); at = end + 1) {
        char key[WORD_SIZE], value[META_IMAGE_NAME_SIZE];
        const char *equals = memchr(at, '=', (size_t)(end - at));
        if (!equals) {
            if (at + strspn(at, " \t\r") == end) continue;
            snprintf(fault, META_IMAGE_FAULT_SIZE,
                     "its header has a line without \"=\": it is damaged. Correct the header.");
            return false;
        }
        const bool whole = end - equals <= (ptrdiff_t)sizeof value;
        snprintf(key, sizeof key, "%.*s", (int)(equals - at), at);
        snprintf(value, sizeof value, "%.*s", (int)(whole ? end - equals - 1 : 0), equals + 1);
        const char *name_of_field = trim(key), *meant = trim(value);
        if (strcmp(name_of_field, "ElementDataFile") == 0) {
            if (whole) return describe(&f, meant, end + 1 - text, out, name, fault, code);
            break;
        }
        take(&f, name_of_field, meant);
    }
    snprintf(fault, META_IMAGE_FAULT_SIZE,
             "its header does not state where its data are: it is damaged or truncated. Save it "
             "again.");
    return false;
}

// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/meta_image.h"

#include <assert.h>
#include <ctype.h>
#include <endian.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "io/volumes/file_pattern.h"

enum { WORD_SIZE = 64 };

/* The fields that are used. NAN: a number is missing. */
typedef struct fields {
    double dimensions, channels, header_size, packed_bytes, slope, intercept;
    double size[3], spacing[3], element_size[3], origin[3], turn[9], center[3];
    bool big_endian, packed, binary;
    char type[WORD_SIZE], unit[WORD_SIZE], orientation[WORD_SIZE];
} fields;

enum { TEXT_SIZE = 256, UNUSED_NAMES = 160 };
/* More than there are different fields. */
enum { FIELDS_MOST = 24 };

/* The state of reading a header. */
typedef struct parsing {
    fields fields;
    /* the fields that were set: their places in `fields`, keys and values as they are in the file */
    struct {
        size_t offset;
        char key[WORD_SIZE], value[TEXT_SIZE];
    } set[FIELDS_MOST];
    int count;
    char unused[UNUSED_NAMES]; /* keys that are not known */
    char *fault;
} parsing;

/* Names of the fields; some fields have several: the same offset. */
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

/* Keys of this form that do not affect samples or positions. Others may be misspelt. */
static const char prefix[] = "Element";
static const char *const harmless[] = {"ElementMin", "ElementMax", "ElementNBits"};

static const struct {
    const char *name;
    number_type type;
} types[] = {{"MET_CHAR", NUMBER_INT8},       {"MET_UCHAR", NUMBER_UINT8},       {"MET_SHORT", NUMBER_INT16},
             {"MET_USHORT", NUMBER_UINT16},   {"MET_INT", NUMBER_INT32},         {"MET_UINT", NUMBER_UINT32},
             {"MET_LONG_LONG", NUMBER_INT64}, {"MET_ULONG_LONG", NUMBER_UINT64}, {"MET_FLOAT", NUMBER_FLOAT},
             {"MET_DOUBLE", NUMBER_DOUBLE}};

static bool take_numbers(parsing *p, const char *key, const char *value, double *out, int count)
{
    char *end;
    const char *at = value;
    for (int k = 0; k < count; k++, at = end) {
        double number = strtod(at, &end);
        if (end == at && p->fields.dimensions < 3 && k >= p->fields.dimensions)
            return true; /* check() refuses two dimensions */
        if (end == at)
            return snprintf(p->fault, META_IMAGE_FAULT_SIZE,
                            "its field %.63s has too few numbers (%.60s): it is damaged. Correct the header.",
                            key, value) < 0;
        if (!isfinite(number)) /* NaN: the field is absent */
            return snprintf(p->fault, META_IMAGE_FAULT_SIZE,
                            "its field %.63s has a number that is not finite (%.60s): correct the header",
                            key, value) < 0;
        out[k] = number;
    }
    if (p->fields.dimensions > 3 || !at[strspn(at, " \t")]) return true; /* check() refuses four dimensions */
    return snprintf(p->fault, META_IMAGE_FAULT_SIZE,
                    "its field %.63s has more than %d number%s (%.60s): it is damaged. Correct the header.",
                    key, count, count == 1 ? "" : "s", value) < 0;
}

static bool take_switch(parsing *p, const char *key, const char *value, bool *out)
{
    *out = strcasecmp(value, "true") == 0 || strcmp(value, "1") == 0;
    if (*out || strcasecmp(value, "false") == 0 || strcmp(value, "0") == 0) return true;
    return snprintf(p->fault, META_IMAGE_FAULT_SIZE,
                    "its field %.63s is \"%.40s\", and only True and False are valid: correct the header",
                    key, value) < 0;
}

/* Notes that a field is set. Refuses a second value that is another, also by another name of the field. */
static bool note_set(parsing *p, size_t offset, const char *key, const char *value)
{
    for (int k = 0; k < p->count; k++) {
        if (p->set[k].offset != offset) continue;
        return strncmp(p->set[k].value, value, TEXT_SIZE - 1) == 0 ||
               snprintf(
                   p->fault, META_IMAGE_FAULT_SIZE,
                   "its fields %.63s = %.50s and %.63s = %.50s contradict each other: remove the wrong one",
                   p->set[k].key, p->set[k].value, key, value) < 0;
    }
    assert(p->count < FIELDS_MOST);
    p->set[p->count].offset = offset;
    snprintf(p->set[p->count].key, WORD_SIZE, "%s", key);
    snprintf(p->set[p->count++].value, TEXT_SIZE, "%s", value);
    return true;
}

/* Notes a key that looks like one of the format and is not known. Other keys are those of users. */
static void note_unused(parsing *p, const char *key)
{
    const size_t used = strlen(p->unused);
    bool is_suspect = strncasecmp(key, prefix, sizeof prefix - 1) == 0;
    for (size_t k = 0; k < sizeof harmless / sizeof *harmless; k++)
        is_suspect = is_suspect && strcmp(key, harmless[k]) != 0;
    for (size_t k = 0; k < sizeof numbers / sizeof *numbers; k++)
        is_suspect = is_suspect || strcasecmp(key, numbers[k].key) == 0;
    for (size_t k = 0; k < sizeof switches / sizeof *switches; k++)
        is_suspect = is_suspect || strcasecmp(key, switches[k].key) == 0;
    if (is_suspect && used + strlen(key) + 3 <= sizeof p->unused)
        snprintf(p->unused + used, sizeof p->unused - used, "%s%s", used ? ", " : "", key);
}

/* Takes a field. False: it is refused. */
static bool take(parsing *p, const char *key, const char *value)
{
    char *const base = (char *)&p->fields;
    for (size_t k = 0; k < sizeof numbers / sizeof *numbers; k++)
        if (strcmp(key, numbers[k].key) == 0)
            return note_set(p, numbers[k].offset, key, value) &&
                   take_numbers(p, key, value, (double *)(void *)(base + numbers[k].offset),
                                numbers[k].count);
    for (size_t k = 0; k < sizeof switches / sizeof *switches; k++)
        if (strcmp(key, switches[k].key) == 0)
            return note_set(p, switches[k].offset, key, value) &&
                   take_switch(p, key, value, (bool *)(base + switches[k].offset));
    for (size_t k = 0; k < sizeof words / sizeof *words; k++)
        if (strcmp(key, words[k].key) == 0) {
            snprintf(base + words[k].offset, WORD_SIZE, "%s", value);
            return note_set(p, words[k].offset, key, value);
        }
    note_unused(p, key);
    return true;
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

/* Whether the value is a pattern of file names: FORMAT [MIN [MAX [STEP]]]. */
static bool is_numbered(const char *value)
{
    char pattern[TEXT_SIZE];
    return snprintf(pattern, sizeof pattern, "%.*s", (int)strcspn(value, " \t"), value) < TEXT_SIZE &&
           file_pattern_is(pattern);
}

/* Sets *out from the fields. `at`: offset of the data after the field ElementDataFile, which is the last
 * one. */
static bool describe(const fields *f, const char *value, int64_t at, volume_header *out,
                     char name[META_IMAGE_NAME_SIZE], char fault[META_IMAGE_FAULT_SIZE], error_code *code)
{
    const bool local =
        strcmp(value, "LOCAL") == 0 || strcmp(value, "Local") == 0 || strcmp(value, "local") == 0;
    if (strncmp(value, "LIST", 4) == 0 || is_numbered(value)) {
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
    parsing p = {.fields = {.channels = 1,
                            .slope = 1,
                            .size = {NAN, NAN, NAN},
                            .spacing = {NAN, NAN, NAN},
                            .element_size = {NAN, NAN, NAN},
                            .turn = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                            .binary = true},
                 .fault = fault};
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
            if (!whole) break;
            if (!describe(&p.fields, meant, end + 1 - text, out, name, fault, code)) return false;
            if (*p.unused)
                dense_warn(&out->warnings, "The header's fields %s are not known and not used.", p.unused);
            return true;
        }
        if (!take(&p, name_of_field, meant)) return false;
    }
    snprintf(fault, META_IMAGE_FAULT_SIZE,
             "its header does not state where its data are: it is damaged or truncated. Save it "
             "again.");
    return false;
}

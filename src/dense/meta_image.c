#include "dense/meta_image.h"

#include <endian.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum { KEY_MOST = 64, VALUE_MOST = META_IMAGE_NAME_SIZE };

/* The fields that matter, by any of their names. */
typedef struct fields {
    int dimensions, channels, type; /* type: -1 if there is none */
    bool big_endian, packed;
    double size[3], spacing[3], origin[3], turn[9];
    long header_size;
    long long packed_bytes; /* 0: not said */
} fields;

static const struct {
    const char *name;
    header_type type;
} types[] = {{"MET_CHAR", HEADER_INT8},       {"MET_UCHAR", HEADER_UINT8},       {"MET_SHORT", HEADER_INT16},
             {"MET_USHORT", HEADER_UINT16},   {"MET_INT", HEADER_INT32},         {"MET_UINT", HEADER_UINT32},
             {"MET_LONG_LONG", HEADER_INT64}, {"MET_ULONG_LONG", HEADER_UINT64}, {"MET_FLOAT", HEADER_FLOAT},
             {"MET_DOUBLE", HEADER_DOUBLE}};

bool meta_image_is(const char *text)
{
    static const char *const first[] = {"ObjectType", "NDims", "Comment"};
    for (size_t k = 0; k < sizeof first / sizeof *first; k++) {
        size_t n = strlen(first[k]);
        if (strncmp(text, first[k], n) == 0 && text[n + strspn(text + n, " \t")] == '=')
            return strstr(text, "NDims") != NULL;
    }
    return false;
}

static void read_numbers(const char *value, double *out, int count)
{
    char *end;
    for (int k = 0; k < count; k++, value = end) {
        double number = strtod(value, &end);
        if (end == value) return;
        out[k] = number;
    }
}

static void take(fields *f, const char *key, const char *value)
{
    static const char *const origins[] = {"Offset", "Position", "Origin"}, *const turns[] = {
                                                                               "TransformMatrix", "Rotation",
                                                                               "Orientation"};
    for (size_t k = 0; k < 3; k++) {
        if (strcmp(key, origins[k]) == 0) read_numbers(value, f->origin, 3);
        if (strcmp(key, turns[k]) == 0) read_numbers(value, f->turn, 9);
    }
    if (strcmp(key, "NDims") == 0) f->dimensions = atoi(value);
    if (strcmp(key, "DimSize") == 0) read_numbers(value, f->size, 3);
    if (strcmp(key, "ElementSpacing") == 0) read_numbers(value, f->spacing, 3);
    if (strcmp(key, "ElementNumberOfChannels") == 0) f->channels = atoi(value);
    if (strcmp(key, "HeaderSize") == 0) f->header_size = strtol(value, NULL, 10);
    if (strcmp(key, "CompressedDataSize") == 0) f->packed_bytes = strtoll(value, NULL, 10);
    if (strcmp(key, "CompressedData") == 0) f->packed = strncasecmp(value, "true", 4) == 0;
    if (strcmp(key, "ElementByteOrderMSB") == 0 || strcmp(key, "BinaryDataByteOrderMSB") == 0)
        f->big_endian = strncasecmp(value, "true", 4) == 0;
    if (strcmp(key, "ElementType") == 0)
        for (size_t k = 0; k < sizeof types / sizeof *types; k++)
            if (strcmp(value, types[k].name) == 0) f->type = (int)types[k].type;
}

static const char *describe(const fields *f, header *out, error_code *code)
{
    *code = ERROR_INPUT_UNSUPPORTED;
    if (f->dimensions != 3) return "the file is a MetaImage that is not of three dimensions";
    if (f->type < 0)
        return "the file is a MetaImage of values that are not read: numbers of MET_CHAR to MET_DOUBLE are";
    *code = ERROR_INPUT_DAMAGED;
    if (f->channels < 1 || f->channels > 4) return "claims more than four values at each sample";
    for (int k = 0; k < 3; k++) {
        if (!(f->size[k] >= 0 && f->size[k] <= 1 << 30)) return "has no sizes that are numbers";
        out->size[k] = (int64_t)f->size[k];
        for (int row = 0; row < 3; row++) /* each three numbers are the direction of an axis */
            out->index_to_world[4 * row + k] = f->turn[3 * k + row] * f->spacing[k];
        out->index_to_world[4 * k + 3] = f->origin[k];
    }
    out->index_to_world[15] = 1;
    out->components = f->channels;
    out->type = (uint32_t)f->type;
    out->packed_bytes = f->packed && f->packed_bytes > 0 ? f->packed_bytes : 0;
    out->encoding = f->packed ? HEADER_GZIP : HEADER_RAW;
    out->swapped = f->big_endian != (__BYTE_ORDER == __BIG_ENDIAN);
    out->byte_skip = f->header_size > 0 ? f->header_size : f->header_size == -1 ? -1 : 0;
    strcpy(out->format, "MetaImage");
    return NULL;
}

const char *meta_image_parse(const char *text, header *out, char name[META_IMAGE_NAME_SIZE], error_code *code)
{
    fields f = {.channels = 1, .type = -1, .spacing = {1, 1, 1}, .turn = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    const char *at = text;
    for (const char *end; (end = strchr(at, '\n')); at = end + 1) {
        char key[KEY_MOST], value[VALUE_MOST] = "";
        if (sscanf(at, "%63[A-Za-z] = %511[^\r\n]", key, value) != 2) break;
        take(&f, key, value);
        if (strcmp(key, "ElementDataFile") != 0) continue;
        bool local =
            strcmp(value, "LOCAL") == 0 || strcmp(value, "Local") == 0 || strcmp(value, "local") == 0;
        if (strncmp(value, "LIST", 4) == 0 || strchr(value, '%')) {
            *code = ERROR_INPUT_UNSUPPORTED;
            return "the file is a MetaImage in many files: save it as one";
        }
        strcpy(name, local ? "" : value);
        out->offset = end + 1 - text;
        return describe(&f, out, code);
    }
    *code = ERROR_INPUT_DAMAGED;
    return "its header does not say where its data are: it is damaged or cut off";
}

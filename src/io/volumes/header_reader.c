// SPDX-License-Identifier: Apache-2.0
/* header_reader: parses NRRD and NIfTI headers with Teem and libnifti, in the process that reads
 * (volume_header.h). */
#include "io/volumes/volume_header.h"

#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <nifti2_io.h>
#include <teem/nrrd.h>

#include "base/core/file_format.h"
#include "base/core/reader.h"
#include "base/core/transfer.h"
#include "io/volumes/file_pattern.h"
#include "io/volumes/meta_image.h"

/* Maximum size of a header; headers have a few kB. */
#define HEAD_MAX (1u << 20)
/* Maximum length of an NRRD field: Teem copies units and kinds into buffers slightly larger than this. */
#define FIELD_MAX 1000
/* Maximum number of data files of a header. */
static const long most_files = 65536;

/* The answer of the process to its only request. */
typedef struct answer {
    volume_header head;
    error_code code;
    char *text; /* the message, or the names of data files; capacity VOLUME_HEADER_TEXT_MAX */
    size_t text_length;
} answer;

static bool refuse(answer *a, error_code code, const char *format, ...) __attribute__((format(printf, 3, 4)));

static bool refuse(answer *a, error_code code, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    a->code = code;
    vsnprintf(a->text, sizeof((error *)0)->message, format, arguments);
    a->text_length = strlen(a->text);
    va_end(arguments);
    return false;
}

/* ---- the names of data files */

static bool add_name(answer *a, const char *name, size_t length)
{
    if (length == 0 || a->text_length + length + 1 >= VOLUME_HEADER_TEXT_MAX ||
        a->head.file_count == most_files)
        return refuse(a, ERROR_INPUT_UNSUPPORTED, "lists more than %ld data files, or one without a name",
                      most_files);
    memcpy(a->text + a->text_length, name, length);
    a->text_length += length;
    a->text[a->text_length++] = '\n';
    a->head.file_count++;
    return true;
}

static bool is_int32(long value)
{
    return value >= INT32_MIN && value <= INT32_MAX;
}

/* Splits off the last word of `text` if it is an integer. False, with `text` unchanged: it is not. */
static bool take_last_integer(char *text, long *out)
{
    size_t end = strlen(text), at;
    while (end > 0 && strchr(" \t", text[end - 1])) end--;
    for (at = end; at > 0 && !strchr(" \t", text[at - 1]);) at--;
    char *after;
    const long value = strtol(text + at, &after, 10);
    if (at == 0 || after != text + end || end == at) return false;
    *out = value;
    while (at > 0 && strchr(" \t", text[at - 1])) at--;
    text[at] = '\0';
    return true;
}

/* Adds names of data files: "FORMAT MIN MAX STEP [DIMENSION]", or one name. Both may have spaces. */
static bool add_names(answer *a, const char *value)
{
    char pattern[512], name[512];
    long number[4]; /* the last first */
    int count = 0;
    const bool whole = snprintf(pattern, sizeof pattern, "%s", value) < (int)sizeof pattern;
    while (whole && count < 4 && take_last_integer(pattern, &number[count])) count++;
    if (!whole || count < 3 || !strchr(pattern, '%')) return add_name(a, value, strlen(value));
    const long step = number[count - 3], last = number[count - 2], first = number[count - 1];
    if (!file_pattern_is(pattern) || step == 0 || !is_int32(first) || !is_int32(last) || !is_int32(step))
        return refuse(a, ERROR_INPUT_DAMAGED,
                      "its data files \"%.200s\" are not given as FORMAT MIN MAX STEP", value);
    for (long k = first; step > 0 ? k <= last : k >= last; k += step) {
        int length = snprintf(name, sizeof name, pattern, (int)k);
        if (length >= (int)sizeof name)
            return refuse(a, ERROR_INPUT_DAMAGED, "its data files \"%.200s\" have names beyond %zu bytes",
                          value, sizeof name - 1);
        if (!add_name(a, name, (size_t)length)) return false;
    }
    return a->head.file_count > 0 || refuse(a, ERROR_INPUT_DAMAGED, "lists no data file: \"%.200s\"", value);
}

/* ---- NRRD */

/* The value of the line if its field has one of the two names; otherwise NULL. */
static char *field_of(char *line, const char *name, const char *other)
{
    size_t length = strcspn(line, ":");
    bool is = line[length] && line[length + 1] != '=' &&
              ((length == strlen(name) && strncmp(line, name, length) == 0) ||
               (length == strlen(other) && strncmp(line, other, length) == 0));
    if (!is) return NULL;
    line += length + 1;
    return line + strspn(line, " \t");
}

/* Whether the line is a comment or a key/value pair: these may have any length, and do not affect the
 * data. */
static bool is_remark(const char *line)
{
    return *line == '#' || strncmp(line + strcspn(line, ":"), ":=", 2) == 0;
}

static const long long NOT_SET = LLONG_MIN;

/* Reads a skip to its end. Refuses a second one. */
static bool take_skip(answer *a, const char *field, const char *value, long long least, long long most,
                      long long *out)
{
    char *end;
    errno = 0;
    const long long number = strtoll(value, &end, 10);
    if (*out != NOT_SET)
        return refuse(a, ERROR_INPUT_DAMAGED, "its header has the field %s twice: remove one of them", field);
    if (end == value || end[strspn(end, " \t")] || errno || number < least || number > most)
        return refuse(a, ERROR_INPUT_DAMAGED, "its field \"%s: %.40s\" is not a number from %lld to %lld",
                      field, value, least, most);
    *out = number;
    return true;
}

/* Refuses a field of numbers with a word that is none, such as "1,5": Teem reads a word up to its comma. */
static bool check_numbers(answer *a, char *line)
{
    static const char *const names[][2] = {{"sizes", "sizes"},        {"dimension", "dimension"},
                                           {"spacings", "spacings"},  {"thicknesses", "thicknesses"},
                                           {"axis mins", "axismins"}, {"axis maxs", "axismaxs"},
                                           {"old min", "oldmin"},     {"old max", "oldmax"}};
    for (size_t k = 0; k < sizeof names / sizeof *names; k++) {
        const char *at = field_of(line, names[k][0], names[k][1]);
        while (at && *(at += strspn(at, " \t"))) {
            char *end;
            const int length = (int)strcspn(at, " \t");
            strtod(at, &end);
            if (end != at + length)
                return refuse(
                    a, ERROR_INPUT_DAMAGED,
                    "its field %s has \"%.*s\", which is not a number: write numbers with a decimal "
                    "point",
                    names[k][0], length < 40 ? length : 40, at);
            at = end;
        }
    }
    return true;
}

/* Removes the fields that locate the data: Teem opens the data files and skips bytes even if only the
 * header is requested. Also removes fields that are parsed without Teem, and refuses lines that exceed
 * its buffers. */
static bool take_places(answer *a, char *text, char *rest)
{
    bool listed = false;
    long long lines = NOT_SET, bytes = NOT_SET;
    for (char *line = strtok(text, "\n"); line; line = strtok(NULL, "\n")) {
        size_t length = strlen(line);
        if (length > 0 && line[length - 1] == '\r') line[--length] = '\0';
        char *value;
        if (listed) {
            if (length > 0 && !add_name(a, line, length)) return false;
        } else if ((value = field_of(line, "data file", "datafile"))) {
            if (a->head.file_count > 0)
                return refuse(a, ERROR_INPUT_DAMAGED,
                              "its header has the field data file twice: remove one of them");
            listed = strncmp(value, "LIST", 4) == 0;
            if (!listed && !add_names(a, value)) return false;
        } else if ((value = field_of(line, "line skip", "lineskip"))) {
            if (!take_skip(a, "line skip", value, 0, UINT32_MAX, &lines)) return false;
            a->head.line_skip = (uint32_t)lines;
        } else if ((value = field_of(line, "byte skip", "byteskip"))) {
            if (!take_skip(a, "byte skip", value, -INT64_MAX, INT64_MAX, &bytes)) return false;
            a->head.byte_skip = bytes;
        } else if (is_remark(line)) {
            dense_note_no_data(&a->head.warnings, line);
        } else {
            if (length > FIELD_MAX)
                return refuse(a, ERROR_INPUT_DAMAGED,
                              "a field of its header has %zu characters, and at most %d are read: \"%.40s\"",
                              length, FIELD_MAX, line);
            if (!check_numbers(a, line)) return false;
            rest = stpcpy(stpcpy(rest, line), "\n");
        }
    }
    return !listed || a->head.file_count > 0 || refuse(a, ERROR_INPUT_DAMAGED, "lists no data file");
}

static bool type_of_nrrd(answer *a, int type)
{
    static const struct {
        int nrrd;
        number_type type;
    } types[] = {{nrrdTypeChar, NUMBER_INT8},   {nrrdTypeUChar, NUMBER_UINT8},
                 {nrrdTypeShort, NUMBER_INT16}, {nrrdTypeUShort, NUMBER_UINT16},
                 {nrrdTypeInt, NUMBER_INT32},   {nrrdTypeUInt, NUMBER_UINT32},
                 {nrrdTypeLLong, NUMBER_INT64}, {nrrdTypeULLong, NUMBER_UINT64},
                 {nrrdTypeFloat, NUMBER_FLOAT}, {nrrdTypeDouble, NUMBER_DOUBLE}};
    for (size_t k = 0; k < sizeof types / sizeof types[0]; k++)
        if (types[k].nrrd == type) {
            a->head.type = types[k].type;
            return true;
        }
    return refuse(a, ERROR_INPUT_UNSUPPORTED, "the file has values of type \"%s\": convert them to numbers",
                  airEnumStr(nrrdType, type));
}

static bool encoding_of_nrrd(answer *a, const NrrdIoState *io)
{
    if (io->encoding == nrrdEncodingRaw)
        a->head.encoding = VOLUME_HEADER_RAW;
    else if (io->encoding == nrrdEncodingGzip)
        a->head.encoding = VOLUME_HEADER_GZIP;
    else if (io->encoding == nrrdEncodingAscii)
        a->head.encoding = VOLUME_HEADER_ASCII;
    else
        return refuse(
            a, ERROR_INPUT_UNSUPPORTED,
            "the file has the encoding \"%s\": raw, gzip and ascii are read (`unu save -e gzip` converts)",
            io->encoding->name);
    return true;
}

/* Whether the fastest axis holds the components of a sample: its kind is a list or vector, or, if the kind
 * is unknown, it is the only axis without a direction. */
static bool begins_with_values(const Nrrd *n)
{
    const NrrdAxisInfo *first = &n->axis[0];
    if (n->dim < 2 || n->dim > 4 || first->size < 2 || first->size > 4) return false;
    if (first->kind == nrrdKindUnknown)
        return n->dim == 4 && isnan(first->spaceDirection[0]) && !isnan(n->axis[1].spaceDirection[0]);
    return n->dim == 4 && first->kind >= nrrdKindList;
}

/* Sets the number of components per sample, and the rotation of vectors if the file has one. */
static void values_of_nrrd(answer *a, const Nrrd *n)
{
    const NrrdAxisInfo *first = &n->axis[0];
    bool vector = first->kind == nrrdKindUnknown || first->kind == nrrdKindVector ||
                  first->kind == nrrdKind3Vector || first->kind == nrrdKindList;
    a->head.components = (int64_t)first->size;
    for (int row = 0; row < 3; row++)
        for (int column = 0; vector && column < 3 && n->spaceDim == 3; column++) {
            double value = n->measurementFrame[column][row];
            a->head.vector_to_world[3 * row + column] = isfinite(value) ? value : 0;
        }
}

/* Tolerance, as a fraction of a sample, for the agreement of spacings with the ends of axes: both are
 * written with few digits. */
static const double most_apart = 0.01;

/* Finds the three axes with more than one sample, fastest first: axes of one sample do not change the
 * order. */
static bool axes_of_nrrd(answer *a, const Nrrd *n, const NrrdAxisInfo *axis[3])
{
    unsigned found = 0, first = begins_with_values(n);
    char sizes[160] = "";
    if (first) values_of_nrrd(a, n);
    for (unsigned k = first; k < n->dim; k++) {
        size_t used = strlen(sizes);
        snprintf(sizes + used, sizeof sizes - used, "%s%zu", used ? " x " : "", n->axis[k].size);
        if (n->dim > 3 + first && n->axis[k].size == 1) continue;
        if (found < 3) axis[found] = &n->axis[k];
        found++;
    }
    if (found != 3)
        return refuse(a, ERROR_INPUT_UNSUPPORTED,
                      "the file has the sizes %s: give a volume with three axes of at least two samples, "
                      "and others of one sample only (`unu slice` extracts one volume of several)",
                      sizes);
    for (int k = 0; k < 3; k++) {
        int kind = axis[k]->kind;
        if (kind != nrrdKindUnknown && kind != nrrdKindDomain && kind != nrrdKindSpace)
            return refuse(a, ERROR_INPUT_UNSUPPORTED,
                          "the file has an axis of kind \"%s\" (%s): give a volume with three axes of space",
                          airEnumStr(nrrdKind, kind), sizes);
        a->head.size[k] = (int64_t)axis[k]->size;
    }
    return true;
}

/* Sets the transform without space directions: from the spacings and the minima of the axes. A minimum is
 * the edge of a cell or the position of a sample. */
static void place_by_spacings(answer *a, const NrrdAxisInfo *axis[3], const double origin[3])
{
    double *m = a->head.index_to_world;
    bool open = false, differ = false;
    for (int k = 0; k < 3; k++) {
        bool cells = axis[k]->center == nrrdCenterCell;
        double steps = (double)axis[k]->size - (cells ? 0 : 1), spacing = axis[k]->spacing,
               min = axis[k]->min, max = axis[k]->max;
        if (!isfinite(spacing)) spacing = (max - min) / steps;
        if (!isfinite(spacing) || spacing == 0) spacing = 1;
        if (!isfinite(min)) min = max - spacing * steps;
        m[5 * k] = spacing;
        if (isfinite(min)) m[4 * k + 3] = min + (cells ? spacing / 2 : 0);
        if (isfinite(origin[k])) m[4 * k + 3] = origin[k];
        open |= isfinite(min) && axis[k]->center == nrrdCenterUnknown;
        /* false for NaN */
        differ |= fabs(max - min - spacing * steps) > most_apart * fabs(spacing);
    }
    if (open)
        dense_warn(
            &a->head.warnings,
            "The header has axis mins or axis maxs and no centerings: they are taken for the places of the first and "
            "last samples. Add centerings.");
    if (differ)
        dense_warn(
            &a->head.warnings,
            "The header's axis mins, axis maxs and spacings contradict each other: the spacings and the axis mins "
            "are used. Correct the header.");
}

static bool place_of_nrrd(answer *a, const Nrrd *n, const NrrdAxisInfo *axis[3])
{
    double *m = a->head.index_to_world;
    int directed = 0;
    for (int k = 0; k < 3; k++) directed += !isnan(axis[k]->spaceDirection[0]);
    m[15] = 1;
    if (n->space != nrrdSpaceUnknown)
        snprintf(a->head.space, sizeof a->head.space, "%s", airEnumStr(nrrdSpace, n->space));
    if (directed == 0) {
        place_by_spacings(a, axis, n->spaceOrigin);
        return true;
    }
    if (directed != 3 || n->spaceDim != 3)
        return refuse(
            a, ERROR_INPUT_UNSUPPORTED,
            "the file has space directions for %d of its axes in %u dimensions: three in three are needed",
            directed, n->spaceDim);
    for (int row = 0; row < 3; row++) {
        for (int k = 0; k < 3; k++) m[4 * row + k] = axis[k]->spaceDirection[row];
        m[4 * row + 3] = isfinite(n->spaceOrigin[row]) ? n->spaceOrigin[row] : 0;
    }
    return true;
}

/* Warns of ignored fields that could change the meaning of values or positions. */
static void warn_of_nrrd(answer *a, const Nrrd *n, const NrrdAxisInfo *axis[3])
{
    const char *unit = "";
    for (int k = 2; k >= 0; k--) {
        if (axis[k]->units && *axis[k]->units) unit = axis[k]->units;
        if (k < (int)n->spaceDim && n->spaceUnits[k] && *n->spaceUnits[k]) unit = n->spaceUnits[k];
    }
    dense_warn_of_unit(&a->head.warnings, unit);
    if (isfinite(n->oldMin) || isfinite(n->oldMax))
        dense_warn(
            &a->head.warnings,
            "The header's old min (%g) and old max (%g) are ignored: an isovalue is one of the numbers in the file. "
            "Convert the values back with `unu unquantize` if they are meant.",
            n->oldMin, n->oldMax);
}

static bool describe_nrrd(answer *a, const Nrrd *n, const NrrdIoState *io)
{
    const NrrdAxisInfo *axis[3];
    if (!axes_of_nrrd(a, n, axis) || !type_of_nrrd(a, n->type) || !encoding_of_nrrd(a, io) ||
        !place_of_nrrd(a, n, axis))
        return false;
    a->head.swapped = io->encoding->endianMatters && nrrdTypeSize[n->type] > 1 && io->endian != airMyEndian();
    strcpy(a->head.format, "NRRD");
    warn_of_nrrd(a, n, axis);
    return true;
}

/* Refuses the file with the innermost line of the library's message, without the name of the library. */
static bool complain(answer *a, char *messages)
{
    char *last = messages ? messages : (char *)"";
    for (char *line = strtok(messages, "\n"); line; line = strtok(NULL, "\n")) last = line;
    char *words = strstr(last, "] ");
    return refuse(a, ERROR_INPUT_DAMAGED, "its header cannot be read: %.400s", words ? words + 2 : last);
}

static bool read_nrrd(answer *a, char *head, size_t length)
{
    char *end = strstr(head, "\n\n"), *end_crlf = strstr(head, "\r\n\r\n"), *rest = malloc(length + 3);
    size_t text = length;
    if (end) text = (size_t)(end - head) + 2;
    if (end_crlf && (!end || end_crlf < end)) text = (size_t)(end_crlf - head) + 4;
    a->head.offset = (int64_t)text;
    head[text] = '\0';
    rest[0] = '\0';
    if (!take_places(a, head, rest)) return false;
    if (a->head.file_count > 0) a->head.offset = 0;
    size_t kept = strlen(rest);
    strcpy(rest + kept, "\n"); /* the empty line that ends a header */
    FILE *stream = fmemopen(rest, kept + 1, "rb");
    NrrdIoState *io = nrrdIoStateNew();
    Nrrd *n = nrrdNew();
    nrrdIoStateSet(io, nrrdIoStateSkipData, 1);
    if (!stream || nrrdRead(n, stream, io)) return complain(a, biffGetDone(NRRD));
    return describe_nrrd(a, n, io);
}

/* ---- NIfTI */

static bool type_of_nifti(answer *a, int type)
{
    static const struct {
        int nifti;
        number_type type;
    } types[] = {{DT_INT8, NUMBER_INT8},     {DT_UINT8, NUMBER_UINT8},   {DT_INT16, NUMBER_INT16},
                 {DT_UINT16, NUMBER_UINT16}, {DT_INT32, NUMBER_INT32},   {DT_UINT32, NUMBER_UINT32},
                 {DT_INT64, NUMBER_INT64},   {DT_UINT64, NUMBER_UINT64}, {DT_FLOAT32, NUMBER_FLOAT},
                 {DT_FLOAT64, NUMBER_DOUBLE}};
    for (size_t k = 0; k < sizeof types / sizeof types[0]; k++)
        if (types[k].nifti == type) {
            a->head.type = types[k].type;
            return true;
        }
    return refuse(a, ERROR_INPUT_UNSUPPORTED, "the file has values of type %s: convert them to real numbers",
                  nifti_datatype_string(type));
}

/* The maximum distance between the positions of a corner of the volume by sform and by qform. */
static double forms_apart(const nifti_image *n)
{
    const double last[3] = {(double)n->nx - 1, (double)n->ny - 1, (double)n->nz - 1};
    double most = 0;
    for (int corner = 0; corner < 8; corner++) {
        double square = 0;
        for (int i = 0; i < 3; i++) {
            double apart = n->sto_xyz.m[i][3] - n->qto_xyz.m[i][3];
            for (int k = 0; k < 3; k++)
                apart += (corner >> k & 1) * last[k] * (n->sto_xyz.m[i][k] - n->qto_xyz.m[i][k]);
            square += apart * apart;
        }
        most = fmax(most, sqrt(square));
    }
    return most;
}

/* sform and qform agree if this distance is at most this fraction of the smallest side of a voxel: they are
 * stored as floats. */
static const double forms_agree = 0.01;

/* `pixdim`: as in the file; the library replaces sizes that are not valid. */
static void warn_of_places(answer *a, const nifti_image *n, const double pixdim[3])
{
    const double *size = pixdim;
    const double apart = forms_apart(n), voxel = fmin(fabs(n->dx), fmin(fabs(n->dy), fabs(n->dz)));
    if (n->sform_code > 0 && n->qform_code > 0 && !(apart <= forms_agree * voxel))
        dense_warn(
            &a->head.warnings,
            "sform (code %d) and qform (code %d) place a corner of the volume %.4g apart: the sform is used. Delete "
            "the wrong one from the header.",
            n->sform_code, n->qform_code, apart);
    for (int k = 0; k < 3 && n->sform_code <= 0; k++)
        if (!(size[k] > 0 && isfinite(size[k]))) {
            dense_warn(&a->head.warnings,
                       "pixdim %d is %g, which is not a valid voxel size: %g is used. Correct the header.",
                       k + 1, size[k],
                       n->qform_code > 0 || size[k] == 0 || !isfinite(size[k]) ? 1 : -size[k]);
            break;
        }
    dense_warn_of_unit(&a->head.warnings, n->xyz_units == NIFTI_UNITS_METER    ? "m"
                                          : n->xyz_units == NIFTI_UNITS_MICRON ? "um"
                                                                               : "");
}

/* Sets the transform: sform, else qform, else the sizes of voxels, as the standard requires. */
static void place_of_nifti(answer *a, const nifti_image *n, const double pixdim[3])
{
    const nifti_dmat44 *m = n->sform_code > 0 ? &n->sto_xyz : &n->qto_xyz;
    warn_of_places(a, n, pixdim);
    a->head.index_to_world[15] = 1;
    if (n->sform_code > 0 || n->qform_code > 0) {
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 4; j++) a->head.index_to_world[4 * i + j] = m->m[i][j];
        strcpy(a->head.space, "right-anterior-superior");
        return;
    }
    const double size[3] = {n->dx, n->dy, n->dz};
    for (int k = 0; k < 3; k++)
        a->head.index_to_world[5 * k] = isfinite(size[k]) && size[k] != 0 ? fabs(size[k]) : 1;
}

/* Sets the name of the data file for a header called NAME.hdr. */
static bool name_of_image(answer *a, const char *name)
{
    char image[300];
    size_t length = strlen(name);
    if (length < 4 || length > 256 || strcmp(name + length - 4, ".hdr") != 0)
        return refuse(a, ERROR_INPUT_UNSUPPORTED,
                      "the file is a header whose data are in another file: it must end in .hdr");
    snprintf(image, sizeof image, "%.*s.img", (int)length - 4, name);
    return add_name(a, image, strlen(image));
}

/* A slope of 0 means that values are not scaled, whatever the intercept. The library gives 0 for NaN,
 * which nibabel writes. */
static void scale_of_nifti(answer *a, const nifti_image *n)
{
    if (n->scl_slope != 0) {
        a->head.slope = n->scl_slope;
        a->head.intercept = n->scl_inter;
    } else if (n->scl_inter != 0) {
        dense_warn(
            &a->head.warnings,
            "scl_slope is 0 and scl_inter is %g, which the standard does not apply: the numbers in the file are the "
            "values. Set scl_slope to 1 if scl_inter is meant.",
            n->scl_inter);
    }
}

/* The start of a file: its header, and fields before the library replaces those that are not valid. */
typedef struct nifti_head {
    const char *bytes;
    size_t length;       /* number of unpacked bytes in `bytes` */
    size_t header_bytes; /* length of the header, without the four bytes of the extender */
    double vox_offset;
    double pixdim[3]; /* sizes of a voxel */
    double qfac, quatern[3], qoffset[3];
    int qform_code, sform_code, bitpix;
    bool swapped, packed;
} nifti_head;

static nifti_head head_of_nifti(const char *bytes, size_t length, int version, bool packed)
{
    nifti_head h = {.bytes = bytes, .length = length, .packed = packed};
    if (version == 2) {
        nifti_2_header second;
        memcpy(&second, bytes, sizeof second);
        int64_t offset = second.vox_offset;
        h.swapped = NIFTI2_NEEDS_SWAP(second);
        if (h.swapped) {
            nifti_swap_8bytes(1, &offset);
            nifti_swap_8bytes(4, second.pixdim);
            nifti_swap_8bytes(6, &second.quatern_b);
            nifti_swap_4bytes(2, &second.qform_code);
            nifti_swap_2bytes(1, &second.bitpix);
        }
        h.bitpix = second.bitpix;
        h.qfac = second.pixdim[0];
        h.qform_code = second.qform_code;
        h.sform_code = second.sform_code;
        for (int k = 0; k < 3; k++) {
            h.pixdim[k] = second.pixdim[k + 1];
            h.quatern[k] = (&second.quatern_b)[k];
            h.qoffset[k] = (&second.qoffset_x)[k];
        }
        h.header_bytes = sizeof second;
        h.vox_offset = (double)offset;
    } else {
        nifti_1_header first;
        memcpy(&first, bytes, sizeof first);
        float offset = first.vox_offset;
        h.swapped = NIFTI_NEEDS_SWAP(first);
        if (h.swapped) {
            nifti_swap_4bytes(1, &offset);
            nifti_swap_4bytes(4, first.pixdim);
            nifti_swap_4bytes(6, &first.quatern_b);
            nifti_swap_2bytes(2, &first.qform_code);
            nifti_swap_2bytes(1, &first.bitpix);
        }
        h.bitpix = first.bitpix;
        h.qfac = (double)first.pixdim[0];
        h.qform_code = first.qform_code;
        h.sform_code = first.sform_code;
        for (int k = 0; k < 3; k++) {
            h.pixdim[k] = (double)first.pixdim[k + 1];
            h.quatern[k] = (double)(&first.quatern_b)[k];
            h.qoffset[k] = (double)(&first.qoffset_x)[k];
        }
        h.header_bytes = sizeof first;
        h.vox_offset = (double)offset;
    }
    return h;
}

/* Finds the end of the extensions. Each has its length, a multiple of 16, in its first bytes; the last one
 * ends where the data begin. */
static bool find_after_extensions(answer *a, const nifti_head *h, int64_t data_bytes, int64_t *offset)
{
    struct stat st;
    int64_t at = (int64_t)h->header_bytes + 4;
    *offset = at;
    if ((int64_t)h->length < at || h->bytes[h->header_bytes] == 0) return true;
    if (h->packed || fstat(STDIN_FILENO, &st) != 0)
        return refuse(
            a, ERROR_INPUT_UNSUPPORTED,
            "its vox_offset is 0, and where its extensions end is only looked for in a file that is not "
            "packed: unpack it");
    while (at < st.st_size - data_bytes) {
        int32_t size;
        if (at + 8 > (int64_t)h->length)
            return refuse(a, ERROR_INPUT_UNSUPPORTED,
                          "its vox_offset is 0, and its extensions take more than %lld bytes",
                          (long long)h->length);
        memcpy(&size, h->bytes + at, sizeof size);
        if (h->swapped) nifti_swap_4bytes(1, &size);
        if (size < 16 || size % 16 != 0 || size > st.st_size - data_bytes - at) break;
        at += size;
    }
    *offset = at;
    return true;
}

/* Sets the offset of the data in a single file: vox_offset from the start of the file, or, if it is 0, the
 * end of the header and its extensions. */
static bool place_data_of_nifti(answer *a, const nifti_head *h, int64_t data_bytes)
{
    if (!(h->vox_offset == 0 || (h->vox_offset >= (double)h->header_bytes && h->vox_offset < 1e15)))
        return refuse(a, ERROR_INPUT_DAMAGED,
                      "its vox_offset is %g, within its header of %zu bytes: it is damaged", h->vox_offset,
                      h->header_bytes);
    a->head.byte_skip = (int64_t)h->vox_offset;
    return h->vox_offset != 0 || find_after_extensions(a, h, data_bytes, &a->head.byte_skip);
}

/* Rounding of the squares of a quaternion that was stored as floats. */
static const double quaternion_rounding = 1e-5;

static bool check_qform(answer *a, const nifti_head *h)
{
    const double *q = h->quatern, *at = h->qoffset;
    if (!(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] <= 1 + quaternion_rounding))
        return refuse(
            a, ERROR_INPUT_DAMAGED,
            "its quatern_b, quatern_c and quatern_d are (%g, %g, %g), which is not a rotation: correct the header",
            q[0], q[1], q[2]);
    if (!isfinite(h->qfac))
        return refuse(a, ERROR_INPUT_DAMAGED, "its pixdim[0] is %g, and must be 1 or -1: correct the header",
                      h->qfac);
    return (isfinite(at[0]) && isfinite(at[1]) && isfinite(at[2])) ||
           refuse(a, ERROR_INPUT_DAMAGED,
                  "its qoffset_x, qoffset_y and qoffset_z are (%g, %g, %g): correct the header", at[0], at[1],
                  at[2]);
}

static bool describe_nifti(answer *a, const nifti_image *n, const char *name, const nifti_head *h)
{
    const int64_t size[7] = {n->nx, n->ny, n->nz, n->nt, n->nu, n->nv, n->nw};
    a->head.volumes = 1;
    if (h->qform_code < 0 || h->sform_code < 0)
        dense_warn(
            &a->head.warnings,
            "qform_code is %d and sform_code is %d: a negative code counts as 0, so that its transform is not used. "
            "Correct the header.",
            h->qform_code, h->sform_code);
    if (h->bitpix != 8 * n->nbyper)
        dense_warn(&a->head.warnings,
                   "bitpix is %d, and the datatype %d has %d bits: the datatype counts. Correct the header.",
                   h->bitpix, n->datatype, 8 * n->nbyper);
    for (int k = 3; k < 7; k++)
        if (size[k] > 1 && __builtin_mul_overflow(a->head.volumes, size[k], &a->head.volumes))
            return refuse(a, ERROR_INPUT_DAMAGED, "claims more volumes than can be counted");
    for (int k = 0; k < 3; k++) a->head.size[k] = size[k];
    if (!type_of_nifti(a, n->datatype) || (n->sform_code <= 0 && n->qform_code > 0 && !check_qform(a, h)))
        return false;
    place_of_nifti(a, n, h->pixdim);
    scale_of_nifti(a, n);
    dense_note_no_data(&a->head.warnings, n->descrip);
    a->head.swapped = n->nbyper > 1 && n->byteorder != nifti_short_order();
    a->head.encoding = h->packed ? VOLUME_HEADER_GZIP : VOLUME_HEADER_RAW;
    strcpy(a->head.format, "NIfTI");
    if (n->nifti_type == NIFTI_FTYPE_NIFTI1_1 || n->nifti_type == NIFTI_FTYPE_NIFTI2_1) {
        int64_t bytes = n->nbyper;
        for (int k = 0; k < 7; k++)
            if (size[k] > 1 && __builtin_mul_overflow(bytes, size[k], &bytes)) bytes = INT64_MAX / 2;
        return place_data_of_nifti(a, h, bytes);
    }
    a->head.byte_skip = h->vox_offset > 0 && h->vox_offset < 1e15 ? (int64_t)h->vox_offset : 0;
    return name_of_image(a, name);
}

/* Checks the number of axes: the library (3.0.1) does not check it in NIfTI-2 headers, and writes beyond its
 * array. */
static bool has_axes(const nifti_2_header *h)
{
    int64_t count = h->dim[0];
    if (NIFTI2_NEEDS_SWAP(*h)) nifti_swap_8bytes(1, &count);
    return count >= 1 && count <= 7;
}

static bool read_nifti(answer *a, const char *head, size_t length, const char *name, bool packed)
{
    nifti_1_header first;
    nifti_2_header second;
    nifti_image *n = NULL;
    char called[] = "a.nii", pair[] = "a.hdr";
    nifti_set_debug_level(0);
    int version = nifti_header_version(head, length);
    const nifti_head where = head_of_nifti(head, length, version, packed);
    if (version == 2) {
        memcpy(&second, head, sizeof second);
        if (has_axes(&second)) n = nifti_convert_n2hdr2nim(second, second.magic[1] == '+' ? called : pair);
    } else {
        memcpy(&first, head, sizeof first);
        n = nifti_convert_n1hdr2nim(first, first.magic[1] == '+' ? called : pair);
    }
    if (!n)
        return refuse(a, ERROR_INPUT_DAMAGED,
                      "its NIfTI header is contradictory: it is damaged. Correct the header.");
    return describe_nifti(a, n, name, &where);
}

/* ---- MetaImage */

static bool read_meta_image(answer *a, const char *head)
{
    char name[META_IMAGE_NAME_SIZE], fault[META_IMAGE_FAULT_SIZE];
    error_code code;
    if (!meta_image_parse(head, &a->head, name, fault, &code)) return refuse(a, code, "%s", fault);
    return !*name || add_name(a, name, strlen(name));
}

/* ---- the program */

static size_t read_head(char *to, size_t size)
{
    const int64_t count = transfer_read_at(STDIN_FILENO, to, size, 0);
    return count > 0 ? (size_t)count : 0;
}

/* The message for a file that is not NRRD, NIfTI or MetaImage, by the format that its first bytes
 * indicate. */
static const char *guess(const char *head, size_t length)
{
    const char *found = file_formats[file_format_of_bytes(head, length)].as_volume;
    return found ? found : file_formats[FILE_FORMAT_RAW].as_volume;
}

/* `head` has the first `length` bytes of the file, followed by zeros. */
static bool read_header(answer *a, char *head, size_t length, const char *name)
{
    /* with the extender and a terminating zero */
    char front[sizeof(nifti_2_header) + 4 + 1] = {0};
    const file_format found = file_format_of_bytes(head, length);
    if (found == FILE_FORMAT_NRRD) return read_nrrd(a, head, length);
    if (found == FILE_FORMAT_META_IMAGE) return read_meta_image(a, head);
    bool packed = (unsigned char)head[0] == 0x1f && (unsigned char)head[1] == 0x8b;
    if (packed) {
        gzFile stream = gzdopen(STDIN_FILENO, "rb");
        int got = stream ? gzread(stream, front, sizeof front - 1) : -1;
        if (got < 0)
            return refuse(a, ERROR_INPUT_DAMAGED,
                          "the file cannot be decompressed: it is damaged. Copy or save it again.");
        length = (size_t)got;
        head = front;
    }
    if (file_format_of_bytes(head, length) == FILE_FORMAT_NIFTI && length >= sizeof(nifti_1_header) &&
        (nifti_header_version(head, length) == 1 || length >= sizeof(nifti_2_header)))
        return read_nifti(a, head, length, name, packed);
    return refuse(a, ERROR_INPUT_UNSUPPORTED, "the file is %s%s: give an NRRD, NIfTI or MetaImage file",
                  packed ? "compressed by gzip and contains " : "", guess(head, length));
}

static bool read_file(answer *a, const char *name)
{
    char *head = calloc(1, HEAD_MAX + 1);
    if (!head)
        return refuse(a, ERROR_LIMIT_MEMORY, "its header exceeds the memory limit: raise limits.memory_mb");
    bool ok = read_header(a, head, read_head(head, HEAD_MAX), name);
    free(head);
    return ok;
}

__attribute__((visibility("default"))) int header_reader_main(int argc, char **argv)
{
    answer a = {.head = {.slope = 1}};
    if (!reader_limit(argc, argv, STDERR_FILENO + 1) || !(a.text = malloc(VOLUME_HEADER_TEXT_MAX))) return 2;
    read_file(&a, argv[1]);
    const bool written = a.code == ERROR_NONE ? reader_answer(&a.head, sizeof a.head, a.text, a.text_length)
                                              : reader_refuse(a.code, a.text);
    _exit(written ? 0 : 1); /* _exit: freeing the libraries' memory takes time */
}

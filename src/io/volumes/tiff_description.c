// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/tiff_description.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/xml/xml.h"

/* Maximum number of pages: products of three such numbers fit into 64 bits. */
static const double most_pages = 1 << 20;

/* ---- units */

/* Units of length by their names, in metres. */
static const struct {
    const char *name;
    double metres;
} units[] = {{"pm", 1e-12},  {"\xc3\x85", 1e-10}, {"nm", 1e-9},    {"um", 1e-6},     {"mm", 1e-3},
             {"cm", 1e-2},   {"dm", 1e-1},        {"m", 1},        {"inch", 0.0254}, {"in", 0.0254},
             {"ft", 0.3048}, {"thou", 2.54e-5},   {"mil", 2.54e-5}};

static double metres_of(const char *unit)
{
    for (size_t k = 0; k < sizeof units / sizeof *units; k++)
        if (strcmp(units[k].name, unit) == 0) return units[k].metres;
    return 0;
}

/* The ratio of two units given in metres. For powers of ten it is exact. */
static double ratio_of(double a, double b)
{
    const double ratio = a / b, whole = rint(fmax(ratio, b / a));
    if (fabs(fmax(ratio, b / a) - whole) > 1e-9 * whole) return ratio;
    return ratio >= 1 ? whole : 1 / whole;
}

/* Copies the name of a unit. The many spellings of the micrometre (micro sign in UTF-8, in Latin-1, as an
 * escape) become one. "pixel" is not a unit of length. */
static void copy_unit(const char *from, char to[TIFF_UNIT_SIZE])
{
    static const char *const micrometres[] = {"\xc2\xb5m",  "\xce\xbcm",  "\xb5m",      "\\u00B5m",
                                              "micron",     "microns",    "micrometer", "micrometers",
                                              "micrometre", "micrometres"};
    snprintf(to, TIFF_UNIT_SIZE, "%s", from);
    for (size_t k = 0; k < sizeof micrometres / sizeof *micrometres; k++)
        if (strcasecmp(to, micrometres[k]) == 0) strcpy(to, "um");
    if (strcasecmp(to, "pixel") == 0 || strcasecmp(to, "pixels") == 0 || strcasecmp(to, "voxel") == 0)
        *to = 0;
    if (metres_of(to) > 0) return;
    for (char *c = to; *c; c++)
        if (*c < ' ' || *c > '~') *c = '?';
}

/* ---- ImageJ: a line for each `key=value` */

/* The keys that are read: each has a number, or the name of a unit. Other keys (loop, min, max, mode, ...) tell how
 * the image is displayed. */
enum {
    IMAGES,
    SLICES,
    CHANNELS,
    FRAMES,
    SPACING,
    XORIGIN,
    YORIGIN,
    ZORIGIN,
    NUMBERS,
    UNIT = NUMBERS,
    YUNIT,
    ZUNIT,
    KEYS
};

static const char *const keys[KEYS] = {"images",  "slices",  "channels", "frames", "spacing", "xorigin",
                                       "yorigin", "zorigin", "unit",     "yunit",  "zunit"};

typedef struct imagej {
    bool is_there[KEYS];
    char value[KEYS][2 * TIFF_UNIT_SIZE];
} imagej;

/* Stores the value of a line, if its key is one of `keys`. Refuses a key that has two different values. */
static bool read_line(imagej *to, const char *line, char *fault)
{
    const size_t length = strcspn(line, "\r\n"), name = strcspn(line, "=\r\n");
    if (name >= length) return true;
    for (size_t k = 0; k < KEYS; k++) {
        char value[2 * TIFF_UNIT_SIZE];
        if (strlen(keys[k]) != name || strncmp(line, keys[k], name) != 0) continue;
        snprintf(value, sizeof value, "%.*s", (int)(length - name - 1), line + name + 1);
        if (to->is_there[k] && strcmp(to->value[k], value) != 0)
            return snprintf(
                       fault, TIFF_FAULT_SIZE,
                       "ImageJ's description has %s twice, as \"%.40s\" and as \"%.40s\": remove one of them",
                       keys[k], to->value[k], value) < 0;
        strcpy(to->value[k], value);
        to->is_there[k] = true;
    }
    return true;
}

/* Reads numbers to their end, so that "2,5" is not 2. */
static bool read_numbers(const imagej *from, double number[NUMBERS], char *fault)
{
    for (size_t k = 0; k < NUMBERS; k++) {
        char *end;
        if (!from->is_there[k]) continue;
        number[k] = strtod(from->value[k], &end);
        if (end == from->value[k] || end[strspn(end, " \t")] || !isfinite(number[k]))
            return snprintf(
                       fault, TIFF_FAULT_SIZE,
                       "ImageJ's description has %s=%.40s, which is not a number: correct it (with a decimal "
                       "point), as in %s=2.5",
                       keys[k], from->value[k], keys[k]) < 0;
        if (k < SPACING && !(number[k] >= 1 && number[k] <= most_pages && number[k] == floor(number[k])))
            return snprintf(
                       fault, TIFF_FAULT_SIZE,
                       "ImageJ's description has %s=%.40s, which is not a number of pages from 1 to %.0f",
                       keys[k], from->value[k], most_pages) < 0;
    }
    return true;
}

/* The width of a voxel is in `unit`, its height in `yunit` and its depth in `zunit`, where these are present. */
static bool read_units(const imagej *from, tiff_description *out, char *fault)
{
    copy_unit(from->value[UNIT], out->unit);
    for (int k = 0; k < 3; k++) {
        char unit[TIFF_UNIT_SIZE];
        const char *own = from->value[UNIT + k];
        out->in_unit[k] = 1;
        if (k == 0 || !*own) continue;
        copy_unit(own, unit);
        if (strcmp(unit, out->unit) == 0) continue;
        const double metres = metres_of(unit), first = metres_of(out->unit);
        if (!(metres > 0 && first > 0))
            return snprintf(
                       fault, TIFF_FAULT_SIZE,
                       "ImageJ's description has %s \"%.40s\" beside unit \"%.40s\", which are not converted "
                       "into each other: save the file with one unit",
                       keys[UNIT + k], own, from->value[UNIT]) < 0;
        out->in_unit[k] = ratio_of(metres, first);
    }
    return true;
}

static bool describe_imagej(const char *text, tiff_description *out, char *fault)
{
    imagej lines = {0};
    double number[NUMBERS] = {[IMAGES] = 1, [CHANNELS] = 1, [FRAMES] = 1};
    out->kind = "ImageJ";
    for (const char *line = text; line; line = strchr(line, '\n')) {
        line += *line == '\n';
        if (!read_line(&lines, line, fault)) return false;
    }
    if (!read_numbers(&lines, number, fault) || !read_units(&lines, out, fault)) return false;
    for (int k = 0; k < 3; k++) out->origin[k] = number[XORIGIN + k];
    out->images = (int64_t)number[IMAGES];
    out->channels = (int64_t)number[CHANNELS];
    out->frames = (int64_t)number[FRAMES];
    out->slices = number[SLICES] > 0                ? (int64_t)number[SLICES]
                  : out->channels * out->frames > 1 ? 1
                                                    : out->images;
    out->channel_step = 1;
    out->slice_step = out->channels;
    out->frame_step = out->channels * out->slices;
    out->size[2] = fabs(number[SPACING]) * out->in_unit[2];
    if (out->size[2] == 0 && *out->unit) out->size[2] = out->in_unit[2]; /* ImageJ omits a distance of 1 */
    return true;
}

/* ---- OME-XML */

typedef struct ome {
    tiff_description *out;
    dense_warnings *warnings;
    char *fault;
    int images, pixels; /* number of elements of each kind read so far */
    long long planes;   /* sum of PlaneCount */
    bool has_uncounted; /* an element TiffData has no PlaneCount */
    bool elsewhere;     /* the pixels are described by another file */
    char order[8];
} ome;

static void refuse(ome *o, const char *why)
{
    if (!*o->fault) snprintf(o->fault, TIFF_FAULT_SIZE, "%s", why);
}

static bool read_count(ome *o, const char **attributes, const char *name, int64_t *out)
{
    const char *text = xml_attribute(attributes, name);
    char *end = NULL;
    const long long value = text ? strtoll(text, &end, 10) : 0;
    if (!text || *end || value < 1 || value > (long long)most_pages) {
        char why[TIFF_FAULT_SIZE];
        snprintf(why, sizeof why, "its OME-XML has the %s \"%.40s\", which is not a number from 1 to %.0f",
                 name, text ? text : "", most_pages);
        refuse(o, why);
        return false;
    }
    *out = value;
    return true;
}

/* Sets the steps between slices, channels and frames from the dimension order, such as XYZCT. */
static bool read_order(ome *o)
{
    int64_t step = 1;
    int found = 0;
    for (const char *axis = o->order + 2; strlen(o->order) == 5 && *axis; axis++) {
        int64_t *to = *axis == 'Z'   ? &o->out->slice_step
                      : *axis == 'C' ? &o->out->channel_step
                      : *axis == 'T' ? &o->out->frame_step
                                     : NULL;
        if (!to || *to != 0) break;
        *to = step;
        step *= *axis == 'Z' ? o->out->slices : *axis == 'C' ? o->out->channels : o->out->frames;
        found++;
    }
    if (found == 3 && strncmp(o->order, "XY", 2) == 0) return true;
    refuse(o, "its OME-XML has an invalid DimensionOrder: correct it, as in XYZCT");
    return false;
}

/* Reads the voxel sizes: micrometres unless stated otherwise, converted to the unit of the first size. */
static void read_sizes(ome *o, const char **attributes)
{
    static const char *const names[] = {"PhysicalSizeX", "PhysicalSizeY", "PhysicalSizeZ"};
    for (int k = 0; k < 3; k++) {
        const char *text = xml_attribute(attributes, names[k]);
        char unit_name[24], unit[TIFF_UNIT_SIZE], *end = NULL;
        const double size = text ? strtod(text, &end) : 0;
        if (!text) continue;
        if (*end || !(size > 0) || !isfinite(size)) {
            dense_warn(o->warnings,
                       "%s of its OME-XML is \"%.40s\", which is not a positive number: it is ignored",
                       names[k], text);
            continue;
        }
        snprintf(unit_name, sizeof unit_name, "%sUnit", names[k]);
        const char *said = xml_attribute(attributes, unit_name);
        copy_unit(said ? said : "um", unit);
        if (!*o->out->unit) strcpy(o->out->unit, unit);
        const double own = metres_of(unit), first = metres_of(o->out->unit);
        if (own > 0 && first > 0)
            o->out->size[k] = size * ratio_of(own, first);
        else if (strcmp(unit, o->out->unit) == 0)
            o->out->size[k] = size;
        else
            dense_warn(
                o->warnings,
                "%s of its OME-XML is in \"%.40s\", which cannot be converted to \"%.40s\": it is ignored",
                names[k], unit, o->out->unit);
    }
}

static void read_pixels(ome *o, const char **attributes)
{
    const char *order = xml_attribute(attributes, "DimensionOrder");
    o->out->slice_step = o->out->channel_step = o->out->frame_step = 0;
    snprintf(o->order, sizeof o->order, "%s", order ? order : "XYZCT");
    if (!read_count(o, attributes, "SizeZ", &o->out->slices) ||
        !read_count(o, attributes, "SizeC", &o->out->channels) ||
        !read_count(o, attributes, "SizeT", &o->out->frames) ||
        (xml_attribute(attributes, "SizeX") && !read_count(o, attributes, "SizeX", &o->out->width)) ||
        (xml_attribute(attributes, "SizeY") && !read_count(o, attributes, "SizeY", &o->out->height)) ||
        !read_order(o))
        return;
    const char *type = xml_attribute(attributes, "Type");
    snprintf(o->out->type, sizeof o->out->type, "%s", type ? type : "");
    read_sizes(o, attributes);
    o->out->kind = "OME-XML";
}

/* Checks that the position of a plane, if stated, agrees with the dimension order. */
static void check_plane(ome *o, const char **attributes)
{
    const char *const text[4] = {xml_attribute(attributes, "IFD"), xml_attribute(attributes, "FirstZ"),
                                 xml_attribute(attributes, "FirstC"), xml_attribute(attributes, "FirstT")};
    long long number[4];
    for (int k = 0; k < 4; k++) {
        char *end = "";
        number[k] = text[k] ? strtoll(text[k], &end, 10) : 0;
        if (*end || number[k] < 0 || number[k] > (long long)most_pages) number[k] = -1;
    }
    const tiff_description *d = o->out;
    int64_t planes = 0;
    o->has_uncounted |= !xml_attribute(attributes, "PlaneCount");
    if (xml_attribute(attributes, "PlaneCount") && !read_count(o, attributes, "PlaneCount", &planes)) return;
    o->planes += planes;
    if (text[0] &&
        (number[0] < 0 || number[1] < 0 || number[2] < 0 || number[3] < 0 ||
         number[0] != number[1] * d->slice_step + number[2] * d->channel_step + number[3] * d->frame_step))
        refuse(o,
               "its OME-XML places pages in another order than its DimensionOrder: save it again with Fiji "
               "(Bio-Formats Exporter)");
}

static bool begin_element(void *context, const char *name, const char **attributes)
{
    ome *o = context;
    name = xml_local_name(name);
    if (strcmp(name, "BinaryOnly") == 0) o->elsewhere = true;
    if (strcmp(name, "Image") == 0) o->images++;
    if (o->images > 1) return true;
    if (strcmp(name, "Pixels") == 0 && o->pixels++ == 0) read_pixels(o, attributes);
    if (strcmp(name, "TiffData") == 0 && o->pixels == 1) check_plane(o, attributes);
    return !*o->fault;
}

static bool describe_ome(const char *text, tiff_description *out, dense_warnings *warnings, char *fault)
{
    ome o = {.out = out, .warnings = warnings, .fault = fault};
    xml document = {.data = text, .size = strlen(text), .context = &o, .begin = begin_element};
    const xml_result result = xml_read(&document);
    if (result == XML_RESULT_NO_MEMORY) refuse(&o, "its OME-XML exceeds the memory limit");
    if (result == XML_RESULT_DECLARATIONS)
        refuse(&o, "its OME-XML has a document type, which is not read: remove it");
    if (result == XML_RESULT_INVALID)
        snprintf(fault, TIFF_FAULT_SIZE, "its OME-XML is not valid XML (line %lu: %s): save it again",
                 document.line, document.why);
    if (*fault) return false;
    if (o.images > 1)
        return snprintf(fault, TIFF_FAULT_SIZE,
                        "its OME-XML describes %d images: save one of them as a file of its own",
                        o.images) < 0;
    if (out->kind && o.planes > 0 && !o.has_uncounted &&
        o.planes != out->slices * out->channels * out->frames)
        dense_warn(
            warnings,
            "TiffData of its OME-XML have %lld planes, and SizeZ, SizeC and SizeT give %lld: the sizes "
            "count",
            o.planes, (long long)(out->slices * out->channels * out->frames));
    if (!out->kind && o.elsewhere)
        dense_warn(warnings, "its OME-XML is in another file (BinaryOnly) and is not read: set voxel_size");
    return true;
}

/* A file with one slice at each time, or in each channel, holds a volume only if these are its slices: a program
 * that does not write the axis has saved a stack as one of the others. */
static void use_other_axis_as_slices(tiff_description *d, dense_warnings *warnings)
{
    const bool by_time = d->frames > 1;
    int64_t *count = by_time ? &d->frames : &d->channels, *step = by_time ? &d->frame_step : &d->channel_step;
    if (!d->kind || d->slices > 1 || *count < 2) return;
    dense_warn(warnings, "the file has %lld %s of one slice each: the %s are used as slices",
               (long long)*count, by_time ? "frames" : "channels", by_time ? "frames" : "channels");
    d->slices = *count;
    d->slice_step = *step;
    *count = 1;
}

bool tiff_describe(const char *text, tiff_description *out, dense_warnings *warnings,
                   char fault[TIFF_FAULT_SIZE])
{
    *out = (tiff_description){.in_unit = {1, 1, 1}};
    *fault = 0;
    bool ok = true;
    if (strncmp(text, "\xEF\xBB\xBF", 3) == 0) text += 3;
    size_t size = strlen(text);
    char *in_utf8 = xml_in_utf8(text, &size);
    if (in_utf8) text = in_utf8;
    if (strncmp(text, "ImageJ=", 7) == 0) ok = describe_imagej(text, out, fault);
    if ((strncmp(text, "<?xml", 5) == 0 || strncmp(text, "<OME", 4) == 0) && strstr(text, "<OME"))
        ok = describe_ome(text, out, warnings, fault);
    if (ok) use_other_axis_as_slices(out, warnings);
    free(in_utf8);
    return ok;
}

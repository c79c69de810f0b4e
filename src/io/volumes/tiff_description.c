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

static bool number_of_line(const char *line, const char *key, double *out)
{
    const size_t length = strlen(key);
    if (strncmp(line, key, length) != 0 || line[length] != '=') return false;
    char *end;
    const double value = strtod(line + length + 1, &end);
    if (end == line + length + 1 || !isfinite(value)) return false;
    *out = value;
    return true;
}

static int64_t count_of(double number)
{
    return number >= 1 && number <= most_pages ? (int64_t)number : 1;
}

static void describe_imagej(const char *text, tiff_description *out, dense_warnings *warnings)
{
    double images = 1, slices = 0, channels = 1, frames = 1, spacing = 0;
    out->kind = "ImageJ";
    for (const char *line = text; line; line = strchr(line, '\n')) {
        line += *line == '\n';
        number_of_line(line, "images", &images);
        number_of_line(line, "slices", &slices);
        number_of_line(line, "channels", &channels);
        number_of_line(line, "frames", &frames);
        number_of_line(line, "spacing", &spacing);
        number_of_line(line, "xorigin", &out->origin[0]);
        number_of_line(line, "yorigin", &out->origin[1]);
        number_of_line(line, "zorigin", &out->origin[2]);
        if (strncmp(line, "unit=", 5) == 0) {
            char word[2 * TIFF_UNIT_SIZE];
            snprintf(word, sizeof word, "%.*s", (int)strcspn(line + 5, "\r\n"), line + 5);
            copy_unit(word, out->unit);
        }
    }
    out->images = count_of(images);
    out->channels = count_of(channels);
    out->frames = count_of(frames);
    out->slices = slices > 0 ? count_of(slices) : out->channels * out->frames > 1 ? 1 : out->images;
    if (out->slices == 1 && out->frames > 1) {
        dense_warn(warnings, "the file has %lld frames of one slice each: the frames are used as slices",
                   (long long)out->frames);
        out->slices = out->frames;
        out->frames = 1;
    }
    out->channel_step = 1;
    out->slice_step = out->channels;
    out->frame_step = out->channels * out->slices;
    out->size[2] = fabs(spacing);
    if (out->size[2] == 0 && *out->unit) out->size[2] = 1; /* ImageJ omits a distance of 1 */
}

/* ---- OME-XML */

typedef struct ome {
    tiff_description *out;
    dense_warnings *warnings;
    char *fault;
    int images, pixels; /* number of elements of each kind read so far */
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
        snprintf(why, sizeof why,
                 "its OME-XML has the %s \"%.40s\", which is not a number of pages from 1 to %.0f", name,
                 text ? text : "", most_pages);
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
        if (!text || *end || !(size > 0) || !isfinite(size)) continue;
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
        !read_count(o, attributes, "SizeT", &o->out->frames) || !read_order(o))
        return;
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
        number[k] = text[k] ? strtoll(text[k], NULL, 10) : 0;
        if (number[k] < 0 || number[k] > (long long)most_pages) number[k] = -1;
    }
    const tiff_description *d = o->out;
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
    if (!out->kind && o.elsewhere)
        dense_warn(warnings, "its OME-XML is in another file (BinaryOnly) and is not read: set voxel_size");
    return true;
}

bool tiff_describe(const char *text, tiff_description *out, dense_warnings *warnings,
                   char fault[TIFF_FAULT_SIZE])
{
    *out = (tiff_description){0};
    *fault = 0;
    if (strncmp(text, "ImageJ=", 7) == 0) describe_imagej(text, out, warnings);
    if ((strncmp(text, "<?xml", 5) == 0 || strncmp(text, "<OME", 4) == 0) && strstr(text, "<OME"))
        return describe_ome(text, out, warnings, fault);
    return true;
}

// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/zarr_metadata.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "base/core/transfer.h"
#include "base/json/json.h"

/* Larger metadata files are refused. */
static const off_t largest_file = 4 << 20;

/* Longer sides are refused as damaged: those of spatial axes, whose product fits into 64 bits, and of
 * others. */
static const double largest_side = 1 << 20, largest_other = 1 << 30;

/* The state of the reading; `file` is for messages. */
typedef struct reading {
    const slices_directory *directory;
    const char *file; /* the current file */
    zarr_metadata *out;
    error *e;
    bool has_no_array; /* the directory has no metadata of an array */
} reading;

static bool damaged(const reading *r, const char *format, ...) __attribute__((format(printf, 2, 3)));
static bool unsupported(const reading *r, const char *format, ...) __attribute__((format(printf, 2, 3)));

static bool refuse(const reading *r, error_code code, const char *format, va_list arguments)
{
    char text[400];
    vsnprintf(text, sizeof text, format, arguments);
    return error_set(r->e, code, "%s: %s", r->file, text);
}

static bool damaged(const reading *r, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    refuse(r, ERROR_INPUT_DAMAGED, format, arguments);
    va_end(arguments);
    return false;
}

static bool unsupported(const reading *r, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    refuse(r, ERROR_INPUT_UNSUPPORTED, format, arguments);
    va_end(arguments);
    return false;
}

/* ---- files */

/* Reads a JSON document, which the caller frees with json_free. NULL: *is_missing is true, or an error is
 * set. */
static json *read_json(const slices_directory *d, const char *path, bool *is_missing, error *e)
{
    struct stat st = {0};
    json *document = NULL;
    const int fd = d->open(d->context, path, is_missing, e);
    if (fd < 0) return NULL;
    char *text = NULL;
    if (fstat(fd, &st) != 0 || st.st_size > largest_file) {
        error_set(e, ERROR_INPUT_UNSUPPORTED, "%s: the file has %lld bytes, and metadata have at most %lld",
                  path, (long long)st.st_size, (long long)largest_file);
    } else {
        text = mem_alloc((size_t)st.st_size + 1);
        const int64_t count = transfer_read_at(fd, text, (size_t)st.st_size, 0);
        document = json_parse(text, count > 0 ? (size_t)count : 0, e);
        if (!document) {
            if (e) e->code = ERROR_INPUT_DAMAGED;
            error_prefix(e, "%s", path);
        }
    }
    free(text);
    close(fd);
    return document;
}

/* ---- arrays */

static bool read_sides(const reading *r, json_at list, const char *name, int64_t *out, int *count,
                       double most)
{
    const size_t n = json_size(list);
    if (json_type_of(list) != JSON_ARRAY || n < 1 || n > ZARR_AXES_MOST || (*count && n != (size_t)*count))
        return damaged(r, "%s is not an array of %d numbers", name, *count ? *count : ZARR_AXES_MOST);
    for (json_at at = json_first(&list); at.node; at = json_next(&at)) {
        const double side = json_number(at, -1);
        if (!(side >= 0 && side <= most && side == floor(side)))
            return damaged(r, "%s has a number that is not a size from 0 to %.0f", name, most);
        out[at.index] = (int64_t)side;
    }
    *count = (int)n;
    return true;
}

static bool check_chunks(const reading *r, const int64_t *chunk, const char *name)
{
    for (int k = 0; k < r->out->axes; k++)
        if (chunk[k] < 1 || chunk[k] > (1 << 20))
            return damaged(r, "%s has a side of %lld", name, (long long)chunk[k]);
    return true;
}

/* Number types: names in version 3, kind and size in version 2. */
static const struct {
    const char *name, *code;
    number_type type;
} types[] = {
    {"bool", "b1", NUMBER_UINT8},    {"int8", "i1", NUMBER_INT8},     {"uint8", "u1", NUMBER_UINT8},
    {"int16", "i2", NUMBER_INT16},   {"uint16", "u2", NUMBER_UINT16}, {"int32", "i4", NUMBER_INT32},
    {"uint32", "u4", NUMBER_UINT32}, {"int64", "i8", NUMBER_INT64},   {"uint64", "u8", NUMBER_UINT64},
    {"float32", "f4", NUMBER_FLOAT}, {"float64", "f8", NUMBER_DOUBLE}};

static bool find_type(const reading *r, const char *name, bool by_code)
{
    for (size_t k = 0; k < sizeof types / sizeof *types; k++)
        if (strcmp(by_code ? types[k].code : types[k].name, name) == 0) {
            r->out->type = types[k].type;
            return true;
        }
    return unsupported(
        r,
        "numbers of the type \"%.40s\" are not read: save it with integers of 8 to 64 bits, float32 or float64",
        name);
}

/* Whether a number is a value of a type. */
static bool is_in_type(double value, number_type type)
{
    if (!number_is_whole(type)) return true;
    const bool is_signed =
        type == NUMBER_INT8 || type == NUMBER_INT16 || type == NUMBER_INT32 || type == NUMBER_INT64;
    const int bits = 8 * (int)number_bytes(type) - is_signed;
    return value == floor(value) && value >= (is_signed ? -ldexp(1, bits) : 0) && value < ldexp(1, bits);
}

/* Reads the fill value of an array whose type is known. */
static bool read_fill(const reading *r, json_at fill)
{
    static const struct {
        const char *word;
        double value;
    } words[] = {{"NaN", NAN}, {"Infinity", INFINITY}, {"-Infinity", -INFINITY}};
    const bool is_number = json_type_of(fill) == JSON_NUMBER, is_truth = json_type_of(fill) == JSON_BOOL;
    const char *word = json_string(fill, "");
    r->out->has_fill = fill.node && json_type_of(fill) != JSON_NULL;
    r->out->fill = is_truth ? json_bool(fill, false) : json_number(fill, 0);
    bool is_known = !r->out->has_fill || is_number || is_truth;
    for (size_t k = 0; !is_known && k < sizeof words / sizeof *words; k++)
        if (strcmp(word, words[k].word) == 0) {
            r->out->fill = words[k].value;
            is_known = true;
        }
    if (!is_known) return unsupported(r, "the fill_value \"%.40s\" is not read: give a number", word);
    return !r->out->has_fill || is_in_type(r->out->fill, r->out->type) ||
           damaged(r, "the fill_value %g is not a number of the array's type: correct it", r->out->fill);
}

static bool add_codec(const reading *r, zarr_packing *p, zarr_codec codec)
{
    if (p->count == ZARR_CODECS_MOST)
        return unsupported(r, "a chunk is packed by more than %d codecs", ZARR_CODECS_MOST);
    p->codec[p->count++] = codec;
    return true;
}

static bool find_codec(const reading *r, zarr_packing *p, const char *name)
{
    static const struct {
        const char *name;
        zarr_codec codec;
    } codecs[] = {{"zlib", ZARR_ZLIB},
                  {"gzip", ZARR_ZLIB},
                  {"blosc", ZARR_BLOSC},
                  {"zstd", ZARR_ZSTD},
                  {"crc32c", ZARR_CRC32C}};
    for (size_t k = 0; k < sizeof codecs / sizeof *codecs; k++)
        if (strcmp(codecs[k].name, name) == 0) return add_codec(r, p, codecs[k].codec);
    return unsupported(
        r, "the codec \"%.40s\" is not read: save it with gzip, zlib, blosc, zstd or no compression", name);
}

static void store_in_order(zarr_metadata *m, bool is_reversed)
{
    for (int k = 0; k < m->axes; k++) m->stored[k] = is_reversed ? m->axes - 1 - k : k;
}

/* Parses .zarray of version 2. */
static bool read_array_2(reading *r, const json *document)
{
    zarr_metadata *m = r->out;
    const json_at root = json_root(document), compressor = json_member(&root, "compressor"),
                  filters = json_member(&root, "filters");
    const char *dtype = json_string(json_member(&root, "dtype"), ""),
               *order = json_string(json_member(&root, "order"), "C"),
               *separator = json_string(json_member(&root, "dimension_separator"), ".");
    m->axes = 0;
    if (!read_sides(r, json_member(&root, "shape"), "shape", m->shape, &m->axes, largest_other) ||
        !read_sides(r, json_member(&root, "chunks"), "chunks", m->chunk, &m->axes, largest_other) ||
        !check_chunks(r, m->chunk, "chunks"))
        return false;
    memcpy(m->shard, m->chunk, sizeof m->shard);
    if (strlen(dtype) < 3 || !strchr("<>|", *dtype))
        return unsupported(r, "numbers of the type \"%.40s\" are not read", dtype);
    if (!find_type(r, dtype + 1, true)) return false;
    m->is_swapped = *dtype == (__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__ ? '>' : '<');
    if (strcmp(order, "C") != 0 && strcmp(order, "F") != 0)
        return damaged(r, "order is \"%.10s\": C and F are valid", order);
    store_in_order(m, *order == 'F');
    if (json_size(filters) > 0) {
        const json_at first = json_first(&filters);
        return unsupported(r, "the filter \"%.40s\" is not read: save it without filters",
                           json_string(json_member(&first, "id"), ""));
    }
    if (compressor.node && json_type_of(compressor) != JSON_NULL &&
        !find_codec(r, &m->packing, json_string(json_member(&compressor, "id"), "")))
        return false;
    if (strcmp(separator, ".") != 0 && strcmp(separator, "/") != 0)
        return damaged(r, "dimension_separator is \"%.10s\": . and / are valid", separator);
    m->separator = *separator;
    return read_fill(r, json_member(&root, "fill_value"));
}

static bool read_codecs_3(reading *r, json_at codecs, bool is_inner);

static bool read_transpose(reading *r, json_at configuration)
{
    zarr_metadata *m = r->out;
    const json_at order = json_member(&configuration, "order");
    int seen = 0;
    if (json_type_of(order) == JSON_STRING) {
        store_in_order(m, strcmp(json_string(order, ""), "F") == 0);
        return true;
    }
    if (json_size(order) != (size_t)m->axes)
        return damaged(r, "the codec transpose has no order of %d axes", m->axes);
    for (json_at at = json_first(&order); at.node; at = json_next(&at)) {
        const double axis = json_number(at, -1);
        if (!(axis >= 0 && axis < m->axes && axis == floor(axis)) || seen >> (int)axis & 1)
            return damaged(r,
                           "the order of the codec transpose names an axis twice or one that is not there");
        seen |= 1 << (int)axis;
        m->stored[at.index] = (int)axis;
    }
    return true;
}

/* Parses the codecs of a shard's index: bytes, optionally followed by crc32c. */
static bool read_index_codecs(reading *r, json_at codecs)
{
    for (json_at codec = json_first(&codecs); codec.node; codec = json_next(&codec)) {
        const json_at configuration = json_member(&codec, "configuration");
        const char *name = json_string(json_member(&codec, "name"), "");
        if (codec.index == 0 && strcmp(name, "bytes") == 0 &&
            strcmp(json_string(json_member(&configuration, "endian"), "little"), "little") == 0)
            continue;
        if (codec.index == 1 && strcmp(name, "crc32c") == 0) {
            r->out->has_index_checksum = true;
            continue;
        }
        return unsupported(
            r,
            "the codec \"%.40s\" of the index of shards is not read: save it with bytes (little) and crc32c",
            name);
    }
    return json_size(codecs) > 0 || damaged(r, "the index of shards has no codecs");
}

static bool read_sharding(reading *r, json_at configuration)
{
    zarr_metadata *m = r->out;
    const char *location = json_string(json_member(&configuration, "index_location"), "end");
    if (!read_sides(r, json_member(&configuration, "chunk_shape"), "chunk_shape of the shards", m->chunk,
                    &m->axes, largest_other) ||
        !check_chunks(r, m->chunk, "chunk_shape of the shards"))
        return false;
    for (int k = 0; k < m->axes; k++)
        if (m->shard[k] % m->chunk[k])
            return damaged(r, "the sides of shards are not multiples of those of their chunks");
    m->is_sharded = true;
    m->is_index_first = strcmp(location, "start") == 0;
    return read_index_codecs(r, json_member(&configuration, "index_codecs")) &&
           read_codecs_3(r, json_member(&configuration, "codecs"), true);
}

/* Parses codecs in their order: array to array, array to bytes, bytes to bytes. */
static bool read_codecs_3(reading *r, json_at codecs, bool is_inner)
{
    zarr_metadata *m = r->out;
    bool has_bytes = false;
    for (json_at codec = json_first(&codecs); codec.node; codec = json_next(&codec)) {
        const json_at configuration = json_member(&codec, "configuration");
        const char *name = json_string(json_member(&codec, "name"), "");
        if (strcmp(name, "transpose") == 0 && !has_bytes) {
            if (!read_transpose(r, configuration)) return false;
        } else if ((strcmp(name, "bytes") == 0 || strcmp(name, "endian") == 0) && !has_bytes) {
            const char *endian = json_string(json_member(&configuration, "endian"), "little");
            m->is_swapped = (strcmp(endian, "big") == 0) == (__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__);
            has_bytes = true;
        } else if (strcmp(name, "sharding_indexed") == 0) {
            if (is_inner || codec.index != 0 || json_size(codecs) != 1)
                return unsupported(
                    r,
                    "the codec sharding_indexed is read as the only one: save it without other codecs around");
            return read_sharding(r, configuration);
        } else if (!has_bytes) {
            return unsupported(r, "the codec \"%.40s\" is not read in front of bytes", name);
        } else if (!find_codec(r, &m->packing, name)) {
            return false;
        }
    }
    return has_bytes || damaged(r, "the codecs have no \"bytes\"");
}

/* Parses zarr.json of an array of version 3. */
static bool read_array_3(reading *r, const json *document)
{
    zarr_metadata *m = r->out;
    const json_at root = json_root(document), grid = json_member(&root, "chunk_grid"),
                  grid_of = json_member(&grid, "configuration"),
                  key = json_member(&root, "chunk_key_encoding"), key_of = json_member(&key, "configuration"),
                  transformers = json_member(&root, "storage_transformers");
    const char *grid_name = json_string(json_member(&grid, "name"), ""),
               *key_name = json_string(json_member(&key, "name"), "");
    const bool is_default = strcmp(key_name, "default") == 0;
    m->axes = 0;
    if (strcmp(grid_name, "regular") != 0)
        return unsupported(r, "the chunk_grid \"%.40s\" is not read", grid_name);
    if (!is_default && strcmp(key_name, "v2") != 0)
        return unsupported(r, "the chunk_key_encoding \"%.40s\" is not read", key_name);
    if (json_size(transformers) > 0) return unsupported(r, "storage_transformers are not read");
    if (!read_sides(r, json_member(&root, "shape"), "shape", m->shape, &m->axes, largest_other) ||
        !read_sides(r, json_member(&grid_of, "chunk_shape"), "chunk_shape", m->shard, &m->axes,
                    largest_other) ||
        !check_chunks(r, m->shard, "chunk_shape"))
        return false;
    memcpy(m->chunk, m->shard, sizeof m->chunk);
    const json_at type = json_member(&root, "data_type");
    const char *separator = json_string(json_member(&key_of, "separator"), is_default ? "/" : ".");
    if (strcmp(separator, ".") != 0 && strcmp(separator, "/") != 0)
        return damaged(r, "the separator of chunk keys is \"%.10s\"", separator);
    m->separator = *separator;
    m->has_c_prefix = is_default;
    store_in_order(m, false);
    return find_type(r, json_string(type, "an extension"), false) &&
           read_codecs_3(r, json_member(&root, "codecs"), false) &&
           read_fill(r, json_member(&root, "fill_value"));
}

static bool is_there(const reading *r, const char *folder, const char *name)
{
    char path[ZARR_PATH_SIZE + 16];
    bool is_missing;
    snprintf(path, sizeof path, "%s%s", folder, name);
    const int fd = r->directory->open(r->directory->context, path, &is_missing, NULL);
    if (fd >= 0) close(fd);
    return fd >= 0;
}

/* Reads the metadata of the array in a folder, in either version. */
static bool read_array(reading *r, const char *folder)
{
    bool is_missing;
    char path[ZARR_PATH_SIZE + 16];
    snprintf(path, sizeof path, "%s.zarray", folder);
    r->file = path;
    json *document = read_json(r->directory, path, &is_missing, r->e);
    bool ok = document && read_array_2(r, document);
    if (ok && is_there(r, folder, "zarr.json"))
        dense_warn(&r->out->warnings,
                   "it has metadata of version 2 (.zarray) and of version 3 (zarr.json): those of "
                   "version 2 are used");
    if (!document && is_missing) {
        snprintf(path, sizeof path, "%szarr.json", folder);
        document = read_json(r->directory, path, &is_missing, r->e);
        ok = document && read_array_3(r, document);
        r->has_no_array = !document && is_missing;
        if (r->has_no_array)
            ok = error_set(r->e, ERROR_INPUT_DAMAGED,
                           "%s.zarray and %szarr.json are missing: copy the directory again", folder, folder);
    }
    json_free(document);
    r->file = "";
    return ok;
}

/* ---- OME-Zarr */

static bool read_axes(reading *r, json_at multiscale)
{
    zarr_metadata *m = r->out;
    static const char *const names[] = {"x", "y", "z"};
    const json_at axes = json_member(&multiscale, "axes");
    int found = 0, known = 0;
    if (json_size(axes) < 2 || json_size(axes) > ZARR_AXES_MOST)
        return unsupported(
            r,
            "multiscales without a list of axes, as before OME-Zarr 0.4, are not read: convert it to 0.4 or 0.5");
    m->axes = (int)json_size(axes);
    for (json_at axis = json_first(&axes); axis.node; axis = json_next(&axis)) {
        const int k = (int)axis.index;
        const char *name = json_string(json_member(&axis, "name"), ""),
                   *type = json_string(json_member(&axis, "type"), ""),
                   *unit = json_string(json_member(&axis, "unit"), "");
        if (strcmp(type, "space") != 0) continue;
        if (found < 3) {
            m->space[found] = k;
            m->row[found] = -1;
            for (int n = 0; n < 3; n++)
                if (strcmp(name, names[n]) == 0) m->row[found] = n;
            known |= m->row[found] >= 0 ? 1 << m->row[found] : 0;
            if (*unit && *m->unit && strcmp(unit, m->unit) != 0)
                dense_warn(
                    &m->warnings,
                    "its axes are in the units \"%.40s\" and \"%.40s\": none is converted. Set voxel_size.",
                    m->unit, unit);
            if (*unit && !*m->unit) snprintf(m->unit, sizeof m->unit, "%s", unit);
        }
        found++;
    }
    if (found != 3)
        return error_set(r->e, ERROR_NO_SURFACE,
                         "%s: the image has %d axes of the type space: give one with three", r->file, found);
    if (known != 7)
        for (int k = 0; k < 3; k++) m->row[k] = 2 - k; /* axes z, y, x */
    return true;
}

/* Applies scales and translations in their order. */
static bool apply_transformations(reading *r, json_at list)
{
    zarr_metadata *m = r->out;
    for (json_at one = json_first(&list); one.node; one = json_next(&one)) {
        const char *type = json_string(json_member(&one, "type"), "");
        const bool is_scale = strcmp(type, "scale") == 0;
        const json_at numbers = json_member(&one, is_scale ? "scale" : "translation");
        double value[ZARR_AXES_MOST] = {0};
        if (strcmp(type, "identity") == 0) continue;
        if (!is_scale && strcmp(type, "translation") != 0)
            return unsupported(
                r, "the coordinate transformation \"%.40s\" is not read: scale, translation and identity are",
                type);
        if (json_size(numbers) != (size_t)m->axes ||
            json_numbers(numbers, value, (size_t)m->axes) != (size_t)m->axes)
            return damaged(r, "a coordinate transformation (%s) has no %d numbers", type, m->axes);
        for (int n = 0; n < 3; n++) {
            const double number = value[m->space[n]];
            if (!isfinite(number) || (is_scale && !(number > 0)))
                return damaged(r, "a coordinate transformation (%s) has the number %g", type, number);
            if (is_scale) {
                m->scale[n] *= number;
                m->translation[n] *= number;
            } else {
                m->translation[n] += number;
            }
        }
    }
    return true;
}

static bool read_multiscale(reading *r, json_at multiscale, int64_t level)
{
    zarr_metadata *m = r->out;
    const json_at datasets = json_member(&multiscale, "datasets");
    const size_t count = json_size(datasets);
    if (count == 0) return damaged(r, "multiscales has no datasets");
    if (level < 0 || (size_t)level >= count)
        return error_set(r->e, ERROR_GRID_MISSING,
                         "%s: there is no level %lld: choose level from 0, the finest, to %zu", r->file,
                         (long long)level, count - 1);
    json_at dataset = json_first(&datasets);
    while (dataset.index < (size_t)level) dataset = json_next(&dataset);
    const char *path = json_string(json_member(&dataset, "path"), "");
    if (!*path || strlen(path) + 32 > sizeof m->path)
        return damaged(r, "the path of dataset %lld is empty or too long", (long long)level);
    snprintf(m->path, sizeof m->path, "%s/", path);
    for (int k = 0; k < 3; k++) m->scale[k] = 1;
    return read_axes(r, multiscale) &&
           apply_transformations(r, json_member(&dataset, "coordinateTransformations")) &&
           apply_transformations(r, json_member(&multiscale, "coordinateTransformations"));
}

/* Parses the attributes of the group, or their member `ome`. */
static bool read_group(reading *r, json_at attributes, int64_t level, bool *is_ome)
{
    const json_at list = json_member(&attributes, "multiscales");
    *is_ome = json_size(list) > 0;
    if (json_size(list) > 1)
        return unsupported(r, "it has %zu multiscales: save each image as a directory of its own",
                           json_size(list));
    if (*is_ome) return read_multiscale(r, json_first(&list), level);
    if (json_member(&attributes, "plate").node || json_member(&attributes, "well").node ||
        json_member(&attributes, "bioformats2raw.layout").node || json_member(&attributes, "series").node ||
        json_member(&attributes, "labels").node)
        return error_set(
            r->e, ERROR_GRID_AMBIGUOUS,
            "%s: the directory holds several images: name the directory of one of them, for example %s",
            r->file,
            json_member(&attributes, "labels").node  ? "labels/NAME"
            : json_member(&attributes, "plate").node ? "A/1/0"
                                                     : "0");
    return true;
}

/* Reads a plain array: its last three axes are z, y, x. */
static bool read_bare(reading *r, int64_t level)
{
    zarr_metadata *m = r->out;
    if (level != 0) return error_set(r->e, ERROR_GRID_MISSING, "the array has no levels: remove level");
    if (!read_array(r, "")) return false;
    if (m->axes < 3)
        return error_set(r->e, ERROR_NO_SURFACE, "the array has %d axes: give one with three", m->axes);
    for (int k = 0; k < 3; k++) {
        m->space[k] = m->axes - 3 + k;
        m->row[k] = 2 - k;
        m->scale[k] = 1;
    }
    return true;
}

static bool read_any(reading *r, int64_t level)
{
    bool is_missing, is_ome = false, ok = true;
    json *group = read_json(r->directory, "zarr.json", &is_missing, r->e);
    if (!group && !is_missing) return false;
    if (group) {
        r->file = "zarr.json";
        const json_at root = json_root(group), attributes = json_member(&root, "attributes"),
                      ome = json_member(&attributes, "ome");
        if (strcmp(json_string(json_member(&root, "node_type"), ""), "array") != 0)
            ok =
                read_group(r, ome.node ? ome : attributes, level, &is_ome) &&
                (is_ome || unsupported(r, "the group has no multiscales (OME-Zarr 0.5) and is not an array"));
        json_free(group);
    } else {
        r->file = ".zattrs";
        json *attributes = read_json(r->directory, ".zattrs", &is_missing, r->e);
        if (!attributes && !is_missing) return false;
        if (attributes) ok = read_group(r, json_root(attributes), level, &is_ome);
        json_free(attributes);
    }
    if (!ok) return false;
    r->out->is_ome = is_ome;
    if (!is_ome) {
        const bool there = read_bare(r, level);
        if (!there && r->has_no_array)
            return error_set(
                r->e, ERROR_INPUT_UNSUPPORTED,
                "the directory has none of .zattrs, .zarray and zarr.json: give the directory of an OME-Zarr image (for a folder "
                "of DICOM files, `dcm2niix FOLDER` converts it to NIfTI)");
        return there;
    }
    const int axes = r->out->axes;
    if (!read_array(r, r->out->path)) return false;
    if (r->out->axes == axes) return true;
    return error_set(r->e, ERROR_INPUT_DAMAGED, "%s: the array has %d axes, and multiscales names %d",
                     r->out->path, r->out->axes, axes);
}

bool zarr_metadata_read(const slices_directory *directory, int64_t level, zarr_metadata *out, error *e)
{
    zarr_metadata made = {0};
    error own = {0};
    reading r = {.directory = directory, .file = "", .out = &made, .e = &own};
    bool ok = read_any(&r, level);
    for (int k = 0; ok && k < 3; k++)
        if (made.shape[made.space[k]] > (int64_t)largest_side)
            ok = error_set(&own, ERROR_INPUT_DAMAGED,
                           "claims %lld samples along an axis: at most %.0f are read",
                           (long long)made.shape[made.space[k]], largest_side);
    double chunk = 1, shard = 1;
    for (int k = 0; ok && k < made.axes; k++) {
        chunk *= (double)made.chunk[k];
        shard *= (double)(made.shard[k] / made.chunk[k]);
    }
    if (ok && (chunk > 1 << 30 || shard > 1 << 24))
        ok = error_set(
            &own, ERROR_INPUT_UNSUPPORTED,
            "a chunk has %.0f numbers, or a shard %.0f chunks: at most %d and %d are read. Save it with smaller chunks.",
            chunk, shard, 1 << 30, 1 << 24);
    if (ok)
        *out = made;
    else if (e)
        *e = own;
    return ok;
}

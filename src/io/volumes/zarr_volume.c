// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/zarr_volume.h"

#include <endian.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "base/core/reader.h"
#include "io/volumes/numbers.h"
#include "io/volumes/zarr_reader.h"

/* CPU limit of the process: seconds_at_least plus seconds_per_chunk for each chunk, twenty times the
 * measured time of a chunk with a million numbers. */
static const double seconds_at_least = 60, seconds_per_chunk = 0.02, seconds_most = 1e6;

/* Margin of samples around a region: the support of the spline in dense_grid.h, and a block. */
static const double around = 24;

enum { EMPTY = -1 };

typedef struct zarr_volume {
    slices base; /* first: the slices' functions get this pointer */
    zarr_request_volume params;
    zarr_metadata m;
    int64_t at[ZARR_AXES_MOST];       /* index along each axis that is not spatial */
    int64_t low[3];                   /* first sample that is read along each spatial axis, slowest first */
    int64_t count[3];                 /* number of samples that are read along these axes */
    int64_t layer;                    /* index of the layer of chunks in memory, or EMPTY */
    unsigned char *numbers;           /* samples of the layer: slices of count[1] rows with count[2]
                                       * numbers */
    unsigned char *chunk;             /* buffer for an unpacked chunk */
    unsigned char *index;             /* index of the shard that was read last */
    int64_t index_of[ZARR_AXES_MOST]; /* position of this shard */
    bool has_index;
    size_t chunk_bytes, index_bytes;
    int64_t step[ZARR_AXES_MOST]; /* distance between consecutive numbers of a chunk along each axis */
    reader reader;
} zarr_volume;

static size_t value_bytes(const zarr_volume *v)
{
    return number_bytes(v->m.type);
}

/* ---- talking to the process */

static double chunk_count(const zarr_volume *v)
{
    double count = 1;
    for (int k = 0; k < 3; k++) {
        const int64_t side = v->m.chunk[v->m.space[k]];
        count *= (double)((v->low[k] + v->count[k] - 1) / side - v->low[k] / side + 1);
    }
    return count;
}

static bool start(zarr_volume *v, error *e)
{
    const double seconds = fmin(seconds_at_least + seconds_per_chunk * chunk_count(v), seconds_most);
    const reader_params params = {v->params.program,      ZARR_READER_COMMAND, "chunk", -1,
                                  v->params.memory_limit, (unsigned)seconds};
    return v->reader.stream || reader_start(&params, &v->reader, e);
}

static bool ask(zarr_volume *v, int file, const zarr_request *request, unsigned char *to, error *e)
{
    return start(v, e) && reader_settle(&v->reader,
                                        reader_send(&v->reader, request, sizeof *request, file, e) &&
                                            reader_get_answer(&v->reader, NULL, 0, NULL, 0, e) &&
                                            reader_get(&v->reader, to, 1, request->unpacked, e),
                                        e);
}

/* ---- chunks */

/* Makes the file name of the chunk or shard at the indices `at`. */
static void name_file(const zarr_volume *v, const int64_t at[ZARR_AXES_MOST], char *out, size_t size)
{
    int used = snprintf(out, size, "%s%s", v->m.path, v->m.has_c_prefix ? "c" : "");
    for (int k = 0; k < v->m.axes && used >= 0 && (size_t)used < size; k++) {
        char separator[2] = {k > 0 || v->m.has_c_prefix ? v->m.separator : 0, 0};
        used += snprintf(out + used, size - (size_t)used, "%s%lld", separator, (long long)at[k]);
    }
}

/* Reads the index of a shard of `size` bytes, unless it is in memory. */
static bool read_index(zarr_volume *v, int file, uint64_t size, const int64_t shard_at[ZARR_AXES_MOST],
                       error *e)
{
    zarr_request request = {.unpacked = v->index_bytes};
    const size_t numbers = (size_t)v->m.axes * sizeof *shard_at;
    if (v->has_index && memcmp(v->index_of, shard_at, numbers) == 0) return true;
    if (v->m.has_index_checksum) request.packing = (zarr_packing){1, {ZARR_CRC32C}};
    request.length = v->index_bytes + (v->m.has_index_checksum ? 4 : 0);
    if (size < request.length)
        return error_set(
            e, ERROR_INPUT_DAMAGED,
            "the shard is shorter than its index: it is damaged or truncated. Copy or save it again.");
    request.offset = v->m.is_index_first ? 0 : size - request.length;
    v->has_index = ask(v, file, &request, v->index, e);
    memcpy(v->index_of, shard_at, numbers);
    return v->has_index;
}

/* Finds a chunk in the file of its shard, of `size` bytes. *length 0: the chunk is missing. */
static bool find_in_shard(zarr_volume *v, uint64_t size, const int64_t chunk_at[ZARR_AXES_MOST],
                          uint64_t *offset, uint64_t *length, error *e)
{
    int64_t number = 0;
    uint64_t entry[2];
    for (int k = 0; k < v->m.axes; k++) {
        const int64_t side = v->m.shard[k] / v->m.chunk[k];
        number = number * side + chunk_at[k] % side;
    }
    memcpy(entry, v->index + 16 * (size_t)number, sizeof entry);
    *offset = le64toh(entry[0]);
    *length = le64toh(entry[1]);
    if (*offset == UINT64_MAX && *length == UINT64_MAX) *length = 0;
    if (*length == 0) return true;
    return (*offset <= size && *length <= size - *offset) ||
           error_set(
               e, ERROR_INPUT_DAMAGED,
               "the shard ends before one of its chunks: it is damaged or truncated. Copy or save it again.");
}

/* For a chunk that is missing. */
static bool check_fill(const zarr_volume *v, const char *name, error *e)
{
    return v->m.has_fill ||
           error_set(
               e, ERROR_INPUT_DAMAGED,
               "%s: the chunk is missing and fill_value is null, so that its values are not defined: copy the "
               "directory again, or set fill_value in its metadata",
               name);
}

/* Unpacks a chunk into v->chunk. *is_there false: the chunk is missing and has the fill value. */
static bool read_chunk(zarr_volume *v, const int64_t chunk_at[ZARR_AXES_MOST], bool *is_there, error *e)
{
    char name[ZARR_PATH_SIZE + 256];
    int64_t file_at[ZARR_AXES_MOST];
    bool is_missing;
    struct stat st;
    zarr_request request = {.unpacked = v->chunk_bytes, .packing = v->m.packing};
    for (int k = 0; k < v->m.axes; k++) file_at[k] = chunk_at[k] / (v->m.shard[k] / v->m.chunk[k]);
    name_file(v, file_at, name, sizeof name);
    const int file = v->params.directory->open(v->params.directory->context, name, &is_missing, e);
    *is_there = false;
    if (file < 0) return is_missing && check_fill(v, name, e);
    bool ok = fstat(file, &st) == 0 || error_set(e, ERROR_INPUT_DAMAGED, "the file cannot be examined");
    request.length = ok ? (uint64_t)st.st_size : 0;
    if (ok && v->m.is_sharded) {
        const uint64_t size = request.length;
        ok = read_index(v, file, size, file_at, e) &&
             find_in_shard(v, size, chunk_at, &request.offset, &request.length, e);
    }
    *is_there = ok && (!v->m.is_sharded || request.length > 0);
    if (*is_there) ok = ask(v, file, &request, v->chunk, e);
    close(file);
    if (ok && !*is_there) return check_fill(v, name, e);
    return ok || error_prefix(e, "%s", name);
}

static int64_t larger(int64_t a, int64_t b)
{
    return a > b ? a : b;
}

static int64_t smaller(int64_t a, int64_t b)
{
    return a < b ? a : b;
}

/* Stores the fill value in the type of the file. */
static void store_fill(const zarr_volume *v, unsigned char bytes[8])
{
    const double fill = v->m.fill;
    union {
        int8_t i8;
        uint8_t u8;
        int16_t i16;
        uint16_t u16;
        int32_t i32;
        uint32_t u32;
        int64_t i64;
        uint64_t u64;
        float f;
        double d;
        unsigned char bytes[8];
    } n = {.u64 = 0};
    const double whole = fill >= -0x1p62 && fill <= 0x1p63 - 1024 ? fill : 0;
    switch (v->m.type) {
    case NUMBER_FLOAT:
        n.f = (float)fill;
        break;
    case NUMBER_DOUBLE:
        n.d = fill;
        break;
    case NUMBER_UINT64:
        n.u64 = (uint64_t)larger((int64_t)whole, 0);
        break;
    case NUMBER_INT64:
        n.i64 = (int64_t)whole;
        break;
    case NUMBER_INT32:
    case NUMBER_UINT32:
        n.u32 = (uint32_t)(int64_t)whole;
        break;
    case NUMBER_INT16:
    case NUMBER_UINT16:
        n.u16 = (uint16_t)(int64_t)whole;
        break;
    default:
        n.u8 = (uint8_t)(int64_t)whole;
    }
    const int size = (int)number_bytes(v->m.type);
    for (int k = 0; k < size; k++) bytes[k] = n.bytes[v->m.is_swapped ? size - 1 - k : k];
}

/* Copies the requested part of a chunk to its position in the layer. chunk_at: along the spatial axes,
 * slowest first. */
static void place_chunk(zarr_volume *v, const int64_t chunk_at[3], bool is_there)
{
    const size_t size = value_bytes(v);
    int64_t begin[3], end[3], first[3];
    unsigned char fill[8];
    int64_t offset = 0; /* offset along the axes that are not spatial */
    store_fill(v, fill);
    for (int k = 0; k < v->m.axes; k++) offset += v->at[k] % v->m.chunk[k] * v->step[k];
    for (int k = 0; k < 3; k++) {
        const int64_t side = v->m.chunk[v->m.space[k]];
        first[k] = chunk_at[k] * side;
        begin[k] = larger(first[k], v->low[k]);
        end[k] = smaller(first[k] + side, v->low[k] + v->count[k]);
    }
    const int64_t layer_first = larger(chunk_at[0] * v->m.chunk[v->m.space[0]], v->low[0]);
    for (int64_t z = begin[0]; z < end[0]; z++)
        for (int64_t y = begin[1]; y < end[1]; y++) {
            unsigned char *to =
                v->numbers + (size_t)(((z - layer_first) * v->count[1] + (y - v->low[1])) * v->count[2] +
                                      (begin[2] - v->low[2])) *
                                 size;
            int64_t from = offset + (z - first[0]) * v->step[v->m.space[0]] +
                           (y - first[1]) * v->step[v->m.space[1]] +
                           (begin[2] - first[2]) * v->step[v->m.space[2]];
            for (int64_t x = begin[2]; x < end[2]; x++, to += size, from += v->step[v->m.space[2]])
                memcpy(to, is_there ? v->chunk + (size_t)from * size : fill, size);
        }
}

static bool read_layer(zarr_volume *v, int64_t layer, error *e)
{
    int64_t at[ZARR_AXES_MOST], low[3], high[3];
    v->layer = EMPTY;
    for (int k = 0; k < v->m.axes; k++) at[k] = v->at[k] / v->m.chunk[k];
    for (int k = 0; k < 3; k++) {
        const int64_t side = v->m.chunk[v->m.space[k]];
        low[k] = v->low[k] / side;
        high[k] = (v->low[k] + v->count[k] - 1) / side;
    }
    at[v->m.space[0]] = layer;
    for (int64_t y = low[1]; y <= high[1]; y++)
        for (int64_t x = low[2]; x <= high[2]; x++) {
            bool is_there;
            at[v->m.space[1]] = y;
            at[v->m.space[2]] = x;
            if (!read_chunk(v, at, &is_there, e)) return false;
            place_chunk(v, (const int64_t[3]){layer, y, x}, is_there);
        }
    v->layer = layer;
    return true;
}

/* ---- as slices */

/* Number of requested slices in a layer of chunks. */
static int64_t layer_slices(const zarr_volume *v)
{
    return smaller(v->m.chunk[v->m.space[0]], v->count[0]);
}

static bool make_room(zarr_volume *v, error *e)
{
    const size_t slice = (size_t)(v->count[1] * v->count[2]) * value_bytes(v);
    if (v->numbers) return true;
    v->numbers = mem_array((size_t)layer_slices(v), slice, "a layer of chunks", e);
    v->chunk = mem_array(1, v->chunk_bytes, "a chunk", e);
    v->index = mem_array(1, v->index_bytes + 1, "the index of a shard", e);
    return v->numbers && v->chunk && v->index;
}

static bool zarr_read(slices *base, int64_t k, double *values, error *e)
{
    zarr_volume *v = (zarr_volume *)base;
    const int64_t side = v->m.chunk[v->m.space[0]], z = v->low[0] + k, layer = z / side,
                  first = larger(layer * side, v->low[0]), slice = v->count[1] * v->count[2];
    if (!make_room(v, e) || (v->layer != layer && !read_layer(v, layer, e))) return false;
    numbers_convert(v->numbers + (size_t)((z - first) * slice) * value_bytes(v), v->m.type, v->m.is_swapped,
                    slice, values, base->inexact);
    return true;
}

static void zarr_close(slices *base)
{
    zarr_volume *v = (zarr_volume *)base;
    reader_close(&v->reader);
    free(v->numbers);
    free(v->chunk);
    free(v->index);
    free(v);
}

static const slices_ops zarr_ops = {zarr_read, zarr_close};

/* ---- choice of the samples */

/* Sets the position along the axes that are not spatial from the index, in which the last axis is the
 * fastest. */
static bool choose_volume(zarr_volume *v, int64_t index, error *e)
{
    v->base.volumes = 1;
    for (int k = 0; k < v->m.axes; k++) {
        bool is_space = false;
        for (int n = 0; n < 3; n++) is_space |= v->m.space[n] == k;
        if (is_space) continue;
        if (v->m.shape[k] == 0) return error_set(e, ERROR_NO_SURFACE, "the array has no values");
        if (v->base.volumes > INT64_MAX / v->m.shape[k])
            return error_set(e, ERROR_INPUT_DAMAGED, "claims more volumes than can be counted");
        v->base.volumes *= v->m.shape[k];
    }
    if (!slices_choose_volume(&v->base, &index, e)) return false;
    for (int k = v->m.axes - 1; k >= 0; k--) {
        bool is_space = false;
        for (int n = 0; n < 3; n++) is_space |= v->m.space[n] == k;
        if (is_space) continue;
        v->at[k] = index % v->m.shape[k];
        index /= v->m.shape[k];
    }
    return true;
}

/* Limits the samples to those in and near the region. If the region is outside of the data, some samples at
 * the nearest end remain. */
static void crop(zarr_volume *v)
{
    for (int k = 0; k < 3; k++) {
        const int64_t all = v->m.shape[v->m.space[k]];
        int64_t low = 0, high = all - 1;
        if (v->params.region) {
            const double step = v->m.scale[k], from = v->m.translation[k];
            const double a = (vec3_get(v->params.region->min, v->m.row[k]) - from) / step - around,
                         b = (vec3_get(v->params.region->max, v->m.row[k]) - from) / step + around;
            low = a > 0 ? (int64_t)fmin(a, (double)high) : 0;
            high = b < (double)high ? (int64_t)fmax(b, 0) : high;
            if (high - low < 1) {
                low = larger(0, high - 1);
                high = smaller(all - 1, low + 1);
            }
        }
        v->low[k] = low;
        v->count[k] = high - low + 1;
    }
}

static void place(zarr_volume *v)
{
    double *m = v->base.index_to_world;
    for (int k = 0; k < 3; k++) { /* column 0 of the matrix is the fastest axis */
        const int axis = 2 - k, row = v->m.row[axis];
        m[4 * row + k] = v->m.scale[axis];
        m[4 * row + 3] = v->m.translation[axis] + v->m.scale[axis] * (double)v->low[axis];
        v->base.size[k] = v->count[axis];
    }
    m[15] = 1;
}

static bool check_limits(zarr_volume *v, error *e)
{
    const double chunks = chunk_count(v), bytes = (double)value_bytes(v);
    double needed = 1, index = 16;
    for (int k = 0; k < v->m.axes; k++) {
        needed *= (double)v->m.chunk[k];
        index *= (double)(v->m.shard[k] / v->m.chunk[k]);
    }
    v->chunk_bytes = (size_t)(needed * bytes);
    v->index_bytes = v->m.is_sharded ? (size_t)index : 0;
    if (chunks > (double)v->params.most_chunks)
        return error_set(
            e, ERROR_INPUT_UNSUPPORTED,
            "%.0f chunks would be read, and the limit is %lld: choose a coarser level, give a region, or raise limits.max_chunks",
            chunks, (long long)v->params.most_chunks);
    needed = needed * bytes * 3 +
             (double)layer_slices(v) * (double)v->count[1] * (double)v->count[2] * bytes +
             (double)v->index_bytes;
    return needed <= (double)v->params.memory_limit ||
           error_set(
               e, ERROR_LIMIT_MEMORY,
               "a layer of its chunks (%lld slices of %lld x %lld) requires %.0f MiB, and %zu MiB of the limit are left: choose a coarser "
               "level, give a region, or raise limits.memory_mb",
               (long long)layer_slices(v), (long long)v->count[2], (long long)v->count[1],
               ceil(needed / (1 << 20)), v->params.memory_limit >> 20);
}

static void find_steps(zarr_volume *v)
{
    int64_t step = 1;
    for (int k = v->m.axes - 1; k >= 0; k--) {
        v->step[v->m.stored[k]] = step;
        step *= v->m.chunk[v->m.stored[k]];
    }
}

/* Adds a warning if there is a chunk behind the last one of an axis, in the middle of the other axes: the shape
 * may be too small. */
static void note_chunks_outside(zarr_volume *v)
{
    for (int k = 0; k < 3; k++) {
        char name[ZARR_PATH_SIZE + 256];
        int64_t file_at[ZARR_AXES_MOST];
        bool is_missing;
        error e = {0};
        for (int n = 0; n < v->m.axes; n++) file_at[n] = v->m.shape[n] / 2 / v->m.shard[n];
        const int axis = v->m.space[k];
        const int64_t side = v->m.shard[axis];
        file_at[axis] = (v->m.shape[axis] + side - 1) / side;
        name_file(v, file_at, name, sizeof name);
        const int file = v->params.directory->open(v->params.directory->context, name, &is_missing, &e);
        if (file < 0) continue;
        close(file);
        dense_warn(
            &v->base.warnings,
            "the chunk %.120s lies outside of the shape of the array, and is not read. Compare the shape "
            "with the chunks.",
            name);
        return;
    }
}

static bool prepare(zarr_volume *v, error *e)
{
    zarr_metadata *m = &v->m;
    for (int k = 0; k < 3; k++) {
        if (m->shape[m->space[k]] < 2)
            return error_set(
                e, ERROR_NO_SURFACE,
                "the volume has %lld x %lld x %lld samples: give one with at least two along each axis",
                (long long)m->shape[m->space[2]], (long long)m->shape[m->space[1]],
                (long long)m->shape[m->space[0]]);
        v->base.size[2 - k] = m->shape[m->space[k]];
        if (v->params.voxel_size) m->scale[k] = v->params.voxel_size[m->row[k]];
    }
    if (!choose_volume(v, v->params.index, e)) return false;
    crop(v);
    find_steps(v);
    place(v);
    v->base.warnings = m->warnings;
    if (m->has_fill && m->fill != 0)
        snprintf(v->base.warnings.no_data, sizeof v->base.warnings.no_data, "%.9g", m->fill);
    if (!v->params.voxel_size && !m->is_ome)
        dense_warn(
            &v->base.warnings,
            "the directory is a Zarr array without the metadata of OME-Zarr: voxels are 1 x 1 x 1. Set voxel_size.");
    if (!v->params.voxel_size)
        dense_warn_of_unit(&v->base.warnings, strcmp(m->unit, "millimeter") == 0 ? "mm" : m->unit);
    v->base.type = numbers_name(m->type);
    v->base.fine = numbers_need_doubles(m->type);
    note_chunks_outside(v);
    return check_limits(v, e);
}

slices *zarr_volume_open(const zarr_request_volume *request, error *e)
{
    zarr_volume *v = mem_alloc(sizeof *v);
    *v = (zarr_volume){.base = {.ops = &zarr_ops, .components = 1, .format = "OME-Zarr"},
                       .params = *request,
                       .layer = EMPTY};
    if (zarr_metadata_read(request->directory, request->level, &v->m, e) && prepare(v, e)) return &v->base;
    zarr_close(&v->base);
    return NULL;
}

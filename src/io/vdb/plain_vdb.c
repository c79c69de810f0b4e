// SPDX-License-Identifier: Apache-2.0
#include "io/vdb/plain_vdb.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include "base/core/memory.h"
#include "base/core/module.h"

enum {
    MAGIC = 0x56444220,
    VERSION_LEAST = 222,
    VERSION_MOST = 224,
    UUID = 36,
    STRING = 1 << 16, /* bytes of a name or a type */
    WINDOW = 1 << 16, /* bytes that are read at a time */
    LEAF_MASK = 64,   /* bytes of a leaf's mask */
    LEAVES = 256      /* leaves in a chunk of work */
};

/* Flags: how values are compressed. */
enum { ZIPPED = 1, MASKED = 2, BLOSC = 4 };
/* The values that a node stores: the background or its negative for all inactive voxels (nothing stored),
 * one other value, a mask that selects one of two values for each inactive voxel, or all values. */
enum { ALL_BACKGROUND, ALL_NEGATIVE, ALL_ONE, EITHER_BACKGROUND, EITHER_ONE, EITHER_TWO, ALL_VALUES };

/* Levels of nodes between the root and the leaves. */
enum { NODE_LEVELS = 2, NODE_MOST = 1 << 15, NODE_WORDS = NODE_MOST / 64 };
static const struct {
    int log2_side;    /* children along an axis */
    int32_t children; /* voxels along an axis of a child */
} node_level[NODE_LEVELS] = {{5, 128}, {4, 8}};

/* Largest accepted condition number: beyond it the inverse of the transform loses more than half of the
 * digits of a double. */
static const double largest_condition = 1e8;

typedef int blosc_decompress(const void *from, void *to, size_t bytes, int threads);

/* Maximum size of packed data: compression may enlarge them slightly. */
#define PACKED(bytes) ((bytes) + (bytes) / 8 + 64)

typedef struct cursor {
    int fd;
    int64_t next, size; /* next: offset in the file of the first byte that was not read; size: length of the
                         * file */
    size_t at, held;
    bool failed; /* the file is truncated, or not of the usual kind */
    unsigned char window[WINDOW];
} cursor;

typedef struct descriptor {
    char name[VDB_NAME_SIZE];
    char type[VDB_TYPE_SIZE];
    bool half, shared;
    int64_t end;
} descriptor;

/* The current node of each level. */
typedef struct nodes {
    float values[NODE_LEVELS][NODE_MOST];
    uint64_t children[NODE_LEVELS][NODE_WORDS], active[NODE_LEVELS][NODE_WORDS];
} nodes;

/* State of the reading of a tree. */
typedef struct reading {
    cursor *from;
    vdb_grid *grid;
    uint32_t compression;
    bool half;
    blosc_decompress *blosc;
    size_t leaf_room, active_room, tile_room, memory_limit;
    unsigned char *packed, *unpacked; /* buffers for the values of one node */
    nodes *nodes;
} reading;

/* ---- bytes */

static void require(cursor *c, bool holds)
{
    if (!holds) c->failed = true;
}

static void take(cursor *c, void *to, size_t count)
{
    char *out = to;
    while (count > 0 && !c->failed) {
        size_t part = c->held - c->at;
        if (part == 0) {
            const ssize_t got = pread(c->fd, c->window, WINDOW, (off_t)c->next);
            c->failed = got <= 0;
            c->at = 0;
            c->held = got > 0 ? (size_t)got : 0;
            c->next += got > 0 ? got : 0;
            continue;
        }
        if (part > count) part = count;
        memcpy(out, c->window + c->at, part);
        c->at += part;
        out += part;
        count -= part;
    }
    if (count > 0) memset(out, 0, count);
}

static int64_t where_at(const cursor *c)
{
    return c->next - (int64_t)(c->held - c->at);
}

static int64_t bytes_left(const cursor *c)
{
    return c->size - where_at(c);
}

static void go_to(cursor *c, int64_t where)
{
    const int64_t here = where_at(c);
    require(c, where >= here && where <= c->size);
    if (c->failed) return;
    if (where <= c->next) { /* the window contains the position */
        c->at += (size_t)(where - here);
        return;
    }
    c->next = where;
    c->at = c->held = 0;
}

static void skip(cursor *c, int64_t count)
{
    go_to(c, where_at(c) + count);
}

static uint32_t take_u32(cursor *c)
{
    uint32_t value;
    take(c, &value, sizeof value);
    return value;
}

static int64_t take_i64(cursor *c)
{
    int64_t value;
    take(c, &value, sizeof value);
    return value;
}

/* Reads a string shorter than `room` without zero bytes. Any other string is a failure. */
static void take_string(cursor *c, char *out, size_t room)
{
    const uint32_t length = take_u32(c);
    require(c, length < room);
    if (c->failed) return;
    take(c, out, length);
    out[length] = '\0';
    require(c, strlen(out) == length);
}

/* ---- what precedes trees */

typedef struct metadata {
    vdb_class grid_class;
    bool half, is_local;
    char unit[VDB_UNIT_SIZE];
} metadata;

static vdb_class class_of(cursor *c, const char *word)
{
    if (strcmp(word, "level set") == 0) return VDB_LEVEL_SET;
    if (strcmp(word, "fog volume") == 0) return VDB_FOG;
    if (strcmp(word, "staggered") == 0) return VDB_STAGGERED;
    require(c, strcmp(word, "unknown") == 0);
    return VDB_UNKNOWN;
}

static bool take_bool(cursor *c, const char *type)
{
    char on = 0;
    require(c, take_u32(c) == sizeof on && strcmp(type, "bool") == 0);
    take(c, &on, sizeof on);
    return on;
}

static metadata take_metadata(cursor *c)
{
    metadata m = {.grid_class = VDB_UNKNOWN};
    const uint32_t count = take_u32(c);
    for (uint32_t i = 0; i < count && !c->failed; i++) {
        char name[256], type[64];
        take_string(c, name, sizeof name);
        take_string(c, type, sizeof type);
        /* for a string, the length of the metadata is that of the string */
        if (!c->failed && strcmp(name, "class") == 0) {
            char word[64];
            take_string(c, word, sizeof word);
            require(c, strcmp(type, "string") == 0);
            if (!c->failed) m.grid_class = class_of(c, word);
        } else if (!c->failed && strcmp(name, "is_saved_as_half_float") == 0) {
            m.half = take_bool(c, type);
        } else if (!c->failed && strcmp(name, "is_local_space") == 0) {
            m.is_local = take_bool(c, type);
        } else if (!c->failed && vdb_is_unit(name) && strcmp(type, "string") == 0) {
            take_string(c, m.unit, sizeof m.unit); /* a longer unit is left to the library */
        } else {
            skip(c, take_u32(c));
        }
    }
    return m;
}

/* Reads the header of the file. Returns the number of grids. */
static uint32_t take_head(cursor *c)
{
    char offsets;
    require(c, take_i64(c) == MAGIC);
    const uint32_t version = take_u32(c);
    require(c, version >= VERSION_LEAST && version <= VERSION_MOST);
    skip(c, 2 * sizeof(uint32_t)); /* version of the library */
    take(c, &offsets, 1);
    require(c, offsets == 1);
    skip(c, UUID);
    (void)take_metadata(c);
    return take_u32(c);
}

/* Reads a type such as "Tree_float_5_4_3_HalfFloat": float, stored as half. */
static void take_type(cursor *c, descriptor *d)
{
    static const char *const known[] = {"float", "double", "int32", "int64",
                                        "bool",  "vec3s",  "vec3d", "vec3i"};
    static const char before[] = "Tree_", after[] = "_5_4_3", half[] = "_HalfFloat";
    char text[VDB_TYPE_SIZE];
    take_string(c, text, sizeof text);
    if (!c->failed) require(c, strncmp(text, before, strlen(before)) == 0);
    if (c->failed) return;
    const char *stem = text + strlen(before), *end = strchr(stem, '_');
    const size_t length = end ? (size_t)(end - stem) : 0;
    memcpy(d->type, stem, length);
    size_t k = 0;
    while (k < sizeof known / sizeof *known && strcmp(known[k], d->type) != 0) k++;
    require(c, k < sizeof known / sizeof *known && strncmp(end, after, strlen(after)) == 0);
    if (c->failed) return;
    end += strlen(after);
    d->half = strcmp(end, half) == 0;
    require(c, d->half || *end == '\0');
}

static void take_descriptor(cursor *c, descriptor *d)
{
    char parent[VDB_NAME_SIZE];
    memset(d, 0, sizeof *d);
    take_string(c, d->name, sizeof d->name);
    d->name[strcspn(d->name, "\x1e")] = '\0'; /* equal names are stored as NAME 0x1e NUMBER */
    take_type(c, d);
    take_string(c, parent, sizeof parent);
    d->shared = *parent;
    skip(c, 2 * sizeof(int64_t)); /* offsets of the grid and of its voxels */
    d->end = take_i64(c);
}

static cursor *open_cursor(int fd)
{
    struct stat st;
    if (fstat(fd, &st) != 0 || !S_ISREG(st.st_mode)) return NULL;
    cursor *c = mem_alloc(sizeof *c);
    c->fd = fd;
    c->size = st.st_size;
    return c;
}

bool plain_vdb_list_grids(int fd, vdb_listing *out)
{
    cursor *c = open_cursor(fd);
    if (!c) return false;
    vdb_listing list = {NULL, 0};
    size_t room = 0;
    const uint32_t count = take_head(c);
    for (uint32_t i = 0; i < count && !c->failed; i++) {
        descriptor d;
        take_descriptor(c, &d);
        (void)take_u32(c); /* compression flags, repeated for each grid */
        const metadata m = take_metadata(c);
        go_to(c, d.end);
        if (!c->failed) require(c, MEM_GROW(list.entries, list.count, &room, "the grids", NULL));
        if (c->failed) break;
        vdb_entry *e = &list.entries[list.count++];
        *e = (vdb_entry){.scalar = strcmp(d.type, "float") == 0 || strcmp(d.type, "double") == 0,
                         .numeric = true,
                         .grid_class = m.grid_class};
        memcpy(e->name, d.name, sizeof e->name);
        memcpy(e->type, d.type, sizeof e->type);
    }
    const bool ok = !c->failed && count > 0;
    free(c);
    if (ok)
        *out = list;
    else
        vdb_listing_free(&list);
    return ok;
}

/* ---- the transform */

/* Reads an affine transform. Fails on other ones and on nearly singular ones, which are left to the
 * library. */
static void take_transform(cursor *c, double out[16])
{
    static const struct {
        const char *name;
        int translation, scale, all; /* offset of the translation and of the scale among the numbers; -1:
                                      * none; `all`: count of numbers */
    } maps[] = {
        {"UniformScaleMap", -1, 0, 15},  {"ScaleMap", -1, 0, 15},      {"UniformScaleTranslateMap", 0, 3, 18},
        {"ScaleTranslateMap", 0, 3, 18}, {"TranslationMap", 0, -1, 3}, {"AffineMap", -1, -1, 16},
        {"UnitaryMap", -1, -1, 16}};
    char name[64];
    double number[18], largest = 0;
    size_t kind = 0;
    take_string(c, name, sizeof name);
    while (!c->failed && kind < sizeof maps / sizeof *maps && strcmp(maps[kind].name, name) != 0) kind++;
    require(c, kind < sizeof maps / sizeof *maps);
    if (c->failed) return;
    take(c, number, (size_t)maps[kind].all * sizeof *number);
    for (int k = 0; k < 16; k++) /* OpenVDB multiplies row vectors */
        out[k] = maps[kind].all == 16 ? number[4 * (k % 4) + k / 4] : k % 5 == 0;
    for (int axis = 0; axis < 3; axis++) {
        if (maps[kind].scale >= 0) out[5 * axis] = number[maps[kind].scale + axis];
        if (maps[kind].translation >= 0) out[4 * axis + 3] = number[maps[kind].translation + axis];
    }
    for (int k = 0; k < 16; k++) {
        require(c, isfinite(out[k]));
        if (k < 12 && k % 4 < 3) largest = fmax(largest, fabs(out[k]));
    }
    const double *m = out, determinant = m[0] * (m[5] * m[10] - m[6] * m[9]) -
                                         m[1] * (m[4] * m[10] - m[6] * m[8]) +
                                         m[2] * (m[4] * m[9] - m[5] * m[8]);
    require(c, fabs(determinant) * largest_condition > largest * largest * largest);
}

/* ---- values */

static float float_of_half(uint16_t half)
{
    uint32_t bits = (uint32_t)(half & 0x7FFF) << 13;
    float value;
    if ((half & 0x7C00) == 0x7C00) {
        bits |= 0x7F800000;
        memcpy(&value, &bits, sizeof value);
    } else {
        memcpy(&value, &bits, sizeof value);
        value *= 0x1p112f; /* 2^112: the difference of the exponents; also normalises subnormal numbers */
    }
    return half & 0x8000 ? -value : value;
}

static bool unpack(const reading *r, size_t length, size_t bytes)
{
    if (r->compression & BLOSC) {
        uint32_t head[4]; /* version and type; length of the values, of a block, of the packed data */
        if (!r->blosc || length < sizeof head) return false;
        memcpy(head, r->packed, sizeof head);
        return head[1] == bytes && head[3] == length &&
               r->blosc(r->packed, r->unpacked, bytes, 1) == (int)bytes;
    }
    uLongf unpacked = bytes;
    return uncompress(r->unpacked, &unpacked, r->packed, length) == Z_OK && unpacked == bytes;
}

static size_t bytes_of(const reading *r, size_t count)
{
    return count * (r->half ? sizeof(uint16_t) : sizeof(float));
}

/* Reads the length before `count` stored values: the number of packed bytes, or minus the number of bytes
 * that are not packed. */
static int64_t take_length(reading *r, size_t count)
{
    cursor *c = r->from;
    const size_t bytes = bytes_of(r, count);
    const int64_t length = r->compression & (ZIPPED | BLOSC) ? take_i64(c) : -(int64_t)bytes;
    if (length > 0)
        require(c, length <= bytes_left(c) && (size_t)length <= PACKED(bytes));
    else
        require(c, length == -(int64_t)bytes);
    return c->failed ? 0 : length;
}

/* Reads the `count` values that a node stores. */
static void take_stored(reading *r, size_t count, float *out)
{
    cursor *c = r->from;
    const size_t bytes = bytes_of(r, count);
    if (r->half && count == 0) return;
    const int64_t length = take_length(r, count);
    if (length > 0) {
        take(c, r->packed, (size_t)length);
        require(c, !c->failed && unpack(r, (size_t)length, bytes));
    } else {
        take(c, r->unpacked, bytes);
    }
    if (!r->half) memcpy(out, r->unpacked, bytes);
    for (size_t k = 0; r->half && k < count; k++) {
        uint16_t half;
        memcpy(&half, r->unpacked + sizeof half * k, sizeof half);
        out[k] = float_of_half(half);
    }
}

/* Moves the stored active values from the front of the array to their voxels, in place and from the last
 * one, and sets the inactive voxels. Processes eight voxels at a time, since most groups are all active or
 * all inactive. */
static void spread(const uint64_t *active, const uint64_t *chosen, const float inactive[2], size_t stored,
                   size_t count, float *values)
{
    enum { ROW = 8 };
    for (size_t at = count; at > 0; at -= ROW) {
        const size_t first = at - ROW;
        const unsigned is_active = active[first / 64] >> first % 64 & 0xff,
                       which = chosen[first / 64] >> first % 64 & 0xff;
        float *row = values + first;
        if (is_active == 0xff) {
            stored -= ROW;
            memmove(row, values + stored, ROW * sizeof *row);
        } else {
            for (int k = ROW; k-- > 0;)
                row[k] = is_active >> k & 1 ? values[--stored] : inactive[which >> k & 1];
        }
    }
}

/* Reads the kind of a node's values, its inactive values and its mask. Returns the number of values that are
 * stored, at most `count`. */
static size_t take_kind(reading *r, const uint64_t *active, size_t count, float inactive[2], uint64_t *chosen)
{
    cursor *c = r->from;
    const float background = r->grid->background;
    unsigned char kind;
    take(c, &kind, 1);
    require(c, kind == ALL_VALUES || (kind < ALL_VALUES && r->compression & MASKED));
    inactive[0] = kind == ALL_BACKGROUND ? background : -background;
    inactive[1] = background;
    if (kind == ALL_ONE || kind == EITHER_ONE || kind == EITHER_TWO) take(c, &inactive[0], sizeof(float));
    if (kind == EITHER_TWO) take(c, &inactive[1], sizeof(float));
    if (kind == EITHER_BACKGROUND || kind == EITHER_ONE || kind == EITHER_TWO)
        take(c, chosen, count / 8);
    else
        memset(chosen, 0, count / 8);
    if (kind == ALL_VALUES) return count;
    size_t stored = 0;
    for (size_t w = 0; w < count / 64; w++) stored += (size_t)__builtin_popcountll(active[w]);
    return stored;
}

/* Reads all values of a node. Values with a bit in `active` are always stored. */
static void take_values(reading *r, const uint64_t *active, size_t count, float *out)
{
    uint64_t chosen[NODE_WORDS];
    float inactive[2];
    const size_t stored = take_kind(r, active, count, inactive, chosen);
    if (r->from->failed) return;
    take_stored(r, stored, out);
    if (stored < count) spread(active, chosen, inactive, stored, count, out);
}

/* Skips the values of a leaf. */
static void skip_values(reading *r, const uint64_t *active)
{
    uint64_t chosen[LEAF_MASK / 8];
    float inactive[2];
    const size_t stored = take_kind(r, active, VDB_LEAF_VOXELS, inactive, chosen);
    if (!r->half || stored > 0) skip(r->from, llabs(take_length(r, stored)));
}

/* ---- the tree */

static void add_tile(reading *r, const int32_t origin[3], int32_t side, float value, bool active)
{
    vdb_grid *g = r->grid;
    if (active) g->active_voxels += (uint64_t)side * (uint64_t)side * (uint64_t)side;
    if (value == g->background) return;
    require(r->from, g->tile_count < r->memory_limit / (4 * sizeof *g->tiles) &&
                         MEM_GROW(g->tiles, g->tile_count, &r->tile_room, "tiles", NULL));
    if (r->from->failed) return;
    g->tiles[g->tile_count++] = (vdb_tile){{origin[0], origin[1], origin[2]}, side, value, active};
}

static void take_leaf(reading *r, const int32_t origin[3])
{
    vdb_grid *g = r->grid;
    const size_t each = VDB_LEAF_VOXELS * sizeof(float) + 256;
    require(r->from, g->leaf_count < r->memory_limit / each &&
                         MEM_GROW(g->leaf_origin, g->leaf_count, &r->leaf_room, "leaves", NULL) &&
                         MEM_GROW(g->leaf_active, 8 * g->leaf_count, &r->active_room, "leaves", NULL));
    if (r->from->failed) return;
    uint64_t *active = g->leaf_active + 8 * g->leaf_count;
    memcpy(g->leaf_origin[g->leaf_count], origin, sizeof *g->leaf_origin);
    take(r->from, active, LEAF_MASK);
    for (int w = 0; w < 8; w++) g->active_voxels += (uint64_t)__builtin_popcountll(active[w]);
    g->leaf_count++;
}

static void take_node(reading *r, int level, const int32_t origin[3])
{
    const int shift = node_level[level].log2_side;
    const int32_t side = node_level[level].children, last = (1 << shift) - 1;
    const size_t count = (size_t)1 << (3 * shift);
    uint64_t *children = r->nodes->children[level], *active = r->nodes->active[level];
    take(r->from, children, count / 8);
    take(r->from, active, count / 8);
    take_values(r, active, count, r->nodes->values[level]);
    for (int pass = 0; pass < 2; pass++) /* first the tiles, then the children, which follow all tiles in the
                                          * file */
        for (int32_t k = 0; k < (int32_t)count && !r->from->failed; k++) {
            const bool is_child = children[k / 64] >> (k % 64) & 1;
            const int32_t at[3] = {origin[0] + side * (k >> 2 * shift),
                                   origin[1] + side * (k >> shift & last), origin[2] + side * (k & last)};
            if (is_child != pass) continue;
            if (!is_child)
                add_tile(r, at, side, r->nodes->values[level][k], active[k / 64] >> (k % 64) & 1);
            else if (level + 1 < NODE_LEVELS)
                take_node(r, level + 1, at);
            else
                take_leaf(r, at);
        }
}

static bool comes_after(const int32_t a[3], const int32_t b[3])
{
    for (int axis = 0; axis < 3; axis++)
        if (a[axis] != b[axis]) return a[axis] > b[axis];
    return false;
}

/* Reads the topology. The library sorts the children of the root by position and keeps the last of equal
 * ones; here they must be sorted and different. Tiles of the root, which are rare, are left to the
 * library. */
static void take_topology(reading *r)
{
    const int32_t side = node_level[0].children << node_level[0].log2_side;
    cursor *c = r->from;
    int32_t before[3] = {0};
    require(c, take_u32(c) == 1); /* number of buffers */
    take(c, &r->grid->background, sizeof r->grid->background);
    const uint32_t tiles = take_u32(c), count = take_u32(c);
    require(c, tiles == 0);
    for (uint32_t i = 0; i < count && !c->failed; i++) {
        int32_t origin[3];
        take(c, origin, sizeof origin);
        for (int axis = 0; axis < 3; axis++) require(c, origin[axis] % side == 0);
        require(c, i == 0 || comes_after(origin, before));
        memcpy(before, origin, sizeof before);
        if (!c->failed) take_node(r, 0, origin);
    }
}

/* Reads the mask of a leaf again, which is repeated before its values. */
static void take_mask_again(reading *r, size_t leaf, uint64_t mask[LEAF_MASK / 8])
{
    take(r->from, mask, LEAF_MASK);
    require(r->from, memcmp(mask, r->grid->leaf_active + LEAF_MASK / 8 * leaf, LEAF_MASK) == 0);
}

/* Job: unpacks leaves in parallel, in chunks. */
typedef struct unpacking {
    const reading *r;
    const int64_t *where; /* per chunk: offset of its first leaf in the file */
    atomic_bool failed;
} unpacking;

static void unpack_chunk(void *context, int worker, size_t begin, size_t end)
{
    unpacking *job = context;
    unsigned char packed[PACKED(VDB_LEAF_VOXELS * sizeof(float))], unpacked[VDB_LEAF_VOXELS * sizeof(float)];
    cursor *c = mem_alloc(sizeof *c);
    reading r = *job->r;
    (void)worker;
    c->fd = r.from->fd;
    c->size = r.from->size;
    c->next = job->where[begin / LEAVES];
    r.from = c;
    r.packed = packed;
    r.unpacked = unpacked;
    for (size_t n = begin; n < end && !c->failed; n++) {
        uint64_t mask[LEAF_MASK / 8];
        take_mask_again(&r, n, mask);
        take_values(&r, mask, VDB_LEAF_VOXELS, r.grid->leaf_values + n * VDB_LEAF_VOXELS);
    }
    if (c->failed) atomic_store(&job->failed, true);
    free(c);
}

/* Reads the values of all leaves. A first pass finds the offset of each chunk. */
static void take_leaf_values(reading *r, threads *pool)
{
    vdb_grid *g = r->grid;
    cursor *c = r->from;
    int64_t *where = mem_array(g->leaf_count / LEAVES + 1, sizeof *where, "leaves", NULL);
    require(c, where != NULL);
    for (size_t n = 0; n < g->leaf_count && !c->failed; n++) {
        uint64_t mask[LEAF_MASK / 8];
        if (n % LEAVES == 0) where[n / LEAVES] = where_at(c);
        take_mask_again(r, n, mask);
        skip_values(r, mask);
    }
    if (!c->failed)
        g->leaf_values = mem_array(g->leaf_count, VDB_LEAF_VOXELS * sizeof(float), "leaves", NULL);
    require(c, g->leaf_values);
    unpacking job = {r, where, false};
    if (!c->failed) threads_run(pool, g->leaf_count, LEAVES, unpack_chunk, &job);
    require(c, !atomic_load(&job.failed) && !threads_stopped(pool));
    free(where);
}

static void take_grid(reading *r, threads *pool)
{
    r->nodes = mem_alloc(sizeof *r->nodes);
    r->packed = mem_alloc(PACKED(sizeof r->nodes->values[0]));
    r->unpacked = mem_alloc(sizeof r->nodes->values[0]);
    if (r->compression & BLOSC)
        r->blosc = (blosc_decompress *)module_symbol("libblosc.so.1", "blosc_decompress_ctx", NULL);
    take_topology(r);
    take_leaf_values(r, pool);
    free(r->nodes);
    free(r->packed);
    free(r->unpacked);
}

vdb_grid *plain_vdb_load_grid(int fd, size_t index, size_t memory_limit, threads *pool)
{
    descriptor d = {.end = 0};
    cursor *c = open_cursor(fd);
    if (!c) return NULL;
    require(c, index < take_head(c));
    for (size_t i = 0; i <= index && !c->failed; i++) {
        if (i > 0) go_to(c, d.end);
        if (!c->failed) take_descriptor(c, &d);
    }
    vdb_grid *g = mem_alloc(sizeof *g);
    reading *r = mem_alloc(sizeof *r);
    r->from = c;
    r->grid = g;
    r->half = d.half;
    r->memory_limit = memory_limit;
    r->compression = take_u32(c);
    const metadata m = take_metadata(c);
    g->grid_class = m.grid_class;
    g->is_local = m.is_local;
    memcpy(g->unit, m.unit, sizeof g->unit);
    require(c, m.half == d.half && !d.shared && strcmp(d.type, "float") == 0);
    if (!c->failed) take_transform(c, g->index_to_world);
    if (!c->failed) take_grid(r, pool);
    const bool ok = !c->failed;
    free(r);
    free(c);
    if (ok) return g;
    vdb_grid_free(g);
    return NULL;
}

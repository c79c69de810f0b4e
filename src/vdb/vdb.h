/* vdb: OpenVDB files to and from plain arrays; the only C++ of the project is behind this header.
 *
 * Files are read through a stream over a descriptor, which fails at the first missing byte. A call reads all it needs
 * before it returns: nothing is loaded later or mapped, and no object of the library is kept afterwards. Sizes in the
 * file are checked against its length and a memory limit before they are used. No exception crosses this boundary. The
 * library can still abort or fault on a hostile file, so callers run it in a process of its own.
 *
 * Messages name the grid; the caller, who knows the file's name, puts it before them. Threads: calls share no state, but
 * two calls must not use one descriptor at the same time.
 */
#ifndef HEXAD_VDB_VDB_H
#define HEXAD_VDB_VDB_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#include "base/error.h"

#define VDB_NAME_SIZE 256 /* a file with a longer name is refused as damaged */
#define VDB_TYPE_SIZE 64
#define VDB_UNIT_SIZE 32
#define VDB_LEAF_SIDE 8
#define VDB_LEAF_VOXELS 512

typedef enum vdb_class { VDB_UNKNOWN, VDB_LEVEL_SET, VDB_FOG, VDB_STAGGERED } vdb_class;

typedef struct vdb_entry {
    char name[VDB_NAME_SIZE]; /* as written, without the suffix that distinguishes equal names */
    char type[VDB_TYPE_SIZE]; /* of a value: "float", "double", "int32", "vec3s", "ptdataidx32", ... */
    bool scalar;              /* float or double: vdb_load_grid takes it */
    bool numeric;             /* numbers, truth values or vectors of three: vdb_visit_grid takes it */
    vdb_class grid_class;
} vdb_entry;

typedef struct vdb_listing {
    vdb_entry *entries; /* in the order of the file */
    size_t count;
} vdb_listing;

/* What the file holds. Where the file has offsets no tree is read; otherwise (it was written to a
 * pipe) one tree after the other. Errors: input_damaged (Git-LFS pointers have a message of their own),
 * input_unsupported (format versions), limit_memory. */
bool vdb_list_grids(int fd, vdb_listing *out, error *e);
void vdb_listing_free(vdb_listing *listing);

/* A cube of voxels with one value that differs from the background. */
typedef struct vdb_tile {
    int32_t origin[3];
    int32_t side; /* 8, 128 or 4096 voxels */
    float value;
    bool active;
} vdb_tile;

/* A scalar grid. Within a leaf voxel (x, y, z) has offset 64 x + 8 y + z; its active flag is bit
 * 8 y + z of word x. A voxel in no leaf and no tile has the background value and is inactive. */
typedef struct vdb_grid {
    vdb_class grid_class;
    bool
        from_newer; /* the file has a later format version than the library, and is read as far as they are alike */
    bool is_local; /* its metadata say that it is in the space of an object, which is not in the file */
    char unit[VDB_UNIT_SIZE]; /* of its metadata, cut to fit; "": there is none */
    double zero;              /* subtracted from the values in the file, before these became floats */
    float background;
    double index_to_world[16]; /* row-major, column vectors: world = M (i, j, k, 1); invertible */
    uint64_t active_voxels;
    size_t leaf_count, tile_count;
    int32_t (*leaf_origin)[3]; /* multiples of 8 */
    float *leaf_values;        /* 512 a leaf */
    uint64_t *leaf_active;     /* 8 words a leaf */
    vdb_tile *tiles;
} vdb_grid;

/* Whether metadata of this name say in which unit a grid is; OpenVDB and its transforms have no units. */
bool vdb_is_unit(const char *name);

/* How a grid is loaded. */
typedef struct vdb_loading {
    double
        zero; /* subtracted from the values of a grid of doubles that is not a level set, before these become floats */
    bool flood; /* inactive voxels of a level set get their side from the active ones around them */
} vdb_loading;

/* Loads entry `index` of the listing. Doubles become floats. `memory_limit` bounds the call's peak,
 * the library's tree and the arrays together. Errors: input_damaged; input_unsupported
 * for a type that is not scalar and for a transform that is not affine or not invertible; limit_memory. */
vdb_grid *vdb_load_grid(int fd, size_t index, vdb_loading how, size_t memory_limit, error *e);
void vdb_grid_free(vdb_grid *grid);

/* A grid of any numeric type while vdb_visit_grid holds it. */
typedef struct vdb_voxels vdb_voxels;

struct vdb_voxels {
    int components; /* 1, or 3 of a vector */
    bool whole;     /* integers or truth values */
    vdb_class grid_class;
    int32_t low[3], high[3];   /* where `whole`: the box of the active voxels; low > high: there are none */
    double index_to_world[16]; /* as in vdb_grid */
    void *tree;                /* private */
    /* The value of a voxel, the background's where there is none; whether it is active. */
    bool (*read)(const vdb_voxels *v, const int32_t at[3], double value[3]);
    /* The same of one whole number, which a double may not hold. */
    int64_t (*read_whole)(const vdb_voxels *v, const int32_t at[3]);
};

typedef bool vdb_visitor(void *context, const vdb_voxels *voxels, error *e);

/* Reads entry `index` of the listing and hands it to a visitor, whose answer is the call's. The visitor throws nothing,
 * and the grid goes with the call. `memory_limit` bounds the library's tree. Errors: those of vdb_load_grid. */
bool vdb_visit_grid(int fd, size_t index, size_t memory_limit, vdb_visitor *visit, void *context, error *e);

/* One grid to write. Voxels are given one by one, tiles after them. */
typedef struct vdb_draft {
    const char *name;
    const char *
        type; /* "float", "double", "int32", "int64", "bool", or "vec3s", "vec3d", "vec3i" of equal components */
    bool half; /* store floats as 16 bits */
    vdb_class grid_class;
    double background;
    const double *index_to_world; /* as in vdb_grid; NULL: a frustum, which the reader refuses */
    size_t voxel_count;
    const int32_t (*voxels)[3];
    const float *values;
    const bool *active; /* NULL: all of them are */
    size_t tile_count;
    const vdb_tile *tiles;
} vdb_draft;

typedef enum vdb_layout {
    VDB_SEEKABLE, /* with offsets, as openvdb::io::File writes */
    VDB_STREAM    /* without, as openvdb::io::Stream writes */
} vdb_layout;

/* Writes a whole file at the descriptor's offset. The same drafts give the same bytes but for the
 * 36 bytes of the format's random identifier. Errors: input_unsupported for a draft that cannot be;
 * internal when writing fails. */
bool vdb_write_grids(int fd, const vdb_draft *drafts, size_t count, vdb_layout layout, bool compressed,
                     error *e);

/* What points carry beside their own attributes. */
typedef struct vdb_point_values {
    const char *name; /* none of the names below, none twice */
    int components; /* 1: float, or int64 if `whole`; more: vec3f, of which a third is 0 where there are two */
    bool whole;
    bool is_double;       /* three components: vec3d instead of vec3f */
    const double *values; /* `components` values per point, point after point */
} vdb_point_values;

/* Points to write as a points grid (what OpenVDB calls PointDataGrid). */
typedef struct vdb_points {
    size_t count;           /* > 0 */
    const double *position; /* 3 a point, world; finite */
    const double *normal;   /* 3 a point */
    const double *spacing;  /* of each */
    double voxel_size;      /* of the grid, world, > 0; no more than 2^31 of them span the points */
    const uint32_t *id;     /* of each, none twice; NULL: their places in the arrays, from 0 */
    const double *velocity; /* 3 a point; NULL: none */
    const double *orient;   /* unit quaternions, x y z w of each point; NULL: none */
    size_t value_count;
    const vdb_point_values *values;
} vdb_points;

/* Writes a whole seekable file at the descriptor's offset: one grid "points" whose transform has its origin
 * at the corner of the points' box, with the attributes P (relative to its voxel's centre, so exact to 2^-24
 * voxels), N (vec3f), pscale (float, half the spacing), id (int64) and, when there are any, the velocities v
 * (vec3f) and the orientations orient (quaternions of floats), then the other values. The same points give the same bytes: the format's identifier, random as the library has it, is
 * made of the contents. Errors: limit_memory; internal when writing fails. */
bool vdb_write_points(int fd, const vdb_points *points, error *e);

/* Reads a file from its beginning. Error: internal when it does not hold the points. */
bool vdb_verify_points(int fd, const vdb_points *points, error *e);

#ifdef __cplusplus
}
#endif

#endif

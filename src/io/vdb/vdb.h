// SPDX-License-Identifier: Apache-2.0
/* vdb: reads and writes OpenVDB files as plain arrays; the only C++ interface of the project.
 *
 * Files are read through a stream over a descriptor, which fails at the first missing byte. A call reads all
 * data before it returns: nothing is loaded later or mapped, and no object of the library is kept. Sizes in
 * the file are checked against its length and a memory limit before they are used. No exception crosses this
 * interface. The library can still abort or fault on a hostile file, so callers run it in a separate process.
 *
 * Messages contain the grid; the caller prepends the name of the file. Calls share no state; two calls must
 * not use one descriptor at the same time.
 */
#ifndef HEXAD_IO_VDB_VDB_H
#define HEXAD_IO_VDB_VDB_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

#include "base/core/error.h"

#define VDB_NAME_SIZE 256 /* a file with a longer name is refused as damaged */
#define VDB_TYPE_SIZE 64
#define VDB_UNIT_SIZE 32
#define VDB_LEAF_SIDE 8
#define VDB_LEAF_VOXELS 512

typedef enum vdb_class { VDB_UNKNOWN, VDB_LEVEL_SET, VDB_FOG, VDB_STAGGERED } vdb_class;

typedef struct vdb_entry {
    char name[VDB_NAME_SIZE]; /* as written, without the suffix that distinguishes equal names */
    char type[VDB_TYPE_SIZE]; /* type of the values: "float", "double", "int32", "vec3s", "ptdataidx32",
                               * ... */
    bool scalar;              /* float or double: vdb_load_grid accepts it */
    bool numeric;             /* numbers, booleans or vectors of three: vdb_visit_grid accepts it */
    vdb_class grid_class;
} vdb_entry;

typedef struct vdb_listing {
    vdb_entry *entries; /* in the order of the file */
    size_t count;
} vdb_listing;

/* Lists the grids of a file. If the file has offsets, no tree is read. Otherwise (it was written to a pipe)
 * the trees are read one after another. Errors: input_damaged (with a separate message for Git LFS pointers),
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
    /* the file has a newer format version than the library, and is read as far as the versions agree */
    bool from_newer;
    bool is_local;            /* by its metadata it is in the space of an object that is not in the file */
    char unit[VDB_UNIT_SIZE]; /* from its metadata, truncated; "": unknown */
    double zero;              /* subtracted from the values in the file before the conversion to floats */
    float background;
    double index_to_world[16]; /* row-major, column vectors: world = M (i, j, k, 1); invertible */
    uint64_t active_voxels;
    size_t leaf_count, tile_count;
    int32_t (*leaf_origin)[3]; /* multiples of 8 */
    float *leaf_values;        /* 512 per leaf */
    uint64_t *leaf_active;     /* 8 words per leaf */
    vdb_tile *tiles;
} vdb_grid;

/* Whether metadata of this name are the unit of a grid; OpenVDB and its transforms have no units. */
bool vdb_is_unit(const char *name);

/* How a grid is loaded. */
typedef struct vdb_loading {
    /* subtracted from the values of a grid of doubles that is not a level set, before the conversion to
     * floats */
    double zero;
    bool flood; /* inactive voxels of a level set get their sign from the surrounding active ones */
} vdb_loading;

/* Loads entry `index` of the listing. Doubles are converted to floats. `memory_limit` bounds the peak of the
 * call, including the library's tree and the arrays. Errors: input_damaged; input_unsupported (the type is
 * not scalar, or the transform is not affine or not invertible); limit_memory. */
vdb_grid *vdb_load_grid(int fd, size_t index, vdb_loading how, size_t memory_limit, error *e);
void vdb_grid_free(vdb_grid *grid);

/* A grid of any numeric type, valid during vdb_visit_grid. */
typedef struct vdb_voxels vdb_voxels;

struct vdb_voxels {
    int components; /* 1, or 3 for a vector */
    bool whole;     /* integers or booleans */
    vdb_class grid_class;
    int32_t low[3], high[3];   /* if `whole`: the box of the active voxels; low > high: none */
    double index_to_world[16]; /* as in vdb_grid */
    void *tree;                /* private */
    /* Reads the value of a voxel, or the background if there is none. Returns whether it is active. */
    bool (*read)(const vdb_voxels *v, const int32_t at[3], double value[3]);
    /* Reads a whole number, which a double may not represent. */
    int64_t (*read_whole)(const vdb_voxels *v, const int32_t at[3]);
};

typedef bool vdb_visitor(void *context, const vdb_voxels *voxels, error *e);

/* Reads entry `index` of the listing and calls a visitor, whose result is returned. The visitor must not
 * throw. The grid is freed at the end of the call. `memory_limit` bounds the library's tree. Errors: those
 * of vdb_load_grid. */
bool vdb_visit_grid(int fd, size_t index, size_t memory_limit, vdb_visitor *visit, void *context, error *e);

/* A grid to write. Voxels are given one by one, followed by tiles. */
typedef struct vdb_draft {
    const char *name;
    /* "float", "double", "int32", "int64", "bool", or "vec3s", "vec3d", "vec3i" of equal components */
    const char *type;
    bool half; /* store floats as 16 bits */
    vdb_class grid_class;
    double background;
    const double *index_to_world; /* as in vdb_grid; NULL: a frustum, which readers refuse */
    size_t voxel_count;
    const int32_t (*voxels)[3];
    const float *values;
    const bool *active; /* NULL: all are active */
    size_t tile_count;
    const vdb_tile *tiles;
} vdb_draft;

typedef enum vdb_layout {
    VDB_SEEKABLE, /* with offsets, like openvdb::io::File */
    VDB_STREAM    /* without offsets, like openvdb::io::Stream */
} vdb_layout;

/* Writes a whole file at the descriptor's offset. The same drafts give the same bytes: the identifier of the
 * format, which the library makes random, is derived from the contents. Errors: input_unsupported (the draft is
 * not valid), internal (writing failed). */
bool vdb_write_grids(int fd, const vdb_draft *drafts, size_t count, vdb_layout layout, bool compressed,
                     error *e);

/* Additional attributes of points. */
typedef struct vdb_point_values {
    const char *name; /* unique, and none of the names below */
    int components;   /* 1: float, or int64 if `whole`; 2 or 3: vec3f, whose third component is 0 for 2 */
    bool whole;
    bool is_double;       /* one or three components: double instead of float, vec3d instead of vec3f */
    const double *values; /* `components` values per point, point after point */
} vdb_point_values;

/* Points to write as a points grid (OpenVDB's PointDataGrid). */
typedef struct vdb_points {
    size_t count;           /* > 0 */
    const double *position; /* 3 per point, world; finite */
    const double *normal;   /* 3 per point */
    const double *spacing;  /* per point */
    double voxel_size;      /* of the grid, world, > 0; at most 2^31 voxels span the points */
    const uint32_t *id;     /* unique; NULL: the indices of the points, from 0 */
    const double *velocity; /* 3 per point; NULL: none */
    const double *orient;   /* unit quaternions, x y z w of each point; NULL: none */
    size_t value_count;
    const vdb_point_values *values;
} vdb_points;

/* Writes a whole file and flushes the stream: one grid "points" whose transform has its origin at the
 * corner of the points' box. Its attributes are P (relative to the centre of its voxel, so exact to 2^-24
 * voxels), N (vec3f), pscale (float, half the spacing), id (int64), if given the velocities v (vec3f) and the
 * orientations orient (quaternions of floats), and the other values. The same points give the same bytes.
 * Errors: limit_memory; internal (writing failed). */
bool vdb_write_points(FILE *file, const vdb_points *points, error *e);

#ifdef __cplusplus
}
#endif

#endif

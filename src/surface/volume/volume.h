// SPDX-License-Identifier: Apache-2.0
/* volume: a grid or a mesh of a file as a field: C2 tricubic splines over sparse coefficient blocks around
 * the isosurface.
 *
 * A volume is read completely by one call, through src/io/vdb. An open volume keeps no file and no library
 * object, only coefficient blocks (8^3 cells and the coefficients around them that their splines need) around
 * the surface, with a margin within which Newton's method and the trial steps of particles are defined. Any
 * thread may sample it. If few places will be sampled, coefficient blocks are made on first access.
 */
#ifndef HEXAD_SURFACE_VOLUME_VOLUME_H
#define HEXAD_SURFACE_VOLUME_VOLUME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/isa.h"
#include "base/core/threads.h"
#include "io/volumes/slices.h"
#include "surface/field/field.h"
#include "surface/levelset/fidelity.h"
#include "geometry/mesh/mesh.h"
#include "geometry/mesh/mesh_edges.h"
#include "surface/levelset/mesh_faces.h"
#include "surface/volume/thin_walls.h"
#include "surface/volume/voxel_size.h"

typedef struct volume volume;

typedef enum volume_reconstruction {
    /* the spline interpolates the samples, except beside the clamped values of a narrow band */
    VOLUME_INTERPOLATING,
    VOLUME_SMOOTHING /* the samples are the spline's coefficients: blurs noisy data */
} volume_reconstruction;

typedef struct volume_request {
    int fd;           /* the file, open for reading, at any offset; not closed */
    const char *path; /* for messages only */
    const char *grid; /* see grid_selection.h; NULL: the only scalar grid */
    bool has_isovalue;
    double isovalue; /* in the grid's own unit */
    double offset;   /* outwards, world units; only for level sets, whose values are distances; otherwise 0 */
    volume_reconstruction reconstruction;
    size_t memory_limit; /* for opening and keeping the volume, bytes */
    /* approximate number of points that will be sampled, 0: unknown; affects memory_bytes only */
    size_t points;
    threads *pool; /* used by opening; or NULL. The volume does not depend on it */
    isa isa;       /* instruction set for sampling */
} volume_request;

typedef struct volume_mesh_request {
    const char *path;              /* for messages */
    voxel_size_request resolution; /* memory_limit includes the reader process */
    int band_vox;                  /* half-width of the band of distances, voxels */
    double weld;                   /* as in levelset_params */
    const mesh_edges *edges;       /* as in levelset_params, for a mesh that was read before */
    double offset;                 /* of the surface from the mesh, outwards, world units */
    bool keep_faces;               /* points will be projected onto the triangles, see volume_faces */
    threads *pool;                 /* as in levelset_params */
    isa isa;                       /* as above */
} volume_mesh_request;

typedef struct volume_dense_request {
    slices *source;   /* owned by the caller; not used after the volume is open */
    const char *path; /* as above */
    double isovalue;  /* larger values are inside */
    double no_data;   /* as in dense_grid_make */
    volume_reconstruction reconstruction;
    size_t memory_limit;
    size_t points;
    threads *pool;
    isa isa;
} volume_dense_request;

#define VOLUME_MAX_WARNINGS 24

typedef struct volume_info {
    char grid[256]; /* the grid's unique name; "" for a mesh */
    bool level_set; /* otherwise a fog volume: larger values are inside */
    double isovalue;
    double index_to_world[16]; /* row-major, column vectors: world = M (i, j, k, 1) */
    double voxel_size;         /* cube root of the volume of a voxel */
    uint64_t active_voxels;
    uint64_t crossing_cells;
    uint64_t coefficient_blocks;
    size_t memory_bytes;   /* bytes of the volume */
    bbox surface_box;      /* of the crossing cells */
    size_t triangles;      /* used triangles of a mesh; 0 for a grid */
    bool is_limited;       /* samples were limited beside a jump (ringing.h) */
    double ringing;        /* fraction of the cells that ring, or are one-sided (ringing.h) */
    fidelity fidelity;     /* of a mesh without an offset */
    resolution resolution; /* of a mesh: voxel size, and how it was chosen */
    int64_t size[3];       /* samples of a dense volume; otherwise 0 */
    /* Of a dense volume, also outside of a region: share of the area that is lost between its samples */
    double lost_share;
    bool two_values;            /* a dense volume has no third value near the surface, as a mask */
    char format[12], space[64]; /* of a dense volume, as in slices.h */
    size_t warning_count;
    char warning[VOLUME_MAX_WARNINGS][256];
} volume_info;

/* Opens a grid. The caller frees the volume with volume_close. Memory is estimated from the grid's leaves
 * before it is allocated. Errors, with file, grid and reason: input_damaged, input_unsupported, grid_missing,
 * grid_ambiguous, isovalue_required, no_surface, limit_memory, cancelled. */
volume *volume_open(const volume_request *request, error *e);

/* Converts a closed triangle mesh to a level set (see levelset.h). `whole` and `notes`: the mesh and the
 * notes of its reader. Defects of the mesh become warnings. Errors, with file and reason: input_unsupported
 * (open meshes), spec_invalid (voxels that do not suit the size of the mesh), no_surface, limit_memory,
 * cancelled. */
volume *volume_of_mesh(const volume_mesh_request *request, const mesh *whole, const mesh_notes *notes,
                       error *e);

/* The triangles onto which points are projected, if keep_faces; otherwise, and with an offset, NULL. Owned by the
 * volume. */
const mesh_faces *volume_faces(const volume *v);
/* The triangles of the mesh; NULL for a grid. Owned by the volume. */
const mesh_faces *volume_mesh_faces(const volume *v);
/* The distance of the surface from the triangles, outwards, world units. */
double volume_mesh_offset(const volume *v);

/* The minimum voxel size with which a band extends around an offset, world units. */
double volume_mesh_least_voxel(double offset);

/* Opens a dense volume. Where the surface meets the end of the data it is open, with a boundary on that face
 * of the data's box (see volume_loose_ends for boxes that are not axis-aligned). Errors: those of the slices,
 * no_surface, limit_memory, cancelled, input_damaged (the transform is not invertible). */
volume *volume_open_dense(const volume_dense_request *request, error *e);

/* The number of crossed cells within `box` at an end of dense data whose faces are not axis-aligned: the
 * solver cannot follow a boundary there. */
size_t volume_loose_ends(const volume *v, bbox box);

/* Transforms the field of dense data to a space along the data's axes, in which their ends are faces of the
 * domain. Lengths and orientation do not change. `to_world`: the inverse, as in placement_new. False: the
 * axes are not orthogonal. */
bool volume_align(volume *v, double to_world[16]);

/* An axis-aligned box around the centre of dense data that contains no cell at their ends, with the
 * proportions of the bounding box. Empty if the data are too small. */
bbox volume_clear_box(const volume *v);

/* Whether the spline at x, world space, depends on samples that were limited. */
bool volume_is_limited(const volume *v, vec3 x);
void volume_close(volume *v);
const field *volume_field(const volume *v);
const volume_info *volume_describe(const volume *v);

#endif

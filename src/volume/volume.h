/* volume: a grid or a mesh of a file as a field: C2 tricubic splines over sparse bricks around the
 * isosurface.
 *
 * A volume is read whole, in one call, through the shim in src/vdb; once it is open no file and no library
 * object is left, only bricks (8^3 cells plus the apron of coefficients that their splines need) wherever
 * the surface passes, with a margin in which Newton's method and a particle's trial steps stay defined.
 * Sampling is safe in any number of threads. Where few places will be looked at, it makes the bricks that it comes by.
 */
#ifndef HEXAD_VOLUME_VOLUME_H
#define HEXAD_VOLUME_VOLUME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/isa.h"
#include "base/threads.h"
#include "dense/slices.h"
#include "field/field.h"
#include "mesh/fidelity.h"
#include "triangles/mesh.h"
#include "triangles/mesh_edges.h"
#include "mesh/mesh_faces.h"
#include "volume/resolution.h"

typedef struct volume volume;

typedef enum volume_reconstruction {
    VOLUME_INTERPOLATING, /* the spline has the samples, but beside the clamp of a narrow band */
    VOLUME_SMOOTHING      /* the samples are the spline's coefficients: blurs, for noisy data */
} volume_reconstruction;

typedef struct volume_request {
    int fd;           /* the file, open for reading, at any offset; stays the caller's */
    const char *path; /* for messages only */
    const char *grid; /* name, "name[1]" among equals, "" an unnamed grid; NULL: the only scalar grid */
    bool has_isovalue;
    double isovalue; /* in the grid's own unit */
    double offset;   /* outwards, of a level set, whose values are distances; of another it must be 0 */
    volume_reconstruction reconstruction;
    size_t memory_limit; /* bytes that opening and holding the volume may take */
    size_t points;       /* about so many will be asked for, 0: not known; shows in memory_bytes alone */
    threads *pool;       /* that opens it, or NULL; does not show in the volume */
    isa isa;             /* what sampling runs on */
} volume_request;

typedef struct volume_mesh_request {
    int fd;                        /* as above */
    const char *path;              /* for messages, and its ending for the format */
    const char *reader;            /* the program that reads meshes; NULL: this one (see mesh_reader.h) */
    resolution_request resolution; /* its memory_limit as above, the process that reads included */
    int band_vox;                  /* half-width of the band of distances */
    double weld;                   /* as in levelset_params */
    const mesh_edges *edges;       /* as in levelset_params, of a mesh that was read already */
    double offset;                 /* of the surface from the mesh, outwards */
    bool keep_faces;               /* the triangles stay, see volume_faces */
    threads *pool;                 /* as in levelset_params */
    isa isa;                       /* as above */
} volume_mesh_request;

typedef struct volume_dense_request {
    slices *source;   /* owned by the caller; no longer needed once the volume is open */
    const char *path; /* as above */
    double isovalue;  /* above it is inside */
    volume_reconstruction reconstruction;
    size_t memory_limit;
    size_t points;
    threads *pool;
    isa isa;
} volume_dense_request;

#define VOLUME_MAX_WARNINGS 24

typedef struct volume_info {
    char grid[256]; /* the grid's unique name; "" for a mesh */
    bool level_set; /* else fog: inside is above the isovalue */
    double isovalue;
    double index_to_world[16]; /* row-major, column vectors: world = M (i, j, k, 1) */
    double voxel_size;         /* cube root of the volume of a voxel */
    uint64_t active_voxels;
    uint64_t crossing_cells;
    uint64_t bricks;
    size_t memory_bytes;        /* what the volume holds */
    bbox surface_box;           /* of the crossing cells */
    size_t triangles;           /* of a mesh, as far as they count; 0 for a grid */
    fidelity fidelity;          /* of a mesh, where it is not moved by an offset */
    resolution resolution;      /* of a mesh: its voxels, and why these */
    int64_t size[3];            /* samples of a dense volume; 0 for another */
    char format[12], space[64]; /* of a dense volume, as in slices.h */
    size_t warning_count;
    char warning[VOLUME_MAX_WARNINGS][256];
} volume_info;

/* Memory is estimated from the grid's leaves before it is taken; over the limit is limit_memory.
 * Errors: input_damaged, input_unsupported, grid_missing, grid_ambiguous, isovalue_required,
 * no_surface, limit_memory; each names the file, the grid and the reason. */
volume *volume_open(const volume_request *request, error *e);

/* The same for a closed triangle mesh, which is converted into a level set (see levelset.h). Oddities of the mesh
 * become warnings. Errors: input_damaged, input_unsupported (open meshes, formats), spec_invalid (voxels that
 * do not suit its size), no_surface, limit_memory; each names the file and the reason. */
volume *volume_open_mesh(const volume_mesh_request *request, error *e);

/* The same for a mesh that was read already, with what was noted then; `fd` and `reader` are not used. */
volume *volume_of_mesh(const volume_mesh_request *request, const mesh *whole, const mesh_notes *notes,
                       error *e);

/* The triangles of a mesh that keeps them, or NULL: at an offset there are none. */
const mesh_faces *volume_faces(const volume *v);

/* The smallest voxels with which a band reaches around an offset. */
double volume_mesh_least_voxel(double offset);

/* The same for a dense volume. Where the surface meets the end of the data it is open, with a boundary on that
 * face of the data's box (see volume_loose_ends for boxes that are not aligned with the world's axes).
 * Errors: those of the slices; no_surface; limit_memory; input_damaged for a transform that cannot be
 * inverted. */
volume *volume_open_dense(const volume_dense_request *request, error *e);

/* How many crossed cells within `box` lie at an end of dense data whose faces are not aligned with the
 * world's axes: the solver cannot follow a boundary there. */
size_t volume_loose_ends(const volume *v, bbox box);

/* Moves the field of dense data into a space along their own axes, in which their ends are faces of the domain. Lengths and
 * orientation stay. `to_world` is the way back, as in placement_new. False where the axes are not at right angles. */
bool volume_align(volume *v, double to_world[16]);

/* A box along the world's axes about the middle of dense data that is clear of the cells at their end, in the
 * proportions of the box around them. Empty where the data are too small for one. */
bbox volume_clear_box(const volume *v);
void volume_close(volume *v);
const field *volume_field(const volume *v);
const volume_info *volume_describe(const volume *v);

#endif

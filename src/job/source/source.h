// SPDX-License-Identifier: Apache-2.0
/* source: opens the surface that a spec names: a formula, a B-spline, a volume, a mesh, or a combination
 * of these. */
#ifndef HEXAD_JOB_SOURCE_SOURCE_H
#define HEXAD_JOB_SOURCE_SOURCE_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "io/volumes/exr_stack.h"
#include "surface/field/analytic.h"
#include "surface/field/bspline.h"
#include "surface/field/combination.h"
#include "surface/field/field.h"
#include "surface/field/placement.h"
#include "surface/field/region.h"
#include "surface/labels/label_surface.h"
#include "surface/triangles/mesh_surface.h"
#include "spec/spec.h"
#include "files/file.h"
#include "files/late_hash.h"
#include "files/root.h"
#include "files/tree.h"
#include "surface/scan/surface.h"
#include "surface/volume/map.h"
#include "surface/volume/volume.h"
#include "job/source/source_arrays.h"

/* An input file, or a directory. */
typedef struct source_input {
    char *path;              /* as written in the spec, or in a file that the spec names */
    store_facts facts;       /* set after source_open */
    store_identity identity; /* at the first opening */
    store_tree *tree;        /* the files of a directory, during source_open; then `facts` describes them */
    bool changed;            /* the input changed during source_open, or cannot be examined */
} source_input;

/* One surface of the spec: a leaf of one kind, or a combination or placement of parts. */
typedef struct source_part source_part;

struct source_part {
    const field *field;
    analytic *analytic; /* a formula */
    bspline *bspline;
    volume *volume;
    mesh_surface *mesh; /* sampled on its triangles */
    mesh_notes notes;   /* on the mesh */
    label_surface *labels;
    combination *combination;
    placement *placement;
    double *coefficients; /* of a B-spline read from a file */
    source_part *parts;
    size_t part_count;
    char *nothing; /* reason why the solid is empty; then the other members are NULL and 0. Otherwise NULL */
};

/* Fraction of the points from which their distance from a map, or from the mesh of an attribute, is a warning. */
#define SOURCE_FAR_SHARE 0.05

typedef struct source {
    const field *field; /* in the sampled space */
    source_part whole;
    source_part inside; /* the region, if it is bounded by a surface; otherwise empty */
    /* transform from the sampled space to the world, for data with oblique boundaries, or a mesh far from the
     * origin, which is sampled relative to its middle; otherwise NULL */
    placement *turned;
    vec3 origin;                 /* of the sampled space, for a mesh far from the origin */
    map *map;                    /* sampling.grid, or NULL */
    mesh_notes map_notes;        /* on a mesh of the map that is in another file than the surface */
    region *region;              /* surface.region, or NULL */
    struct creased *creased;     /* the whole surface as patches, if features are requested; or NULL */
    const store_roots *roots;    /* of input files, or NULL; used during source_open */
    const source_arrays *arrays; /* inputs in memory, or NULL; they are not among `inputs` */
    source_input *inputs;        /* in the order of the first opening */
    size_t input_count;
    bool lacks_file;    /* a file that an input names could not be opened: a later job may find it */
    bool hashes_beside; /* during source_open: a file is hashed while it is read */
    late_hash *hash;    /* unfinished hash of the last input; or NULL */
} source;

/* Memory limits, bytes. */
typedef struct source_memory_limits {
    size_t job;  /* of the surface */
    size_t most; /* the largest limit that a job may have, for messages; 0: unknown */
} source_memory_limits;

/* `arrays`: inputs in memory, or NULL. `kernels`: instruction set for sampling. The spec and the arrays outlive the
 * source. Errors: those of volume_open and store_open_input, prefixed with the path. source_close accepts
 * a zeroed struct. */
bool source_open(const spec *s, const store_roots *roots, const source_arrays *arrays,
                 const source_memory_limits *limits, isa kernels, threads *pool, source *out, error *e);
void source_close(source *s);

/* Frees the second derivatives of a mesh that is sampled on its triangles: after the solve, the curvature of the
 * points is that of mesh_curvature.h. */
void source_end_solving(source *s);

/* Opens another input file for reading; requires the roots. Returns its descriptor, or -1 and an error. */
int source_open_file(source *s, const char *path, error *e);

/* Returns the parameters for opening a stack of images, without a memory limit. `files` opens the images. */
exr_stack_params source_stack(const spec_exr *x, const slices_files *files);

/* Adds the origin of the sampled space to an error that contains positions in it, unless it is that of the
 * world. Returns false. */
bool source_prefix_origin(const source *s, error *e);

/* The surface in world space, for evaluations of F: `field`, unless the sampled space is rotated or moved. */
const field *source_world(const source *s);

/* The bounding box of the surface in world space, from a scan of the field. */
bbox source_box(const source *s, const surface *scan);

/* The number of parts of the first combination of the surface, 1 without a combination; and the index of the
 * part on which a point of the surface lies. */
size_t source_part_count(const source *s);
size_t source_part_at(const source *s, vec3 x);

/* The index of the part of `whole` that is nearest to x; 0 if it has at most one part. x is in the space
 * of `whole`. */
size_t source_nearest_part(const source_part *whole, vec3 x);

/* Whether random starts are drawn from crossing cells instead of the whole domain. */
bool source_starts_in_cells(const source *s);

/* Returns the larger of two fractions of area: of the meshes, parts that are not sampled, since they are
 * thinner than the voxels; of combinations, parts that may be missing, since they are thinner than the
 * cells. */
double source_missing_share(const source *s);

/* The largest fraction of the cells of a volume that its spline makes or displaces beside a jump of the samples. */
double source_ringing(const source *s);

/* The share of the area of a dense volume that is lost between its samples (thin_walls.h). */
double source_lost_share(const source *s);
/* Returns half the side of a voxel: the data of a volume or a segmentation do not determine thinner walls. 0: other
 * surfaces. World units. */
double source_thinnest_wall(const source *s, const spec *of);
/* Returns the number of places on parts of a mesh that its level set omits. *place: the places, in the
 * sampled space, owned by the source. 0 for a mesh that is transformed, cut or one of several. */
size_t source_thin_places(const source *s, const vec3 **place);

/* The mesh on whose triangles the points lie, or NULL; source_closed_mesh: NULL also if the mesh is not
 * closed. */
const mesh *source_mesh(const source *s);
const mesh *source_closed_mesh(const source *s);

/* The triangles on which the points are sampled, in the sampled space: of a mesh, or of the interfaces of labels.
 * NULL: they are sampled on a field without triangles. */
const mesh_surface *source_triangles(const source *s);

/* Bytes of the source; 0 if it is not open. */
size_t source_memory(const source *s);

#endif

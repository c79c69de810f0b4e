/* source: opens the surface that a spec names: a formula, a B-spline, a volume, a mesh, or a combination of these. */
#ifndef HEXAD_SOURCE_SOURCE_H
#define HEXAD_SOURCE_SOURCE_H

#include "base/error.h"
#include "base/threads.h"
#include "dense/exr_stack.h"
#include "field/analytic.h"
#include "field/bspline.h"
#include "field/combination.h"
#include "field/field.h"
#include "field/placement.h"
#include "field/region.h"
#include "labels/label_surface.h"
#include "mesh/mesh_surface.h"
#include "spec/spec.h"
#include "store/file.h"
#include "store/late_hash.h"
#include "store/root.h"
#include "store/tree.h"
#include "surface/surface.h"
#include "volume/map.h"
#include "volume/volume.h"

/* An input file, or a directory. */
typedef struct source_input {
    char *path;              /* as written in the spec, or in a file that the spec names */
    store_facts facts;       /* known once the source is open */
    store_identity identity; /* when it was first opened */
    store_tree *tree;        /* while the source opens: the files of a directory, described by `facts` */
    bool changed;            /* while the source opened, or it cannot be examined */
} source_input;

/* One surface of the spec: a leaf of one kind, or a combination or placement of parts. */
typedef struct source_part source_part;

struct source_part {
    const field *field;
    analytic *analytic; /* one of the six */
    bspline *bspline;
    volume *volume;
    mesh_surface *mesh; /* that is sampled on its triangles */
    mesh_notes notes;   /* about it */
    label_surface *labels;
    combination *combination;
    placement *placement;
    double *coefficients; /* of a B-spline whose file was read */
    source_part *parts;
    size_t part_count;
    char *nothing; /* why nothing is left of its solid, where that is so: then the rest is NULL and 0 */
};

typedef struct source {
    const field *field; /* in the space that is sampled */
    source_part whole;
    source_part inside; /* the region, where it is one of a surface; else empty */
    placement *
        turned; /* that space in the world, where it is another: data that end obliquely, or a mesh far from the origin, which
                         * is solved about its middle; or NULL */
    vec3 origin;              /* of that space, of such a mesh */
    map *map;                 /* of sampling.grid, or NULL */
    region *region;           /* of surface.region, or NULL */
    struct creased *creased;  /* the whole as patches, with features; or NULL */
    const store_roots *roots; /* for files, or NULL; used while the source opens */
    source_input *inputs;     /* in the order in which they were first opened */
    size_t input_count;
    bool hashes_beside; /* while the source opens: a file is hashed while it is read */
    late_hash *hash;    /* of the last input, while it is under way; or NULL */
} source;

/* `memory`: most bytes that the surface may hold. `kernels`: instruction set for sampling. The spec outlives the
 * source. Errors: those of volume_open and store_open_input, prefixed with the path. source_close accepts a zeroed
 * struct. */
bool source_open(const spec *s, const store_roots *roots, size_t memory, isa kernels, threads *pool,
                 source *out, error *e);
void source_close(source *s);

/* Opens one more input, for reading, while the roots are there: -1 and an error if it cannot be. */
int source_open_file(source *s, const char *path, error *e);

/* A stack of images as it is opened, but for the limit of memory; `files` opens them. */
exr_stack_params source_stack(const spec_exr *x, const slices_files *files);

/* Says of an error that names places in the space that is sampled where its origin is, unless that is the world's;
 * returns false. */
bool source_prefix_origin(const source *s, error *e);

/* The surface in world space, for callers that evaluate F: the field itself unless its space is rotated. */
const field *source_world(const source *s);

/* The bounding box of the surface in world space, from a scan of the field. */
bbox source_box(const source *s, const surface *scan);

/* Parts of the surface's first combination, 1 if it is none, and which of them a point of the surface lies on. */
size_t source_part_count(const source *s);
size_t source_part_at(const source *s, vec3 x);

/* The same of the parts of a part, 0 where it has one or none; x is in its space. */
size_t source_nearest_part(const source_part *whole, vec3 x);

/* Whether random starts are drawn from crossing cells instead of the whole domain. */
bool source_starts_in_cells(const source *s);

/* The share of the area of its meshes that is not sampled, since it is thinner than their voxels; or of a combination
 * that may not be, since it is thinner than its cells. */
double source_missing_share(const source *s);
/* How many places there are on parts of a mesh that its level set leaves out, and where, in the sampled space; the
 * source's. A mesh that is placed, cut or one of several has none. */
size_t source_thin_places(const source *s, const vec3 **place);

/* The mesh on whose triangles the points lie, or NULL; and only if these are closed. */
const mesh *source_mesh(const source *s);
const mesh *source_closed_mesh(const source *s);

/* Bytes that the source holds; 0 for one that is not open. */
size_t source_memory(const source *s);

#endif

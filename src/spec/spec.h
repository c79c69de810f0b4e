// SPDX-License-Identifier: Apache-2.0
/* spec: a job's specification, parsed and checked, with all defaults.
 *
 * One table of parameters (spec_table.c) gives parsing, defaults, ranges, messages and help; this header is
 * the interface for the rest of the program. World space and world units, radians, seconds. A spec is
 * immutable after parsing and may be read by any thread.
 */
#ifndef HEXAD_SPEC_SPEC_H
#define HEXAD_SPEC_SPEC_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "base/core/error.h"
#include "base/core/file_format.h"
#include "geometry/space/vec3.h"
#include "base/json/json.h"
#include "spec/spec_words.h"

typedef struct spec_vdb {
    char *path;        /* as given; "" is refused */
    char *grid;        /* NULL: the only scalar grid of the file */
    bool has_isovalue; /* level sets default to 0, fog volumes require it */
    double isovalue;
    spec_reconstruction reconstruction;
} spec_vdb;

typedef struct spec_volume {
    char *path; /* NULL: a stack of images, the surface's `exr` */
    bool has_index;
    int64_t index; /* index of the volume, if the file has several */
    bool has_level;
    int64_t level; /* index of the resolution, if the directory has several */
    double isovalue;
    bool has_no_data;
    double no_data; /* samples with this value have none */
    spec_reconstruction reconstruction;
} spec_volume;

typedef struct spec_exr {
    char *path;          /* with FRAMES_NOTATIONS */
    char *slices;        /* "1-93" or "1-93x2" */
    char **files;        /* paths of the slices, from the first one */
    int *numbers;        /* number of each slice */
    size_t count;        /* number of slices */
    char *part;          /* NULL: the only one, or the only one with the channel */
    char *channel;       /* NULL: the only one */
    bool has_voxel_size; /* given, for files that have a size */
    vec3 voxel_size, origin;
    double isovalue;
    spec_reconstruction reconstruction;
} spec_exr;

typedef struct spec_list {
    size_t count;
    double *number;
} spec_list;

/* The files of a data set (queue.files). */
typedef struct spec_files {
    char **name; /* or one pattern */
    size_t count;
    bool is_pattern; /* only the service finds the names */
} spec_files;

typedef struct spec_labels {
    char *path; /* NULL: they are a stack of images, the surface's `exr` */
    char *grid; /* NULL: the only grid of integers of a VDB file */
    bool has_index;
    int64_t index; /* index of the volume, if the file has several */
    bool has_level;
    int64_t level;           /* index of the resolution, if the directory has several */
    spec_list only;          /* the labels to use; empty: all */
    double smooth, majority; /* voxels */
    bool has_background;
    int64_t background;
    bool closed;
    spec_list *groups; /* labels of a group count as its first label */
    size_t group_count;
    spec_list *interfaces; /* pairs of labels; none: all */
    size_t interface_count;
} spec_labels;

typedef struct spec_mesh {
    char *path;
    double voxel_size;  /* world units; 0: determined by the resolution */
    int resolution;     /* voxels along the longest side of the mesh's box; 0: determined by the voxel size,
                        * or chosen automatically */
    int max_resolution; /* maximum of an automatic resolution */
    int band_vox;
    double weld; /* as a fraction of the longest side of the box */
    spec_holes holes;
    spec_interior interior;
    bool has_features;    /* an angle is given */
    double feature_angle; /* radians; 0: no edge is a feature */
    bool on_mesh;         /* points are finally projected onto the triangles */
} spec_mesh;

/* Members that a shape does not have are zero. Defaults: centre (0.5, 0.5, 0.5), axis (0, 0, 1), rounding 0,
 * top radius of a cone 0, r of the quartic 0.13, size of the gyroid (1, 1, 1). */
typedef struct spec_analytic {
    spec_shape shape;
    vec3 center;
    double radius; /* sphere, cylinder, cone (of its base), capsule, > 0 */
    vec3 axis;     /* torus, cylinder, cone, capsule; half-space: outwards; not zero; any length */
    double major_radius, minor_radius; /* torus, 0 < minor < major */
    vec3 half_size;                    /* box, > 0 */
    double height;     /* cylinder, cone: along the axis, centred; capsule: between the centres of its ends; >
                    * 0 */
    double top_radius; /* cone, >= 0 */
    double rounding;   /* box: 0 <= rounding <= smallest half size; also cylinder */
    vec3 radii;        /* ellipsoid, > 0 */
    double r;          /* quartic of (15), > 0 */
    vec3 size;         /* gyroid: lengths of its box, > 0 */
    double period;     /* gyroid: length of one period, > 0 */
} spec_analytic;

/* A bound on a measure of the report. */
typedef struct spec_requirement {
    bool given;
    double bound;
} spec_requirement;

/* A box, min < max in every axis. */
typedef struct spec_box {
    vec3 min, max;
} spec_box;

typedef struct spec_bspline {
    int dims[3];          /* coefficients along each axis, >= 4 */
    spec_box domain;      /* the unit cube by default */
    double *coefficients; /* dims[0] dims[1] dims[2] numbers, x fastest; NULL: in the file */
    size_t coefficient_count;
    char *path; /* path of the file of coefficients, or NULL */
} spec_bspline;

/* Only the member that belongs to `kind` is set. */
typedef struct spec_surface spec_surface;

struct spec_surface {
    spec_surface_kind kind;
    char *input_pointer; /* JSON Pointer of its path, or NULL */
    spec_vdb vdb;
    spec_analytic analytic;
    spec_bspline bspline;
    spec_mesh mesh;
    spec_volume volume;
    spec_exr exr;
    spec_labels labels;
    spec_surface **parts; /* parts: two or more of a combination, one of an offset or transform */
    size_t part_count;
    double distance; /* of an offset: outwards */
    double *matrix;  /* of a transform: 16 numbers, row-major, for column vectors, invertible, last row 0 0 0
                      * 1 */
    size_t matrix_count;
};

/* The distance over which curvature is averaged: one of the two, the other is 0. Both 0: curvature at a
 * point. */
typedef struct spec_scale {
    double spacings, world;
} spec_scale;

typedef struct spec_alpha { /* (14) */
    double d, gamma, nu, kappa_max;
    bool has_scale;
    spec_scale scale;
} spec_alpha;

typedef struct spec_curvature { /* grading by curvature: one of chord_error and ratio, the other is 0 */
    double chord_error, ratio, exponent;
    bool has_scale;
    spec_scale scale;
} spec_curvature;

typedef struct spec_grid { /* grading by a map */
    char *path;            /* NULL: in the surface's file */
    char *name;
    bool has_component;
    int component; /* of the value of vertices */
    spec_map_kind kind;
} spec_grid;

typedef struct spec_points { /* given points */
    char *path;
    spec_points_mode mode;
    double distance; /* with mode avoid, > 0 */
} spec_points;

typedef struct spec_feature { /* bound of the spacing by the feature size */
    double ratio;
} spec_feature;

typedef struct spec_control { /* global control of section 6.1 */
    int64_t min_count;
    int64_t start_count; /* 0: min_count */
    double max_sigma;
    spec_selection selection; /* how particles to split or delete are selected */
} spec_control;

typedef struct spec_witkin_heckbert { /* symbols of the paper of 1994 */
    double alpha, e_hat, rho, phi, beta, dt, gamma, nu, delta;
    double sigma_max; /* 0: determined by the size of the surface */
} spec_witkin_heckbert;

#define SPEC_FROM_SURFACE "surface"
#define SPEC_FROM_GEOMETRY "geometry"
#define SPEC_GEOMETRY_SOURCE \
    "source" /* name, with SPEC_FROM_GEOMETRY, of the attribute with the position of a point on a mesh */
#define SPEC_GEOMETRY_WEIGHT "weight" /* the same, of the quadrature weight */
/* the same, of the principal directions */
#define SPEC_GEOMETRY_DIRECTION1 "direction1"
#define SPEC_GEOMETRY_DIRECTION2 "direction2"

typedef struct spec_attribute { /* attribute of points, from a file or from the geometry of the surface */
    char *from;                 /* SPEC_FROM_SURFACE: the surface's file; SPEC_FROM_GEOMETRY; else a path */
    char *name;                 /* name in the file; NULL: all values at a position of a dense file */
    char *as;                   /* name in the outputs; NULL: the name in the file */
    spec_attribute_type type;
    spec_interpolation interpolation;
    char *input_pointer; /* JSON Pointer of `from` */
} spec_attribute;

typedef struct spec_orient {
    char *twist; /* attribute that is an angle or a vector; NULL: none */
    bool has_seed;
    uint64_t seed; /* seed of random angles */
    bool has_up;
    vec3 up; /* the direction to which +z turns in place of the normal; any length but 0 */
} spec_orient;

typedef struct spec_instancer {
    char *prototype; /* path of an asset of USD */
    char *scale;     /* attribute; NULL: the achieved spacing */
    double size;     /* factor on the scale */
} spec_instancer;

typedef struct spec_camera {
    vec3 position, target, up; /* up is not a multiple of target - position, which is not zero */
    double fov;                /* along the longer side of the picture, radians; 0: `orthographic` applies */
    double orthographic;       /* world units along the longer side; 0: `fov` applies. Both 0: the fov of the
                                * automatic camera */
} spec_camera;

typedef struct spec {
    char *name; /* NULL: none */

    spec_surface surface;
    bool has_region; /* only the part of the surface inside `region` or `region_inside` is sampled */
    spec_box region;
    spec_surface *region_inside; /* NULL: the region is the box */
    bool features;               /* sharp edges of formulas and combinations get samples */

    spec_attribute attribute; /* the attribute that is being read */
    spec_attribute *attributes;
    size_t attribute_count;

    /* the target: one is given, the others are 0 */
    int64_t count;  /* sampling.count, 4 .. 1e8 */
    double spacing; /* mean distance between neighbours */
    double density; /* points per unit of area */
    bool has_control;
    spec_control control;
    char *attach; /* points.ply of a result whose points are placed on the surface's meshes; NULL: the
                    * surface is sampled */
    bool resolve; /* as many points as the features require */
    spec_pattern pattern;
    bool has_feature;
    spec_feature feature; /* excluded by the rules for spacing, curvature and grid */
    bool has_alpha;
    spec_alpha alpha;
    bool has_curvature;
    spec_curvature curvature;
    bool has_grid;
    spec_grid grid;
    bool has_points;
    spec_points points;
    double curve_spacing; /* spacing of points on curves over the spacing around them; 0: equal */
    double min_spacing, max_spacing,
        gradation; /* limits of a spacing that varies; 0: none. gradation: given, or its default */

    spec_method method; /* default: paper with alpha, else sized */
    spec_energy energy;
    spec_minimiser minimiser;
    double step;                          /* step of the gradient minimiser, in units of sigma^2 */
    spec_witkin_heckbert witkin_heckbert; /* parameters of this method */
    double sigma;                         /* solver.sigma: initial support; 0: chosen from count and area */
    spec_init init;                       /* default: sized with alpha, else surface */
    uint64_t seed;
    int threads; /* 0: the worker's share */
    spec_isa isa;
    int max_sweeps;
    double step_tolerance, energy_tolerance;

    spec_requirement require[SPEC_REQUIRE_COUNT]; /* outcome.require */

    bool has_order;   /* otherwise the points have the order of the solver */
    spec_order order; /* order of the points in all outputs */
    bool has_orient;
    spec_orient orient;
    bool has_instancer;
    spec_instancer instancer;
    spec_ply_format ply_format;
    spec_precision ply_precision;
    char **ply_properties; /* names of properties or applications; NULL: all */
    size_t ply_property_count;
    bool has_preview;                  /* true by default */
    bool preview_left_out;             /* not requested, and this build has no pictures */
    int preview_width, preview_height; /* pixels */
    spec_color preview_color;          /* default: alpha, spacing or shading (relations.c) */
    char *preview_attribute;           /* shown instead of preview_color; NULL: none */
    double *preview_range;             /* two, ascending */
    size_t preview_range_count;        /* 0: the range is determined by the values */
    spec_map_colors preview_map;
    bool has_camera; /* otherwise the camera sees the whole surface */
    spec_camera camera;
    spec_up preview_up;
    spec_channels preview_channels;       /* of preview.exr */
    spec_compression preview_compression; /* of preview.exr */
    int turntable;                        /* frames; 0: none */
    bool has_preview_exr;                 /* not used without has_preview */
    bool has_convergence, has_mesh, has_label_meshes;
    /* further files, in addition to points.ply and mesh.ply */
    bool points_in[FILE_FORMATS], mesh_in[FILE_FORMATS];

    char *directory; /* NULL: no copy */

    int64_t memory_mb; /* limits; 0: the default of the service or the worker */
    double timeout_s, stall_s;
    int max_attempts;
    int64_t image_pixels, image_scans; /* limits of an image of a mesh: width times height; scans of a JPEG */
    int64_t max_chunks;                /* maximum number of chunks of a directory that are read */

    int priority;
    char **labels;
    size_t label_count;
    char **depends_on; /* ids of jobs */
    size_t depends_on_count;
    char **after; /* ids of jobs */
    size_t after_count;
    char **after_frames; /* ids of jobs */
    size_t after_frames_count;
    unsigned accept; /* bit for each spec_outcome with which dependents start */
    char *frames;    /* as given, or FRAMES_ALL; NULL: the job is not a sequence. The numbers follow; none
                      * for FRAMES_ALL */
    int *frame;
    size_t frame_count;
    spec_files files;
    bool has_frame_values; /* values of members differ by frame; this spec has those of the first frame */
    int max_running;       /* maximum number of frames that run at the same time; 0: no limit */
    int chunk;             /* consecutive frames that run one after another */
    bool coherent;         /* each frame starts from the points of the previous one */
    int64_t retention_s;   /* 0: the default of the service */
    char *webhook;         /* NULL: none */
    char **slurm;          /* options of sbatch */
    size_t slurm_count;

    json *normalised; /* the spec as JSON, with all defaults; owned by the spec */
} spec;

#define SPEC_FILE_NAME_MAX 4096       /* characters of a name in /queue/files */
#define SPEC_FRAMES_LENGTH_MAX 100000 /* characters of /queue/frames */

/* The faults of a spec, at most SPEC_MAX_FAULTS, each with the JSON Pointer of its member. */
#define SPEC_MAX_FAULTS 16

typedef struct spec_fault {
    char pointer[256];
    char detail[384];
    error_code code; /* ERROR_SPEC_INVALID; ERROR_NOT_SUPPORTED for a part that is not built */
} spec_fault;

typedef struct spec_faults {
    size_t count;
    spec_fault item[SPEC_MAX_FAULTS];
} spec_faults;

/* Checks a document and builds the spec. Returns NULL on failure: *faults holds the faults, and *e
 * (spec_invalid or not_supported) the first of them and their number. `faults` may be NULL. */
spec *spec_parse(const json *document, spec_faults *faults, error *e);

void spec_free(spec *s);

/* The spec of the frame number `index`, from 0, of a spec with queue.by_frame: it has the values of this
 * frame, and is a sequence of this frame only. Fails as spec_parse does; a fault at a value refers to its
 * place in queue.by_frame. */
spec *spec_of_frame(const spec *s, size_t index, spec_faults *faults, error *e);

/* Checks the specs of all frames, if they differ by queue.by_frame; fails at the first frame that is not
 * valid. */
bool spec_check_frames(const spec *s, spec_faults *faults, error *e);

/* Whether the requested spacing varies over the surface. */
static inline bool spec_is_graded(const spec *s)
{
    return s->has_curvature || s->has_grid || s->has_feature || s->curve_spacing > 0;
}

/* Whether y, not z, points up: by output.preview.up, otherwise by the convention for the kind of file. */
bool spec_y_up(const spec *s);

/* Whether that is certain: the spec states it, or all files of the kind have the same axis. Always certain
 * for sequences, so that frames do not differ. */
bool spec_up_is_certain(const spec *s);

/* Whether other files than points.ply and the report are requested. */
bool spec_has_other_outputs(const spec *s);

/* A file that the spec names. */
typedef struct spec_input {
    const char *pointer; /* JSON Pointer of the member */
    const char *path;    /* owned by the spec */
    bool is_slice;       /* an image of a stack: the number in its path is that of the slice */
} spec_input;

/* Whether `from` is a path. */
bool spec_attribute_has_file(const spec_attribute *a);
/* Whether the attribute is the geometric quantity of this name (SPEC_GEOMETRY_SOURCE, ...). */
bool spec_attribute_is(const spec_attribute *a, const char *quantity);
/* Whether one of the attributes is the quadrature weight. */
bool spec_has_weight(const spec *s);

/* File number `index`, from 0, of the files that a job reads. False: there are fewer. */
bool spec_input_at(const spec *s, size_t index, spec_input *out);

/* Inserts the name of a file into the place {file} of an input path (spec/file_names.h). The normalised
 * document does not change. Call it before another thread reads the spec. */
void spec_set_file(spec *s, const char *name);

/* Inserts the frame number into the paths of the input files. The normalised document does not change. Call
 * it before another thread reads the spec. */
void spec_set_frame(spec *s, int frame);

/* Whether the surface is bounded, by its parts: a halfspace is unbounded, and so is a union with one. */
bool spec_surface_is_bounded(const spec_surface *s);

/* The member of /surface that makes a surface of a kind. */
const char *spec_surface_kind_name(spec_surface_kind kind);

/* The name of an energy, for energy_find. */
const char *spec_energy_name(spec_energy energy);

#define SPEC_HELP_ALL "all"

/* Prints the table of parameters as help: one paragraph per parameter (pointer, type, default, range, unit,
 * rank, meaning), basic parameters first. `member`: the parameters with this JSON Pointer and their members.
 * It may also be the last parts of a pointer ("count", "sampling/count"). SPEC_HELP_ALL: all parameters. NULL:
 * the basic ones. Returns the number of paragraphs. */
size_t spec_print_help(FILE *file, const char *member);

#endif

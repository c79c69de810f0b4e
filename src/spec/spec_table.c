// SPDX-License-Identifier: Apache-2.0
/* The table is one array on purpose, so this file may grow past the length of others. */
#include "spec/spec_table.h"

#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "base/core/frames.h"
#include "base/core/precision.h"
#include "base/core/worker_contract.h"

/* Coordinates and lengths stay where their cubes are far from the limits of a double. */
#define WORLD_MAX 1e12

/* The field's derivatives and their squares stay finite. */
#define COEFFICIENT_MAX 1e30

/* The pointer of a member, given as its group and its key, and the rank of the member. */
#define MEMBER(rank_, group, key) group "/" key, .key_offset = sizeof group, .rank = OPTION_##rank_
/* The type of a member whose value is stored in this field. AT_AS states a type that the field does not
 * determine. */
#define TYPE_OF(field) \
    _Generic(((spec *)NULL)->field,              \
             double : SPEC_TYPE_NUMBER,          \
             int : SPEC_TYPE_INTEGER,            \
             int64_t : SPEC_TYPE_LARGE,          \
             uint64_t : SPEC_TYPE_LARGE,         \
             bool : SPEC_TYPE_BOOL,              \
             unsigned : SPEC_TYPE_WORD,          \
             char * : SPEC_TYPE_STRING,          \
             vec3 : SPEC_TYPE_VECTOR,            \
             int * : SPEC_TYPE_TRIPLE,           \
             double * : SPEC_TYPE_NUMBERS,       \
             spec_list : SPEC_TYPE_INTEGERS,     \
             spec_list * : SPEC_TYPE_LISTS,      \
             spec_surface * : SPEC_TYPE_SURFACE, \
             spec_files : SPEC_TYPE_FILES,       \
             char ** : SPEC_TYPE_LABELS)
#define AT(field) AT_AS(TYPE_OF(field), field)
#define AT_AS(type_, field) .type = type_, .offset = offsetof(spec, field), .has = SPEC_NOWHERE
#define AT_HAS(field, flag) \
    .type = TYPE_OF(field), .offset = offsetof(spec, field), .has = offsetof(spec, flag)
/* A place or vector, and a length, in world units; the path of a file. */
#define POSITION .low = -WORLD_MAX, .high = WORLD_MAX, .unit = "world"
#define LENGTH(more_flags) .flags = SPEC_LOW_OPEN | (more_flags), .low = 0, .high = WORLD_MAX, .unit = "world"
#define PATH .low = 1, .high = 4096
#define UNSTORED .offset = SPEC_NOWHERE, .has = SPEC_NOWHERE
#define HAS_MEMBERS .type = SPEC_TYPE_GROUP, UNSTORED
#define HAS_MEMBERS_IF(flag) .type = SPEC_TYPE_GROUP, .offset = SPEC_NOWHERE, .has = offsetof(spec, flag)
#define GROUP(rank_, group, key, flags_, words_)                                            \
    {                                                                                       \
        .pointer = MEMBER(rank_, group, key), .flags = flags_, HAS_MEMBERS, .prose = words_ \
    }
/* The words of a list, ended by NULL. */
#define WORDS(list)                    \
    .words = (const char *const[])     \
    {                                  \
        list##_LIST(WORDS_TEXT, ) NULL \
    }
#define SHAPE(s) (1u << SPEC_SHAPE_##s)
#define METHOD(m) (1u << SPEC_METHOD_##m)
/* The methods of the paper, of 2005. */
#define MEYER (METHOD(SIZED) | METHOD(PAPER))

const spec_row spec_rows[] = {
    {.pointer = MEMBER(BASIC, "", "version"),
     .type = SPEC_TYPE_INTEGER,
     .flags = SPEC_REQUIRED,
     .low = 1,
     .high = 1,
     UNSTORED,
     .prose = "The version of the spec's format."},
    {.pointer = MEMBER(BASIC, "", "name"),
     .title = "Name of the job",
     .low = 0,
     .high = 200,
     AT(name),
     .prose = "A descriptive name. hexad does not interpret it."},

    GROUP(BASIC, "", "surface", SPEC_REQUIRED, "The surface to sample. Give exactly one of its members."),
    {.pointer = MEMBER(BASIC, "/surface", "vdb"),
     .title = "VDB file",
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     HAS_MEMBERS,
     .prose = "A scalar grid of an OpenVDB file. The surface is where the grid has the isovalue."},
    {.pointer = MEMBER(BASIC, "/surface/vdb", "path"),
     .title = "File",
     .flags = SPEC_REQUIRED,
     PATH,
     AT(surface.vdb.path),
     .prose =
         "The file. It must lie below one of the service's input roots, or have been sent with hexadctl upload."},
    {.pointer = MEMBER(ADVANCED, "/surface/vdb", "grid"),
     .title = "Name of the grid",
     .low = 0,
     .high = 1000,
     AT(surface.vdb.grid),
     .prose = "The name of the grid. If several grids have the same name, write \"name[1]\" for the second. "
              "Required if the file has several scalar grids."},
    {.pointer = MEMBER(BASIC, "/surface/vdb", "isovalue"),
     .title = "Value on the surface",
     .low = -1e30,
     .high = 1e30,
     AT_HAS(surface.vdb.isovalue, surface.vdb.has_isovalue),
     .unit = "the grid's",
     .prose = "The value on the surface. Default for a level set: 0. Required for a fog volume."},
    {.pointer = MEMBER(ADVANCED, "/surface/vdb", "reconstruction"),
     .title = "Values between the samples",
     WORDS(SPEC_RECONSTRUCTION),
     .otherwise = "\"interpolating\"",
     AT(surface.vdb.reconstruction),
     .prose = "interpolating: the spline passes through the samples. smoothing: the samples are the "
              "spline's coefficients; this blurs noise and moves the surface slightly."},

    {.pointer = MEMBER(BASIC, "/surface", "mesh"),
     .title = "Triangle mesh",
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     HAS_MEMBERS,
     .prose = "A triangle mesh. It is sampled on its triangles. A closed mesh is converted to a level set "
              "with exact distances if the spec has voxel_size, resolution or on_mesh false, in offsets and "
              "combinations, and if too much of its area is inside its solids."},
    {.pointer = MEMBER(BASIC, "/surface/mesh", "path"),
     .title = "File",
     .flags = SPEC_REQUIRED,
     PATH,
     AT(surface.mesh.path),
     .prose =
         "The file: PLY, OBJ, STL, OFF, glTF, 3MF, VTK, GIfTI, FBX or COLLADA. It must lie below one "
         "of the service's input roots, or have been sent with hexadctl upload. Other files that it names are read for the "
         "attribute base_color only (materials and images, below the input roots)."},
    {.pointer = MEMBER(ADVANCED, "/surface/mesh", "voxel_size"),
     .title = "Size of a voxel",
     LENGTH(0),
     .choice = SPEC_CHOICE_VOXELS,
     AT(surface.mesh.voxel_size),
     .prose =
         "A closed mesh is sampled through a level set of this voxel size, between 1/8191 and 1/8 of the longest side of the mesh's "
         "bounding box. Excludes resolution."},
    {.pointer = MEMBER(ADVANCED, "/surface/mesh", "resolution"),
     .title = "Voxels along the longest side",
     .choice = SPEC_CHOICE_VOXELS,
     .low = 8,
     .high = 8191,
     AT(surface.mesh.resolution),
     .unit = "voxels",
     .prose = "The number of voxels along the longest side of the bounding box of the mesh: a "
              "closed mesh is sampled through a level set. If both this and voxel_size are absent "
              "and a level set is used, hexad chooses 256, or more if the spacing (with resolve: "
              "min_spacing / feature.ratio) is smaller than such a voxel or more than 0.5 % of the "
              "area is thinner than a voxel. At 256, at least 90 % of a scanned mesh is within "
              "0.05 voxels of the sampled surface; sharp edges deviate more. Twice the number "
              "requires three to four times the memory and time."},
    {.pointer = MEMBER(ADVANCED, "/surface/mesh", "max_resolution"),
     .title = "Most voxels along the longest side",
     .flags = SPEC_DEPENDENT,
     .low = 256,
     .high = 8191,
     .otherwise = "4096",
     AT(surface.mesh.max_resolution),
     .unit = "voxels",
     .prose = "The maximum resolution that hexad chooses. limits.memory_mb limits it as well: the "
              "voxels of thin parts use at most an eighth of it."},
    {.pointer = MEMBER(RESEARCH, "/surface/mesh", "band_vox"),
     .title = "Width of the narrow band",
     .low = 3,
     .high = 32,
     .otherwise = "4",
     AT(surface.mesh.band_vox),
     .unit = "voxels",
     .prose =
         "The half-width of the band of distances around the mesh. Particles use four voxels on "
         "either side of the surface. Three give the same surface; more than four only cost time. An offset "
         "of the mesh makes the band as wide as it needs, up to 32."},
    {.pointer = MEMBER(ADVANCED, "/surface/mesh", "weld"),
     .title = "Tolerance for joining open edges",
     .low = 0,
     .high = 0.01,
     .otherwise = "1e-6",
     AT(surface.mesh.weld),
     .unit = "longest sides",
     .prose = "Tolerance for joining open edges, as a fraction of the longest side of the bounding "
              "box: vertices of open edges within this distance are welded, or snapped to another "
              "open edge, but at most within a tenth of the shortest edge at them. 0: only vertices "
              "with equal coordinates are welded."},
    {.pointer = MEMBER(ADVANCED, "/surface/mesh", "holes"),
     .title = "Open boundaries",
     WORDS(SPEC_HOLES),
     .otherwise = "\"keep\"",
     AT(surface.mesh.holes),
     .prose = "keep: an open mesh is sampled as an open surface, with points along its boundaries. "
              "fill: holes are filled; a mesh that then encloses no volume is refused."},
    {.pointer = MEMBER(ADVANCED, "/surface/mesh", "interior"),
     .title = "Parts inside solids",
     WORDS(SPEC_INTERIOR),
     .otherwise = "\"auto\"",
     AT(surface.mesh.interior),
     .prose = "keep: all triangles are sampled, including those inside the solids of the mesh. "
              "drop: only the outside of the solids is sampled, by a level set; this requires a "
              "closed mesh. auto: drop if more than 1 % of the area of a closed mesh is inside it, "
              "otherwise keep."},
    {.pointer = MEMBER(ADVANCED, "/surface/mesh", "features"),
     .title = "Feature edges",
     .flags = SPEC_OPTIONAL,
     HAS_MEMBERS_IF(surface.mesh.has_features),
     .prose =
         "Samples along sharp edges. If omitted, feature edges are detected automatically: meshes of planes and arcs (CAD "
         "models) use an angle of 0.7; scanned meshes get no feature edges. If given for a scanned mesh, sharp edges are "
         "feature edges only in chains of at least 16 edges and 4 spacings."},
    {.pointer = MEMBER(ADVANCED, "/surface/mesh/features", "angle"),
     .title = "Angle of feature edges",
     .low = 0,
     .high = 3.14,
     .otherwise = "0.7",
     AT(surface.mesh.feature_angle),
     .unit = "radians",
     .prose = "Edges are sharp if the normals of their triangles differ by more than this. 0: no "
              "edge is sharp."},
    {.pointer = MEMBER(ADVANCED, "/surface/mesh", "on_mesh"),
     .title = "Points exactly on the triangles",
     .otherwise = "true",
     AT(surface.mesh.on_mesh),
     .prose = "true: finally each point is projected onto the nearest triangle that faces the same "
              "way. false: a closed mesh is sampled through a level set without this projection. "
              "Ignored with an offset, with features and for open meshes."},
    {.pointer = MEMBER(BASIC, "/surface", "analytic"),
     .title = "Formula",
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     HAS_MEMBERS,
     .prose = "A surface given by a formula."},
    {.pointer = MEMBER(BASIC, "/surface/analytic", "shape"),
     .title = "Formula of the surface",
     .flags = SPEC_REQUIRED,
     WORDS(SPEC_SHAPE),
     AT(surface.analytic.shape),
     .prose = "The formula."},
    {.pointer = MEMBER(ADVANCED, "/surface/analytic", "center"),
     .title = "Centre",
     POSITION,
     .otherwise = "[0.5,0.5,0.5]",
     .shapes = SHAPE(SPHERE) | SHAPE(TORUS) | SHAPE(BOX) | SHAPE(ELLIPSOID) | SHAPE(QUARTIC) | SHAPE(GYROID) |
               SHAPE(CYLINDER) | SHAPE(CONE) | SHAPE(CAPSULE) | SHAPE(HALFSPACE),
     AT(surface.analytic.center),
     .prose =
         "Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its plane."},
    {.pointer = MEMBER(BASIC, "/surface/analytic", "radius"),
     LENGTH(SPEC_REQUIRED),
     .shapes = SHAPE(SPHERE) | SHAPE(CYLINDER) | SHAPE(CONE) | SHAPE(CAPSULE),
     AT(surface.analytic.radius),
     .prose = "sphere, cylinder, capsule: the radius. cone: the radius of the base."},
    {.pointer = MEMBER(ADVANCED, "/surface/analytic", "axis"),
     .title = "Direction of the axis",
     .low = -WORLD_MAX,
     .high = WORLD_MAX,
     .otherwise = "[0,0,1]",
     .shapes = SHAPE(TORUS) | SHAPE(CYLINDER) | SHAPE(CONE) | SHAPE(CAPSULE) | SHAPE(HALFSPACE),
     AT(surface.analytic.axis),
     .prose =
         "torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to its "
         "top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its length "
         "does not matter."},
    {.pointer = MEMBER(ADVANCED, "/surface/analytic", "height"),
     LENGTH(SPEC_REQUIRED),
     .shapes = SHAPE(CYLINDER) | SHAPE(CONE) | SHAPE(CAPSULE),
     AT(surface.analytic.height),
     .prose =
         "cylinder, cone: the length along the axis. capsule: the distance between the centres of its two half "
         "spheres."},
    {.pointer = MEMBER(ADVANCED, "/surface/analytic", "top_radius"),
     .title = "Radius at the top",
     .low = 0,
     .high = WORLD_MAX,
     .otherwise = "0",
     .shapes = SHAPE(CONE),
     AT(surface.analytic.top_radius),
     .unit = "world",
     .prose = "cone: the radius of the other end; above 0 its tip is cut off."},
    {.pointer = MEMBER(ADVANCED, "/surface/analytic", "major_radius"),
     .title = "Radius of the ring",
     LENGTH(SPEC_REQUIRED),
     .shapes = SHAPE(TORUS),
     AT(surface.analytic.major_radius),
     .prose = "torus: the distance from the centre to the middle of the tube."},
    {.pointer = MEMBER(ADVANCED, "/surface/analytic", "minor_radius"),
     .title = "Radius of the tube",
     LENGTH(SPEC_REQUIRED),
     .shapes = SHAPE(TORUS),
     AT(surface.analytic.minor_radius),
     .prose = "torus: the radius of the tube. It must be less than major_radius."},
    {.pointer = MEMBER(ADVANCED, "/surface/analytic", "half_size"),
     .title = "Half of the size",
     LENGTH(SPEC_REQUIRED),
     .shapes = SHAPE(BOX),
     AT(surface.analytic.half_size),
     .prose = "box: half of each side, including the rounding."},
    {.pointer = MEMBER(ADVANCED, "/surface/analytic", "rounding"),
     .title = "Radius of rounded edges",
     .low = 0,
     .high = WORLD_MAX,
     .otherwise = "0",
     .shapes = SHAPE(BOX) | SHAPE(CYLINDER),
     AT(surface.analytic.rounding),
     .unit = "world",
     .prose =
         "box, cylinder: the radius of edges and corners. It must not exceed the smallest half size, of a cylinder "
         "its radius and half of its height."},
    {.pointer = MEMBER(ADVANCED, "/surface/analytic", "radii"),
     .title = "Half of each axis",
     LENGTH(SPEC_REQUIRED),
     .shapes = SHAPE(ELLIPSOID),
     AT(surface.analytic.radii),
     .prose = "ellipsoid: half of each axis."},
    {.pointer = MEMBER(RESEARCH, "/surface/analytic", "r"),
     .title = "Parameter r of the quartic",
     LENGTH(0),
     .otherwise = "0.13",
     .shapes = SHAPE(QUARTIC),
     AT(surface.analytic.r),
     .prose = "quartic: r in equation (15)."},
    {.pointer = MEMBER(ADVANCED, "/surface/analytic", "size"),
     .title = "Sides of the box",
     LENGTH(0),
     .otherwise = "[1,1,1]",
     .shapes = SHAPE(GYROID),
     AT(surface.analytic.size),
     .prose = "gyroid: the sides of the box that cuts it."},
    {.pointer = MEMBER(ADVANCED, "/surface/analytic", "period"),
     .title = "Length of a period",
     LENGTH(SPEC_REQUIRED),
     .shapes = SHAPE(GYROID),
     AT(surface.analytic.period),
     .prose = "gyroid: the length of one period."},

    {.pointer = MEMBER(RESEARCH, "/surface", "bspline"),
     .title = "Spline with given coefficients",
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     HAS_MEMBERS,
     .prose = "The zero set of a uniform cubic B-spline, given by its coefficients. Negative values are "
              "inside. Along an axis with n coefficients the domain has n - 3 knot intervals of equal "
              "length w. Coefficient i, counted from 0, belongs to the basis function centred on min + (i "
              "- 1) w, so the first and the last coefficient lie one interval outside the domain."},
    {.pointer = MEMBER(RESEARCH, "/surface/bspline", "dims"),
     .title = "Numbers of coefficients",
     .flags = SPEC_REQUIRED,
     .low = 4,
     .high = 4096,
     AT(surface.bspline.dims),
     .prose = "The number of coefficients along x, y and z."},
    GROUP(RESEARCH, "/surface/bspline", "domain", 0, "The box in which the spline is defined."),
    {.pointer = MEMBER(RESEARCH, "/surface/bspline/domain", "min"),
     .title = "Lowest corner",
     POSITION,
     .otherwise = "[0,0,0]",
     AT(surface.bspline.domain.min),
     .prose = "The lowest corner."},
    {.pointer = MEMBER(RESEARCH, "/surface/bspline/domain", "max"),
     .title = "Highest corner",
     POSITION,
     .otherwise = "[1,1,1]",
     AT(surface.bspline.domain.max),
     .prose = "The highest corner. It must be above the lowest corner on every axis."},
    {.pointer = MEMBER(RESEARCH, "/surface/bspline", "coefficients"),
     .choice = SPEC_CHOICE_COEFFICIENTS,
     .low = -COEFFICIENT_MAX,
     .high = COEFFICIENT_MAX,
     AT_HAS(surface.bspline.coefficients, surface.bspline.coefficient_count),
     .prose = "The coefficients; x varies fastest, then y. Their number is the product of dims."},
    {.pointer = MEMBER(RESEARCH, "/surface/bspline", "path"),
     .title = "File of coefficients",
     .choice = SPEC_CHOICE_COEFFICIENTS,
     PATH,
     AT(surface.bspline.path),
     .prose = "A file that contains only the coefficients, in the same order, as little-endian floats of "
              "32 or 64 bits. The file size determines which. It must lie below one of the service's input "
              "roots, or have been sent with hexadctl upload."},

    {.pointer = MEMBER(BASIC, "/surface", "volume"),
     .title = "Dense volume",
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     HAS_MEMBERS,
     .prose = "A dense volume. The surface is where the volume has the isovalue; larger values are inside. "
              "World space is that of the file: for NRRD the space that the header names "
              "(left-posterior-superior is not converted), for NIfTI right-anterior-superior."},
    {.pointer = MEMBER(BASIC, "/surface/volume", "path"),
     .title = "File",
     .flags = SPEC_REQUIRED,
     PATH,
     AT(surface.volume.path),
     .prose =
         "The file: NRRD (raw, gzip or ascii data, attached or in separate files), NIfTI-1, "
         "NIfTI-2, MetaImage, or TIFF of several pages; with slices the images of a stack, with ####, %04d or $F4 in place of the "
         "slice number; or the directory of an OME-Zarr image (0.4 or 0.5). It and the files that it names must lie below one of the service's input roots. A file that names no other one may instead have been sent with hexadctl upload."},
    {.pointer = MEMBER(ADVANCED, "/surface/volume", "index"),
     .title = "Number of the volume",
     .low = 0,
     .high = 1e9,
     AT_HAS(surface.volume.index, surface.volume.has_index),
     .prose =
         "Which volume of a file with more than three axes, counted from 0. Required if there are several. For channel c at time t "
         "of a TIFF file with C channels it is c + C t."},
    {.pointer = MEMBER(ADVANCED, "/surface/volume", "level"),
     .title = "Level of resolution",
     .low = 0,
     .high = 1000,
     AT_HAS(surface.volume.level, surface.volume.has_level),
     .prose = "Which resolution of an OME-Zarr directory, counted from 0, the finest. Default: 0."},
    {.pointer = MEMBER(ADVANCED, "/surface/volume", "slices"),
     .title = "Slices",
     .low = 3,
     .high = 64,
     AT(surface.exr.slices),
     .prose =
         "The path names a stack of TIFF images or of OpenEXR images with one channel, and these are its slices: see "
         "/surface/exr/slices."},
    {.pointer = MEMBER(ADVANCED, "/surface/volume", "voxel_size"),
     .title = "Size of a voxel",
     LENGTH(0),
     AT_HAS(surface.exr.voxel_size, surface.exr.has_voxel_size),
     .prose =
         "The distance between samples along each axis of the data, in place of the one in the file. The directions of the axes "
         "and the position of the first sample stay. Default: that of the file; for files without one, 1."},
    {.pointer = MEMBER(BASIC, "/surface/volume", "isovalue"),
     .title = "Value on the surface",
     .flags = SPEC_REQUIRED,
     .low = -1e30,
     .high = 1e30,
     AT(surface.volume.isovalue),
     .unit = "the volume's",
     .prose = "The value on the surface. The surface is open where it meets the end of the data."},
    {.pointer = MEMBER(ADVANCED, "/surface/volume", "no_data"),
     .title = "Value for \"no data\"",
     .flags = SPEC_OPTIONAL,
     .low = -1e300,
     .high = 1e300,
     AT_HAS(surface.volume.no_data, surface.volume.has_no_data),
     .unit = "the volume's",
     .prose =
         "Samples with this value have no data, as -9999 or padding: they are outside, and are read as the lowest other "
         "value. Files that state such a value do not set it."},
    {.pointer = MEMBER(ADVANCED, "/surface/volume", "reconstruction"),
     .title = "Values between the samples",
     WORDS(SPEC_RECONSTRUCTION),
     .otherwise = "\"interpolating\"",
     AT(surface.volume.reconstruction),
     .prose = "See /surface/vdb/reconstruction."},

    {.pointer = MEMBER(BASIC, "/surface", "labels"),
     .title = "Segmentation",
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     HAS_MEMBERS,
     .prose =
         "A segmentation: a volume of whole numbers, its labels. The surface is all interfaces between "
         "two of them, each once. Points along the lines where three meet, and along the end of the "
         "data, come first. Points have the properties label_a and label_b: label_a is the lower of the two "
         "labels, but a background is always label_b. Normals point from label_a to label_b. It must be the whole surface: it excludes combinations, "
         "offsets, transforms and region."},
    {.pointer = MEMBER(BASIC, "/surface/labels", "path"),
     .title = "File",
     .flags = SPEC_REQUIRED,
     PATH,
     AT(surface.labels.path),
     .prose =
         "The file: NRRD, NIfTI, MetaImage, TIFF of several pages, OpenVDB, or the directory of an OME-Zarr image; with slices the images, as in /surface/exr/path. It and the files that "
         "it names must lie below one of the service's input roots. A file that names no other one may instead have been sent with hexadctl upload."},
    {.pointer = MEMBER(ADVANCED, "/surface/labels", "index"),
     .title = "Number of the volume",
     .low = 0,
     .high = 1e9,
     AT_HAS(surface.labels.index, surface.labels.has_index),
     .prose = "See /surface/volume/index."},
    {.pointer = MEMBER(ADVANCED, "/surface/labels", "level"),
     .title = "Level of resolution",
     .low = 0,
     .high = 1000,
     AT_HAS(surface.labels.level, surface.labels.has_level),
     .prose = "See /surface/volume/level."},
    {.pointer = MEMBER(ADVANCED, "/surface/labels", "slices"),
     .title = "Numbers of the slices",
     .low = 3,
     .high = 64,
     AT(surface.exr.slices),
     .prose =
         "The labels are a stack of OpenEXR or TIFF images, and these are its slices: see "
         "/surface/exr. The same holds for part, channel, voxel_size and origin; TIFF has no part and no channel."},
    {.pointer = MEMBER(ADVANCED, "/surface/labels", "part"),
     .title = "Name of the part",
     .low = 0,
     .high = 1000,
     AT(surface.exr.part),
     .prose = "The name of the part. Requires slices."},
    {.pointer = MEMBER(ADVANCED, "/surface/labels", "channel"),
     .title = "Name of the channel",
     .low = 1,
     .high = 1000,
     AT(surface.exr.channel),
     .prose = "The name of the channel. Requires slices."},
    {.pointer = MEMBER(ADVANCED, "/surface/labels", "voxel_size"),
     .title = "Size of a voxel",
     LENGTH(0),
     .otherwise = "[1,1,1]",
     AT(surface.exr.voxel_size),
     .prose =
         "The distance between columns, rows and slices. For files with a size of their own it replaces that, unless it is "
         "[1, 1, 1]."},
    {.pointer = MEMBER(ADVANCED, "/surface/labels", "origin"),
     .title = "Position of the first pixel",
     POSITION,
     .otherwise = "[0,0,0]",
     AT(surface.exr.origin),
     .prose = "The position of pixel (0, 0) of the first slice. Requires slices."},
    {.pointer = MEMBER(ADVANCED, "/surface/labels", "grid"),
     .title = "Name of the grid",
     .low = 0,
     .high = 1000,
     AT(surface.labels.grid),
     .prose = "The name of the grid in an OpenVDB file. Optional if there is only one of whole numbers."},
    {.pointer = MEMBER(ADVANCED, "/surface/labels", "labels"),
     .title = "Labels to sample",
     .low = -PRECISION_WHOLE_MOST,
     .high = PRECISION_WHOLE_MOST,
     AT(surface.labels.only),
     .prose = "The labels to sample; all others are background. Default: all."},
    {.pointer = MEMBER(ADVANCED, "/surface/labels", "smooth"),
     .title = "Smoothing",
     .low = 0,
     .high = 24,
     .otherwise = "8",
     AT(surface.labels.smooth),
     .unit = "voxels",
     .prose = "The cut-off wavelength of the smoothing: shorter steps are smoothed, and no vertex "
              "moves by more than half a voxel along an axis. 0: no smoothing."},
    {.pointer = MEMBER(ADVANCED, "/surface/labels", "majority"),
     .title = "Majority filter",
     .low = 0,
     .high = SPEC_MAJORITY_MAX,
     .otherwise = "0",
     AT(surface.labels.majority),
     .unit = "voxels",
     .prose = "Majority filter before the surface is extracted: each voxel gets the label with the "
              "most voxels around it, weighted by a Gaussian with this standard deviation, in "
              "units of the smallest side of a voxel. It removes steps between slices that were "
              "segmented by hand, and stray voxels. 1.5 times the spacing of the points removes "
              "detail that they cannot resolve; wide filters take minutes. Weights preserve the "
              "volume of each label; parts that are thinner than the rest of their label, and "
              "specks with a radius below this, shrink or vanish. 0: no filter."},
    {.pointer = MEMBER(ADVANCED, "/surface/labels", "background"),
     .title = "Background label",
     .low = -PRECISION_WHOLE_MOST,
     .high = PRECISION_WHOLE_MOST,
     AT_HAS(surface.labels.background, surface.labels.has_background),
     .prose =
         "The background label. It is listed second in each interface, so normals point into it. "
         "Default: none; 0 is then a label like any other. `labels` and closed need a background: then the "
         "default is 0 if `labels` is given without 0, and otherwise one less than the lowest label, at most -1."},
    {.pointer = MEMBER(ADVANCED, "/surface/labels", "closed"),
     .title = "Close at the border",
     .otherwise = "false",
     AT(surface.labels.closed),
     .prose =
         "true: beyond the end of the data is background, and the end an interface with it. false: the interfaces "
         "end there."},
    {.pointer = MEMBER(ADVANCED, "/surface/labels", "groups"),
     .title = "Groups of labels",
     .low = -PRECISION_WHOLE_MOST,
     .high = PRECISION_WHOLE_MOST,
     AT_HAS(surface.labels.groups, surface.labels.group_count),
     .prose = "Labels to unite, each list under its first label: [[3, 4], [7, 8, 9]]."},
    {.pointer = MEMBER(ADVANCED, "/surface/labels", "interfaces"),
     .title = "Pairs of labels",
     .low = -PRECISION_WHOLE_MOST,
     .high = PRECISION_WHOLE_MOST,
     AT_HAS(surface.labels.interfaces, surface.labels.interface_count),
     .prose = "The pairs of labels whose interfaces are sampled: [[1, 2], [2, 3]]. Default: all."},

    {.pointer = MEMBER(ADVANCED, "/surface", "exr"),
     .title = "Stack of OpenEXR images",
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     HAS_MEMBERS,
     .prose = "A stack of OpenEXR images as a dense volume. The surface is where the volume has the "
              "isovalue; larger values are inside. Pixel (x, y) of slice k, counted from 0, lies at origin "
              "+ voxel_size (x, y, k). Rows count downwards in the image. Pixels are numbered by the data "
              "window, not by the display window. The volume covers the data windows of all slices; a "
              "pixel outside the data window of its slice is 0. In tiled files with levels, the "
              "full-resolution level is read. Deep images are refused."},
    {.pointer = MEMBER(ADVANCED, "/surface/exr", "path"),
     .title = "Files",
     .flags = SPEC_REQUIRED,
     PATH,
     AT(surface.exr.path),
     .prose =
         "The files, with #### (at least as many digits), %04d or $F4 in place of the slice number. They "
         "must lie below one of the service's input roots."},
    {.pointer = MEMBER(ADVANCED, "/surface/exr", "slices"),
     .title = "Numbers of the slices",
     .flags = SPEC_REQUIRED,
     .low = 3,
     .high = 64,
     AT(surface.exr.slices),
     .prose = "The slices: \"1-93\", or every second one: \"1-93x2\". At least 2, at most 65536."},
    {.pointer = MEMBER(ADVANCED, "/surface/exr", "part"),
     .title = "Name of the part",
     .low = 0,
     .high = 1000,
     AT(surface.exr.part),
     .prose = "The name of the part. Optional if only one part has the channel."},
    {.pointer = MEMBER(ADVANCED, "/surface/exr", "channel"),
     .title = "Name of the channel",
     .low = 1,
     .high = 1000,
     AT(surface.exr.channel),
     .prose = "The name of the channel including its layer, such as \"density\" or \"fog.Y\". Optional if "
              "there is only one."},
    {.pointer = MEMBER(ADVANCED, "/surface/exr", "voxel_size"),
     .title = "Size of a voxel",
     LENGTH(0),
     .otherwise = "[1,1,1]",
     AT(surface.exr.voxel_size),
     .prose = "The distance between columns, rows and slices."},
    {.pointer = MEMBER(ADVANCED, "/surface/exr", "origin"),
     .title = "Position of the first pixel",
     POSITION,
     .otherwise = "[0,0,0]",
     AT(surface.exr.origin),
     .prose = "The position of pixel (0, 0) of the first slice."},
    {.pointer = MEMBER(ADVANCED, "/surface/exr", "isovalue"),
     .title = "Value on the surface",
     .flags = SPEC_REQUIRED,
     .low = -1e30,
     .high = 1e30,
     AT(surface.exr.isovalue),
     .unit = "the channel's",
     .prose = "The value on the surface. The surface is open where it meets the end of the data."},
    {.pointer = MEMBER(ADVANCED, "/surface/exr", "reconstruction"),
     .title = "Values between the samples",
     WORDS(SPEC_RECONSTRUCTION),
     .otherwise = "\"interpolating\"",
     AT(surface.exr.reconstruction),
     .prose = "See /surface/vdb/reconstruction."},
    {.pointer = MEMBER(ADVANCED, "/surface", "union"),
     .title = "Union of solids",
     .type = SPEC_TYPE_SURFACES,
     .choice = SPEC_CHOICE_SURFACE,
     .low = 2,
     .high = 64,
     UNSTORED,
     .prose = "The union of the solids. Each member is a surface and may itself be a combination. The result "
              "has a sharp edge where two surfaces meet. An empty member, such as the intersection of solids "
              "that do not overlap, is skipped with a warning."},
    {.pointer = MEMBER(ADVANCED, "/surface", "intersection"),
     .title = "Intersection of solids",
     .type = SPEC_TYPE_SURFACES,
     .choice = SPEC_CHOICE_SURFACE,
     .low = 2,
     .high = 64,
     UNSTORED,
     .prose = "The intersection of the solids."},
    {.pointer = MEMBER(ADVANCED, "/surface", "difference"),
     .title = "Difference of solids",
     .type = SPEC_TYPE_SURFACES,
     .choice = SPEC_CHOICE_SURFACE,
     .low = 2,
     .high = 64,
     UNSTORED,
     .prose = "The first solid without the others. An empty solid among the others is skipped with "
              "a warning."},
    {.pointer = MEMBER(ADVANCED, "/surface", "offset"),
     .title = "Offset of a surface",
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     HAS_MEMBERS,
     .prose = "A surface at a constant distance from another one. The other surface must have "
              "distances: level sets, meshes, and formulas except ellipsoid, quartic and gyroid; "
              "also combinations of these, and transforms that preserve angles. Other surfaces, "
              "such as fog volumes, are refused. Edges "
              "of a combination stay sharp. The band of a level set must be wide enough for the offset."},
    {.pointer = MEMBER(ADVANCED, "/surface/offset", "surface"),
     .title = "Surface to offset",
     .type = SPEC_TYPE_SURFACE,
     .flags = SPEC_REQUIRED,
     UNSTORED,
     .prose = "The surface to offset."},
    {.pointer = MEMBER(ADVANCED, "/surface/offset", "distance"),
     .title = "Distance outwards",
     .flags = SPEC_REQUIRED,
     POSITION,
     AT(surface.distance),
     .prose = "The distance. Positive is outwards, negative is inwards."},
    {.pointer = MEMBER(ADVANCED, "/surface", "transform"),
     .title = "Transformed surface",
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     HAS_MEMBERS,
     .prose =
         "A surface transformed by a matrix: moved, rotated, mirrored, scaled or sheared. The boundaries "
         "of an open surface are parallel to the world axes, so its matrix may only exchange, flip and "
         "scale axes, and translate. With features, and for an open mesh, any matrix is allowed."},
    {.pointer = MEMBER(ADVANCED, "/surface/transform", "surface"),
     .title = "Surface to transform",
     .type = SPEC_TYPE_SURFACE,
     .flags = SPEC_REQUIRED,
     UNSTORED,
     .prose = "The surface to transform."},
    {.pointer = MEMBER(ADVANCED, "/surface/transform", "matrix"),
     .title = "Matrix, row by row",
     .flags = SPEC_REQUIRED,
     .low = -WORLD_MAX,
     .high = WORLD_MAX,
     AT_HAS(surface.matrix, surface.matrix_count),
     .prose = "An invertible matrix as 16 numbers, row by row, for column vectors. The last row is 0, 0, "
              "0, 1."},

    {.pointer = MEMBER(ADVANCED, "", "region"),
     .title = "Part of the surface to sample",
     .flags = SPEC_OPTIONAL,
     HAS_MEMBERS_IF(has_region),
     .prose =
         "Only the part of the surface inside this box, or inside another surface, is sampled. Where the box cuts the "
         "surface, the surface is open and points lie along the cut. The scale of curvature still comes from "
         "the bounding box of the whole surface."},
    {.pointer = MEMBER(ADVANCED, "/region", "inside"),
     .title = "Inside of a surface",
     .choice = SPEC_CHOICE_REGION,
     AT(region_inside),
     .prose = "The surface whose inside is the region. Points are placed exactly on the cut and, "
              "as with features, on the sharp edges of the sampled surface."},
    {.pointer = MEMBER(ADVANCED, "/region", "min"),
     .title = "Lowest corner",
     .choice = SPEC_CHOICE_REGION,
     POSITION,
     AT(region.min),
     .prose = "The lowest corner."},
    {.pointer = MEMBER(ADVANCED, "/region", "max"),
     .title = "Highest corner",
     POSITION,
     AT(region.max),
     .prose = "The highest corner. It must be above the lowest corner on every axis."},
    {.pointer = MEMBER(ADVANCED, "", "features"),
     .title = "Points on sharp edges of formulas and cuts",
     .otherwise = "false",
     AT(features),
     .prose = "Whether points are placed exactly on the sharp edges of formulas, on the curves "
              "where parts of a combination meet, and on the cuts of a region, at the requested "
              "spacing. The surface is then divided into smooth patches, and mesh.ply has edges "
              "along their boundaries. For meshes, use /surface/mesh/features."},

    GROUP(
        BASIC, "", "sampling", SPEC_REQUIRED,
        "The number of points. Give exactly one target (count, spacing, density, control, "
        "resolve or attach) and at most one rule for the spacing (alpha, curvature or grid). feature refines thin "
        "parts, and curve_spacing the surface near curves; both may be combined with curvature or grid."),
    {.pointer = MEMBER(BASIC, "/sampling", "count"),
     .title = "Number of points",
     .choice = SPEC_CHOICE_TARGET,
     .low = 4,
     .high = 1e8,
     AT(count),
     .unit = "points",
     .prose = "The exact number of points."},
    {.pointer = MEMBER(BASIC, "/sampling", "spacing"),
     .title = "Distance between points",
     LENGTH(0),
     .choice = SPEC_CHOICE_TARGET,
     AT(spacing),
     .prose = "The mean distance between neighbours. The count is 2 A / (sqrt(3) spacing^2), where A is "
              "the area."},
    {.pointer = MEMBER(ADVANCED, "/sampling", "density"),
     .title = "Points per unit of area",
     .flags = SPEC_LOW_OPEN,
     .choice = SPEC_CHOICE_TARGET,
     .low = 0,
     .high = 1e300,
     AT(density),
     .unit = "1/world^2",
     .prose = "The number of points per unit of area."},
    {.pointer = MEMBER(BASIC, "/sampling", "pattern"),
     .title = "Pattern",
     WORDS(SPEC_PATTERN),
     .otherwise = "\"hexagonal\"",
     AT(pattern),
     .prose =
         "hexagonal: the points are as regular as the surface permits. blue_noise: the points have no regular order, for "
         "scattering, stippling and ray-traced sets. Their least distance is at least 0.74 spacings, and no place of the "
         "surface is farther from its nearest point than 1.05 times that distance. The least distance does not apply to points "
         "on opposite walls, whose normals differ by more than 113 degrees. Curves have no points of their own. "
         "blue_noise requires a surface without labels and the defaults of solver.method, init, energy, minimiser and sigma; "
         "excludes control, resolve, attach, alpha, points, curve_spacing, features and queue.coherent."},
    {.pointer = MEMBER(RESEARCH, "/sampling", "control"),
     .title = "Number of points found as in the paper",
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_TARGET,
     HAS_MEMBERS_IF(has_control),
     .prose =
         "For reproducing the paper; otherwise use count. Finds the smallest count that is at least "
         "min_count and whose support at the ideal energy is at most max_sigma (section 6.1 of the "
         "paper). Method paper starts with min_count points and inserts and deletes some between rounds. "
         "Method sized computes the count from sigma = sqrt(3) spacing. Works with the methods sized and "
         "paper."},
    {.pointer = MEMBER(RESEARCH, "/sampling/control", "min_count"),
     .title = "Fewest points",
     .flags = SPEC_REQUIRED,
     .low = 4,
     .high = 1e8,
     AT(control.min_count),
     .unit = "points",
     .prose = "The least number of points."},
    {.pointer = MEMBER(RESEARCH, "/sampling/control", "max_sigma"),
     .title = "Largest support of the potential",
     LENGTH(SPEC_REQUIRED),
     AT(control.max_sigma),
     .prose = "The largest support of the potential. Points are inserted until the support is small enough."},
    {.pointer = MEMBER(RESEARCH, "/sampling/control", "start_count"),
     .title = "Points at the start",
     .low = 0,
     .high = 1e8,
     .otherwise = "0",
     AT(control.start_count),
     .unit = "points",
     .prose = "The number of points that paper begins with, at least min_count; 0: min_count. A number "
              "near the result saves rounds. If it is too large, points are deleted."},
    {.pointer = MEMBER(RESEARCH, "/sampling/control", "selection"),
     .title = "Choice of points to split or delete",
     WORDS(SPEC_SELECTION),
     .otherwise = "\"biased\"",
     AT(control.selection),
     .prose = "Which points are split or deleted. biased: points with little energy are more likely to be "
              "split, points with much energy to be deleted. random: all points are equally likely. Only "
              "the method paper inserts and deletes points."},
    {.pointer = MEMBER(ADVANCED, "/sampling", "resolve"),
     .title = "As many points as thin parts need",
     .choice = SPEC_CHOICE_TARGET,
     AT(resolve),
     .prose = "true, the only permitted value: hexad chooses the count that resolves the surface, from the "
              "spacing that feature and grid require, at most max_spacing. The report and the estimate state "
              "the count. Requires feature (\"feature\": {} is enough); excludes curvature. A closed mesh is "
              "then sampled on its triangles, including those inside its solids, as with sharp edges "
              "(/surface/mesh/features), and mesh.ply has the topology of the mesh."},
    {.pointer = MEMBER(ADVANCED, "/sampling", "attach"),
     .title = "Points of an earlier result to place again",
     .choice = SPEC_CHOICE_TARGET,
     PATH,
     AT(attach),
     .prose =
         "The path of the points.ply of an earlier result, whose points have places on meshes (attributes: from "
         "geometry, name source). The surface is then not sampled: these points are placed on its meshes, which "
         "must have the same vertices and faces in the same order, such as another frame of an animation. "
         "Requires a surface that is a mesh, or has one as a part; excludes all other members of sampling, "
         "output.mesh, output.convergence, output.order, queue.coherent and outcome.require."},
    {.pointer = MEMBER(ADVANCED, "/sampling", "feature"),
     .title = "Denser at thin parts",
     .flags = SPEC_OPTIONAL,
     HAS_MEMBERS_IF(has_feature),
     .prose = "Finer spacing where the surface is thin or opposite walls are close: at most ratio times the "
              "feature size, which is half the thickness, half the gap, or the radius of a thin tube. Convex "
              "edges are not thin. The job fails if the count is too small, and names the count that it "
              "needs. Requires the method sized; excludes alpha."},
    {.pointer = MEMBER(ADVANCED, "/sampling/feature", "ratio"),
     .title = "Largest spacing over the feature size",
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 1.5,
     .otherwise = "0.75",
     AT(feature.ratio),
     .prose = "The largest spacing, over the feature size. With 0.75, opposite walls are 2.7 spacings apart; "
              "above 1, they may remain unresolved."},
    {.pointer = MEMBER(RESEARCH, "/sampling", "alpha"),
     .title = "Amplitude of the paper",
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_GRADING,
     HAS_MEMBERS_IF(has_alpha),
     .prose = "Spacing by curvature with equations (13) and (14): alpha = gamma + 1 / (kappa^d + nu). kappa "
              "is multiplied by a length L, so that it does not depend on scale: the longest side of the box "
              "around the surface of a volume or mesh, of the domain of a formula or B-spline. The report "
              "states L. Excludes feature and curve_spacing. Requires the method paper, which is then the "
              "default, or witkin-heckbert."},
    {.pointer = MEMBER(RESEARCH, "/sampling/alpha", "d"),
     .title = "Exponent",
     .low = 0,
     .high = 16,
     .otherwise = "2",
     AT(alpha.d),
     .prose = "The exponent. A larger one follows the curvature more strongly, one below 1 more weakly."},
    {.pointer = MEMBER(RESEARCH, "/sampling/alpha", "gamma"),
     .title = "Lower bound of alpha",
     .low = 0,
     .high = 1000,
     .otherwise = "0.1",
     AT(alpha.gamma),
     .prose = "The lower bound of alpha, which alpha approaches where the curvature is strong."},
    {.pointer = MEMBER(RESEARCH, "/sampling/alpha", "nu"),
     .title = "Strength on flat parts",
     .low = 0.001,
     .high = 1000,
     .otherwise = "0.75",
     AT(alpha.nu),
     .prose = "Where the surface is flat, alpha is gamma + 1/nu."},
    {.pointer = MEMBER(RESEARCH, "/sampling/alpha", "kappa_max"),
     .title = "Largest scale-free curvature",
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 1e6,
     .otherwise = "20",
     AT(alpha.kappa_max),
     .prose = "Larger values of the scale-free curvature are replaced by this one."},
    {.pointer = MEMBER(RESEARCH, "/sampling/alpha", "scale"),
     .title = "Scale of the curvature",
     .flags = SPEC_OPTIONAL,
     HAS_MEMBERS_IF(alpha.has_scale),
     .prose = "The distance over which the curvature of the surface is averaged. It measures the "
              "shape instead of the facets of a mesh or the noise of a scan. Give one of its "
              "members. Default: two spacings."},
    {.pointer = MEMBER(RESEARCH, "/sampling/alpha/scale", "spacings"),
     .title = "Scale in spacings",
     .choice = SPEC_CHOICE_SCALE,
     .low = 0,
     .high = 1000,
     AT(alpha.scale.spacings),
     .unit = "spacings",
     .prose =
         "The distance in spacings of the even packing. 0: the curvature of the field at the point itself."},
    {.pointer = MEMBER(RESEARCH, "/sampling/alpha/scale", "world"),
     .title = "Scale in world units",
     LENGTH(0),
     .choice = SPEC_CHOICE_SCALE,
     AT(alpha.scale.world),
     .prose = "The distance in world units."},
    {.pointer = MEMBER(BASIC, "/sampling", "curvature"),
     .title = "Denser where curved",
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_GRADING,
     HAS_MEMBERS_IF(has_curvature),
     .prose = "Spacing by curvature: finer where the surface bends. The requested spacing is scaled so that "
              "it needs as many points as the target. Requires the method sized."},
    {.pointer = MEMBER(ADVANCED, "/sampling/curvature", "chord_error"),
     .title = "Largest distance of chords",
     LENGTH(0),
     .choice = SPEC_CHOICE_CURVATURE,
     AT(curvature.chord_error),
     .prose = "Spacing sqrt(8 chord_error / max(|kappa1|, |kappa2|)): the chord between two neighbours "
              "deviates from the surface by chord_error. The report states the nominal error of the "
              "count, and with output.mesh the largest one of the mesh."},
    {.pointer = MEMBER(BASIC, "/sampling/curvature", "ratio"),
     .title = "Largest over smallest spacing",
     .choice = SPEC_CHOICE_CURVATURE,
     .low = 1,
     .high = 1000,
     AT(curvature.ratio),
     .prose = "The maximum ratio of the largest to the smallest spacing. The spacing is "
              "proportional to kappa^-exponent. A surface with almost uniform curvature reaches a "
              "smaller ratio. The smallest spacing is used on the most curved 1 % of the area, or "
              "on as little as 1/8 % if gradation would otherwise reduce the ratio below 0.8 of "
              "this value."},
    {.pointer = MEMBER(ADVANCED, "/sampling/curvature", "exponent"),
     .title = "Exponent of the curvature",
     .flags = SPEC_LOW_OPEN | SPEC_DEPENDENT,
     .low = 0,
     .high = 100,
     .otherwise = "1",
     AT(curvature.exponent),
     .prose = "How strongly the spacing follows the curvature. Belongs to ratio."},
    {.pointer = MEMBER(ADVANCED, "/sampling/curvature", "scale"),
     .title = "Scale of the curvature",
     .flags = SPEC_OPTIONAL,
     HAS_MEMBERS_IF(curvature.has_scale),
     .prose = "The distance over which the curvature of the surface is averaged. It measures the "
              "shape instead of the facets of a mesh or the noise of a scan. Give one of its "
              "members. Default: 4 local spacings."},
    {.pointer = MEMBER(ADVANCED, "/sampling/curvature/scale", "spacings"),
     .title = "Scale in local spacings",
     .choice = SPEC_CHOICE_SCALE,
     .low = 0,
     .high = 1000,
     AT(curvature.scale.spacings),
     .unit = "spacings",
     .prose = "The distance in local spacings. 0: the curvature at the point itself."},
    {.pointer = MEMBER(ADVANCED, "/sampling/curvature/scale", "world"),
     .title = "Scale in world units",
     LENGTH(0),
     .choice = SPEC_CHOICE_SCALE,
     AT(curvature.scale.world),
     .prose = "The distance in world units."},
    {.pointer = MEMBER(ADVANCED, "/sampling", "grid"),
     .title = "Painted map of spacings",
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_GRADING,
     HAS_MEMBERS_IF(has_grid),
     .prose =
         "Spacing from a painted map: a scalar grid of an OpenVDB file, or a value of the vertices of a mesh file. The "
         "requested spacing is scaled so that it needs as many points as the target. Requires the method sized."},
    {.pointer = MEMBER(ADVANCED, "/sampling/grid", "path"),
     .title = "File",
     PATH,
     AT(grid.path),
     .prose =
         "The file: OpenVDB, or a mesh. Default: that of the surface, which then must be a grid of an OpenVDB file or a "
         "mesh. Any surface may have a map in a file of its own, in world space; a mesh gives each place the value of "
         "the nearest point of its triangles."},
    {.pointer = MEMBER(ADVANCED, "/sampling/grid", "name"),
     .title = "Name of the grid or value",
     .flags = SPEC_REQUIRED,
     .low = 1,
     .high = 1024,
     AT(grid.name),
     .prose =
         "The name of the grid. If several grids have the same name, write \"name[1]\" for the second. Of a mesh: the "
         "name of a value of its vertices, as in attributes: a property of a PLY file such as quality, an array of the "
         "points of a VTK or GIfTI file, or color."},
    {.pointer = MEMBER(ADVANCED, "/sampling/grid", "component"),
     .title = "Component of the value",
     .low = 0,
     .high = 3,
     AT_HAS(grid.component, grid.has_component),
     .prose =
         "The component of the value of the vertices. Of a color, 0 to 3 are red, green, blue and opacity, from 0 to 1. "
         "Required if the value has several components; only for meshes."},
    {.pointer = MEMBER(ADVANCED, "/sampling/grid", "kind"),
     .title = "Meaning of the values",
     WORDS(SPEC_MAP),
     .otherwise = "\"spacing\"",
     AT(grid.kind),
     .prose =
         "spacing: values are distances between neighbours, above 0. density: values are points per unit of "
         "area; where the density is 0, only max_spacing and gradation determine the points."},
    {.pointer = MEMBER(ADVANCED, "/sampling", "points"),
     .title = "Existing points",
     .flags = SPEC_OPTIONAL,
     HAS_MEMBERS_IF(has_points),
     .prose =
         "Points that are given, from a file. Each must be within 0.1 spacings of the surface. The target is "
         "the number of all points of the result: with mode keep it includes the given ones. Requires the "
         "method sized; excludes control, resolve, queue.coherent and any solver.init but surface."},
    {.pointer = MEMBER(ADVANCED, "/sampling/points", "path"),
     .title = "File",
     .flags = SPEC_REQUIRED,
     PATH,
     AT(points.path),
     .prose =
         "The file: PLY, or NPZ of NumPy with an array position or points of shape (N, 3). It must lie below one "
         "of the service's input roots, or have been sent with hexadctl upload. Only the positions are read, in world space."},
    {.pointer = MEMBER(ADVANCED, "/sampling/points", "mode"),
     .title = "Use of the points",
     .flags = SPEC_REQUIRED,
     WORDS(SPEC_POINTS),
     AT(points.mode),
     .prose =
         "keep: the points are in the result, at the same positions and first; the other points arrange "
         "themselves around them, and the attribute kept is 1 for them and 0 for the others. refine: the solve "
         "starts with the points, and inserts others between them. avoid: the points are not in the result, "
         "whose points keep the distance from them."},
    {.pointer = MEMBER(ADVANCED, "/sampling/points", "distance"),
     .title = "Least distance from the given points",
     LENGTH(0),
     AT(points.distance),
     .prose = "The least distance of the result's points from the given points. Required by mode avoid."},
    {.pointer = MEMBER(ADVANCED, "/sampling", "curve_spacing"),
     .title = "Spacing along curves",
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 1,
     AT(curve_spacing),
     .prose = "The spacing of points on curves (sharp edges, boundaries of meshes, curves of features), as a "
              "fraction of the spacing around them. Away from the curves it grows by gradation; the count "
              "does not change. It may be combined with curvature, grid or feature. It has no effect on a "
              "surface without curves. Requires the method sized; excludes alpha."},
    {.pointer = MEMBER(ADVANCED, "/sampling", "min_spacing"),
     .title = "Smallest spacing",
     LENGTH(0),
     AT(min_spacing),
     .prose = "The smallest spacing. Requires curvature, grid, feature or curve_spacing, and is refused "
              "without them. feature uses no spacing below it. Default for feature: a "
              "quarter of a voxel; of a cell for a formula; for a mesh with resolve, 1/256 of its longest "
              "side or a quarter of the side of its triangles, more if its area is large."},
    {.pointer = MEMBER(ADVANCED, "/sampling", "max_spacing"),
     .title = "Largest spacing",
     LENGTH(0),
     AT(max_spacing),
     .prose = "The largest spacing. Requires curvature, grid, feature or curve_spacing, and is refused "
              "without them. At least min_spacing."},
    {.pointer = MEMBER(ADVANCED, "/sampling", "gradation"),
     .title = "Growth of the spacing",
     .flags = SPEC_LOW_OPEN | SPEC_DEPENDENT,
     .low = 0,
     .high = 10,
     .otherwise = "0.2",
     AT(gradation),
     .prose = "The largest increase of the spacing per unit of distance along the surface. Requires "
              "curvature, grid, feature or curve_spacing, and is refused without them."},

    GROUP(ADVANCED, "", "solver", 0, "How the points are computed."),
    {.pointer = MEMBER(RESEARCH, "/solver", "method"),
     .flags = SPEC_DEPENDENT,
     WORDS(SPEC_METHOD),
     .otherwise = "\"sized\"",
     AT(method),
     .prose =
         "paper: the particle system of Meyer, Georgel and Whitaker (2005). sized: the same system, "
         "solved from coarse to fine; it leaves fewer defects in less time. witkin-heckbert: the method "
         "that the paper compares itself with. It has its own Gaussian energy, splits and deletes points "
         "at any time and does not reach the requested count exactly. sampling.alpha requires paper "
         "(then the default) or witkin-heckbert; curvature, grid, feature and curve_spacing require "
         "sized; control requires sized or paper."},
    {.pointer = MEMBER(RESEARCH, "/solver", "energy"),
     WORDS(SPEC_ENERGY),
     .otherwise = "\"cotangent\"",
     .methods = MEYER,
     AT(energy),
     .prose = "cotangent: equations (6) and (7). gaussian and electrostatic are for comparison, see "
              "section 4. The standard deviation of the Gaussian is a third of the support; the "
              "electrostatic energy is cut off at the support."},
    {.pointer = MEMBER(RESEARCH, "/solver", "minimiser"),
     .title = "Method of minimisation",
     WORDS(SPEC_MINIMISER),
     .otherwise = "\"lm\"",
     .methods = MEYER,
     AT(minimiser),
     .prose = "lm: Levenberg-Marquardt with one lambda per particle, section 5. gradient: steepest descent "
              "(5) with a fixed step, as in Table 1."},
    {.pointer = MEMBER(RESEARCH, "/solver", "step"),
     .title = "Step of the gradient minimiser",
     .flags = SPEC_LOW_OPEN | SPEC_DEPENDENT,
     .low = 0,
     .high = 10,
     .otherwise = "0.05",
     .methods = MEYER,
     AT(step),
     .unit = "sigma^2",
     .prose = "The step of the gradient minimiser: a factor of the force, in units of sigma^2. The "
              "cotangent energy overshoots above about 0.2. Belongs to gradient."},
    {.pointer = MEMBER(RESEARCH, "/solver", "sigma"),
     .title = "Support of the energy",
     .low = 0,
     .high = WORLD_MAX,
     .otherwise = "0",
     .methods = MEYER,
     AT(sigma),
     .unit = "world",
     .prose = "The initial support of the potential. It adapts to the count. 0: computed from count and "
              "area."},
    {.pointer = MEMBER(RESEARCH, "/solver", "witkin_heckbert"),
     .title = "Parameters of Witkin and Heckbert",
     .methods = METHOD(WITKIN_HECKBERT),
     HAS_MEMBERS,
     .prose = "Parameters of the method \"witkin-heckbert\", with the symbols and defaults of its paper "
              "(1994). The target radius, sigma_hat, follows from the sampling target."},
    {.pointer = MEMBER(RESEARCH, "/solver/witkin_heckbert", "alpha"),
     .title = "Amplitude of the repulsion (alpha)",
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 1000,
     .otherwise = "6",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.alpha),
     .prose = "alpha: the amplitude of the repulsion, E_ij = alpha exp(-r^2 / (2 sigma_i^2)). It scales "
              "the speed."},
    {.pointer = MEMBER(RESEARCH, "/solver/witkin_heckbert", "e_hat"),
     .title = "Energy that particles aim at (E_hat)",
     .low = 0.01,
     .high = 10,
     .otherwise = "0.8",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.e_hat),
     .prose = "E_hat divided by alpha: the energy that each particle aims at. A larger one gives a denser "
              "sampling. At 0.8 neighbours are two sigma apart."},
    {.pointer = MEMBER(RESEARCH, "/solver/witkin_heckbert", "rho"),
     .title = "Speed of the radii (rho)",
     .low = 0,
     .high = 1000,
     .otherwise = "15",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.rho),
     .prose = "rho: how fast the radius of a particle follows its energy, dD/dt = -rho (D - E_hat)."},
    {.pointer = MEMBER(RESEARCH, "/solver/witkin_heckbert", "phi"),
     .title = "Speed of the return to the surface (phi)",
     .low = 0,
     .high = 1000,
     .otherwise = "15",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.phi),
     .prose = "phi: how fast a particle returns to the surface, dF/dt = -phi F: the feedback term of (2)."},
    {.pointer = MEMBER(RESEARCH, "/solver/witkin_heckbert", "beta"),
     .title = "Damping without neighbours (beta)",
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 1000,
     .otherwise = "10",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.beta),
     .prose = "beta: keeps the rate of a radius finite where a particle has no neighbours. In units of 1 / "
              "sigma_i; the paper of 1994 uses 1 / length."},
    {.pointer = MEMBER(RESEARCH, "/solver/witkin_heckbert", "dt"),
     .title = "Time step",
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 1,
     .otherwise = "0.03",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.dt),
     .unit = "time",
     .prose = "Delta t: the time step of Euler's method. With the other defaults it is unstable above "
              "about 0.07."},
    {.pointer = MEMBER(RESEARCH, "/solver/witkin_heckbert", "gamma"),
     .title = "Speed near the equilibrium (gamma)",
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 1e6,
     .otherwise = "4",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.gamma),
     .prose = "gamma: a particle slower than gamma sigma_i is near its equilibrium and may be split or "
              "deleted."},
    {.pointer = MEMBER(RESEARCH, "/solver/witkin_heckbert", "nu"),
     .title = "Energy of a split (nu)",
     .low = 0,
     .high = 10,
     .otherwise = "0.2",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.nu),
     .prose = "nu: a particle whose radius exceeds its target is split when its energy exceeds nu E_hat."},
    {.pointer = MEMBER(RESEARCH, "/solver/witkin_heckbert", "delta"),
     .title = "Radius of a deletion (delta)",
     .low = 0,
     .high = 0.99,
     .otherwise = "0.7",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.delta),
     .prose = "delta: a particle may be deleted when its radius is below delta times its target radius. "
              "The smaller the radius, the more likely."},
    {.pointer = MEMBER(RESEARCH, "/solver/witkin_heckbert", "sigma_max"),
     .title = "Largest radius",
     .low = 0,
     .high = WORLD_MAX,
     .otherwise = "0",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.sigma_max),
     .unit = "world",
     .prose = "sigma_max: a particle with a larger radius is always split. 0: the larger of half the "
              "longest side of the surface and 1.5 target radii."},
    {.pointer = MEMBER(RESEARCH, "/solver", "init"),
     .title = "Placement of first points",
     .flags = SPEC_DEPENDENT,
     WORDS(SPEC_INIT),
     .otherwise = "\"surface\"",
     AT(init),
     .prose =
         "surface: the first points are distributed over the surface by area. random: they are uniform in "
         "the domain or, for volumes, in the voxels that the surface crosses. sized: a packing computed "
         "from coarse to fine as by the method sized, then refined by the chosen method. Its sweeps are "
         "part of the start and are not in the report. With sampling.alpha and the method paper the "
         "packing has the amplitudes; with the energy cotangent, the minimiser lm and no "
         "sampling.control it is the result, and its sweeps are in the report. Default: sized if "
         "sampling.alpha is given, otherwise surface. sampling.points excludes random and sized."},
    {.pointer = MEMBER(ADVANCED, "/solver", "seed"),
     .title = "Seed of the random numbers",
     .low = 0,
     .high = 9007199254740992.0,
     .otherwise = "0",
     AT(seed),
     .prose = "The seed of the random numbers. The same spec, seed and build give the same bytes."},
    {.pointer = MEMBER(ADVANCED, "/solver", "threads"),
     .title = "Number of threads",
     .low = 0,
     .high = 1024,
     .otherwise = "0",
     AT(threads),
     .prose = "The number of threads; 0: those that the service gives to each worker. The result does not "
              "depend on it."},
    {.pointer = MEMBER(RESEARCH, "/solver", "isa"),
     .title = "Instruction set",
     WORDS(SPEC_ISA),
     .otherwise = "\"auto\"",
     AT(isa),
     .prose = "The instruction set of the numerical kernels; auto: the best one that the machine supports. "
              "The result does not depend on it."},
    {.pointer = MEMBER(RESEARCH, "/solver", "max_sweeps"),
     .title = "Most sweeps",
     .low = 1,
     .high = 1e6,
     .otherwise = "5000",
     AT(max_sweeps),
     .unit = "sweeps",
     .prose = "The maximum number of sweeps; the solver stops then, converged or not."},
    {.pointer = MEMBER(RESEARCH, "/solver", "step_tolerance"),
     .title = "Tolerance of the step",
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 1,
     .otherwise = "0.003",
     AT(step_tolerance),
     .unit = "spacings",
     .prose =
         "Convergence requires an rms step below this. For witkin-heckbert it is the rms displacement per "
         "unit of time. Below 0.003 only a few defects still move: 0.001 doubles the sweeps and changes "
         "the quality less than another seed."},
    {.pointer = MEMBER(RESEARCH, "/solver", "energy_tolerance"),
     .title = "Tolerance of the energy",
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 10,
     .otherwise = "0.05",
     AT(energy_tolerance),
     .prose =
         "The maximum relative difference between the mean energy of the points and the ideal one, for the methods that choose the "
         "support of the energy (every method except sized). A larger difference is the criterion target_energy of the "
         "outcome not_converged."},

    GROUP(RESEARCH, "", "outcome", SPEC_OPTIONAL,
          "Requirements on the result in addition to the criteria of every job (doc/report.md)."),
    GROUP(RESEARCH, "/outcome", "require", SPEC_OPTIONAL,
          "Bounds on measures of the report. A result that violates one has the outcome unresolved, with "
          "that measure as the criterion."),
#define REQUIRE(prefix, NAME, word, minimum)                                          \
    {.pointer = MEMBER(RESEARCH, "/outcome/require", #word),                          \
     .title = (minimum) ? "Smallest " #word : "Largest " #word,                       \
     .low = -1,                                                                       \
     .high = 1e6,                                                                     \
     AT_HAS(require[prefix##_##NAME].bound, require[prefix##_##NAME].given),          \
     .prose = (minimum) ? "The smallest value of quality." #word " that is accepted." \
                        : "The largest value of quality." #word " that is accepted."},
    SPEC_REQUIRE_LIST(REQUIRE, SPEC_REQUIRE)
#undef REQUIRE

        {.pointer = MEMBER(BASIC, "", "attributes"),
         .title = "Values at the points",
         .type = SPEC_TYPE_GROUPS,
         .low = 0,
         .high = 32,
         UNSTORED,
         .prose = "Values from files that are interpolated at the points and written to every output, "
                  "such as temperature, velocity or colours. doc/formats.md lists their names in each "
                  "format."},
    {.pointer = MEMBER(BASIC, "/attributes", "from"),
     .title = "Source of the values",
     PATH,
     .otherwise = "\"surface\"",
     AT(attribute.from),
     .prose =
         "Where the values are. surface: in the file of the surface, of a combined surface in the first of its "
         "files. geometry: in the surface itself. Anything else is the path of an OpenVDB, NRRD, NIfTI or mesh "
         "file in the same space; it moves with the transforms of the surface."},
    {.pointer = MEMBER(BASIC, "/attributes", "name"),
     .title = "Name in the source",
     .low = 1,
     .high = 1000,
     AT(attribute.name),
     .prose =
         "The grid of an OpenVDB file (any of numbers or vectors), the channel of a stack of images, the "
         "component of an NRRD file with several values at a place (0, 1, ...; all of them if this is "
         "absent), or the name of a value of the vertices of a mesh, or base_color: the colour of its materials and images. Geometric quantities: part (the number of the "
         "part of a combined surface, from 0), direction1 or direction2 (of the principal curvatures), source (the place "
         "on the mesh: source_mesh, source_face, source_corner and source_bary; doc/formats.md), weight (the quadrature "
         "weight: the sum of weight times f approximates the integral of f; excludes sampling.attach and given points "
         "with mode avoid)."},
    {.pointer = MEMBER(ADVANCED, "/attributes", "as"),
     .title = "Name in the results",
     .low = 1,
     .high = 63,
     AT(attribute.as),
     .prose =
         "The name in the outputs: letters, digits and _. Default: the name, with _ for other characters."},
    {.pointer = MEMBER(ADVANCED, "/attributes", "type"),
     .title = "Type of the values",
     WORDS(SPEC_ATTRIBUTE),
     .otherwise = "\"auto\"",
     AT(attribute.type),
     .prose =
         "The type of the values. Transforms of the surface rotate and scale vectors, rotate normals, and "
         "leave other types unchanged. A color is also written as the colour of the points in each format, "
         "a uv as texture coordinates. auto: int for whole numbers, vector for three components, float for "
         "others; for a mesh, the type of its value."},
    {.pointer = MEMBER(ADVANCED, "/attributes", "interpolation"),
     .title = "Values between the samples",
     WORDS(SPEC_INTERPOLATION),
     .otherwise = "\"linear\"",
     AT(attribute.interpolation),
     .prose =
         "Between the samples of a grid. cubic: Catmull and Rom's splines, which go through the samples. Whole "
         "numbers are always those of the nearest sample."},

    GROUP(BASIC, "", "output", 0, "The files to write."),
    {.pointer = MEMBER(ADVANCED, "/output", "order"),
     .title = "Order of the points",
     WORDS(SPEC_ORDER),
     AT_HAS(order, has_order),
     .prose =
         "The order of the points in all outputs. progressive: the first n points are spread evenly over the "
         "surface, for any n, so a program that reads the beginning of a file has a coarser sampling. "
         "spatial: along Morton's curve, so points that are close in the file are close in space. id: "
         "ascending ids; requires queue.coherent. Default: the order of the solver, which may differ from "
         "version to version."},
    {.pointer = MEMBER(ADVANCED, "/output", "orient"),
     .title = "Orientations",
     .flags = SPEC_OPTIONAL | SPEC_SWITCH,
     HAS_MEMBERS_IF(has_orient),
     .prose =
         "Whether the points have orient, a unit quaternion x y z w that turns +z to the normal: orient_x, "
         "orient_y, orient_z and orient_w in PLY files, orient in all others. true: by the shortest "
         "turn. An object can add a turn about +z before it, the twist, and replace the normal by the direction up."},
    {.pointer = MEMBER(ADVANCED, "/output/orient", "twist"),
     .title = "Attribute of the twist",
     .low = 1,
     .high = 63,
     AT(orient.twist),
     .prose =
         "The attribute, by its name in the outputs, that gives the twist: a number is an angle in radians; a "
         "vector is the direction to which +x turns, as far as it is tangential."},
    {.pointer = MEMBER(ADVANCED, "/output/orient", "seed"),
     .title = "Seed of random twists",
     .low = 0,
     .high = 9007199254740992,
     AT_HAS(orient.seed, orient.has_seed),
     .prose =
         "The twist is a random angle, computed from this seed and the id of the point (its row, unless it is "
         "a point of a coherent sequence)."},
    {.pointer = MEMBER(ADVANCED, "/output/orient", "up"),
     .title = "Fixed direction",
     .low = -WORLD_MAX,
     .high = WORLD_MAX,
     AT_HAS(orient.up, orient.has_up),
     .prose =
         "The direction to which +z turns at every point, in place of the normal: [0, 0, 1] or [0, 1, 0] for trees that "
         "grow straight up on a slope. Normals, if they are written, stay those of the surface."},
    GROUP(ADVANCED, "/output", "ply", 0, "Options of points.ply."),
    {.pointer = MEMBER(ADVANCED, "/output/ply", "format"),
     .title = "Encoding",
     WORDS(SPEC_PLY),
     .otherwise = "\"binary_little_endian\"",
     AT(ply_format),
     .prose = "The encoding of points.ply."},
    {.pointer = MEMBER(ADVANCED, "/output/ply", "precision"),
     .title = "Type of the properties",
     WORDS(SPEC_PRECISION),
     .otherwise = "\"float\"",
     AT(ply_precision),
     .prose = "The type of all properties of points.ply except id."},
    {.pointer = MEMBER(ADVANCED, "/output/ply", "properties"),
     .title = "Columns",
     .flags = SPEC_OR_ONE,
     .low = 0,
     .high = 100,
     AT_HAS(ply_properties, ply_property_count),
     .prose =
         "Which properties points.ply has, in this order; x, y and z come first. default: the normals, "
         "spacing_local, spacing if the spacing is graded, the attributes, and id and velocity of coherent "
         "sequences. all: all that doc/report.md lists. The name of an application: the properties that it reads: "
         "blender, houdini, meshlab, or minimal (positions and normals). doc/formats.md has further names. red, "
         "green and blue are those of an attribute of colours, else the colours of alpha or the curvature, with "
         "the map of the preview. Without the list: default, with attach all that the points of the result have."},
    {.pointer = MEMBER(BASIC, "/output", "preview"),
     .title = "Pictures",
     .flags = SPEC_SWITCH,
     HAS_MEMBERS_IF(has_preview),
     .part = BUILD_PART_PREVIEW,
     .prose = "The picture preview.png. false: it is not written. true or an object: it is, and preview.exr "
              "if preview_exr is true; the object has the members below."},
    {.pointer = MEMBER(ADVANCED, "/output/preview", "size"),
     .title = "Size",
     .low = 64,
     .high = 8192,
     .otherwise = "[512,512]",
     AT_AS(SPEC_TYPE_SIZE, preview_width),
     .unit = "pixels",
     .prose = "The side of a square image, or [width, height]."},
    {.pointer = MEMBER(ADVANCED, "/output/preview", "color"),
     .title = "What the colours show",
     .flags = SPEC_DEPENDENT,
     WORDS(SPEC_COLOR),
     AT(preview_color),
     .prose =
         "The quantity that the colours show: the amplitude alpha, the curvature kappa, the energy of "
         "a particle, the achieved spacing, or the number of neighbours (degree). shading: one colour, "
         "shaded by the normals; it excludes range, and map has no effect. Default: alpha if sampling.alpha is given; "
         "spacing if the spacing is graded, in a sequence only with min_spacing and max_spacing, which are "
         "then the range; otherwise shading."},
    {.pointer = MEMBER(ADVANCED, "/output/preview", "attribute"),
     .title = "Attribute that the colours show",
     .low = 1,
     .high = 63,
     AT(preview_attribute),
     .prose = "The attribute that the colours show instead of color, by its name in the outputs; "
              "for a vector, its length. An attribute of type color is shown unchanged. Surfaces "
              "with patches also have patch and feature, labels have label_a and label_b."},
    {.pointer = MEMBER(ADVANCED, "/output/preview", "range"),
     .title = "Range of the colours",
     .low = -1e300,
     .high = 1e300,
     AT_HAS(preview_range, preview_range_count),
     .prose =
         "The values at both ends of the colours, the lower one first. Requires attribute, or a color other than shading. "
         "Default: the 2nd and the 98th percentile."},
    {.pointer = MEMBER(ADVANCED, "/output/preview", "map"),
     .title = "Colour map",
     WORDS(SPEC_MAP_COLORS),
     .otherwise = "\"viridis\"",
     AT(preview_map),
     .prose = "The colours. diverging: from blue through nearly white, the middle of the range, to red."},
    {.pointer = MEMBER(RESEARCH, "/output/preview", "channels"),
     .title = "Channels of preview.exr",
     WORDS(SPEC_CHANNELS),
     .otherwise = "\"basic\"",
     AT(preview_channels),
     .prose =
         "The channels of preview.exr. basic: R, G, B, A, Z and id, by which points.ply has the rest of a "
         "point. all: also the place and the normal (P, N), kappa and spacing, in three times as many bytes."},
    {.pointer = MEMBER(RESEARCH, "/output/preview", "compression"),
     .title = "Compression of preview.exr",
     WORDS(SPEC_COMPRESSION),
     .otherwise = "\"zip\"",
     AT(preview_compression),
     .prose =
         "The compression of preview.exr, always without loss. At 512 x 512 pixels zip, 16 lines at once, gives 0.4 to "
         "1 MB; zips, line by line, a ninth more; rle 2 MB; none 4.2 MB (12.6 with all channels)."},
    {.pointer = MEMBER(ADVANCED, "/output/preview", "up"),
     .title = "Axis that points up",
     WORDS(SPEC_UP),
     .otherwise = "\"auto\"",
     AT(preview_up),
     .prose = "The axis that points up unless a camera says so. auto: y for OpenVDB files and most meshes; z "
              "for STL, 3MF, VTK (.vtk, .vtp) and GIfTI (.gii) meshes and all other surfaces. For an "
              "OBJ, OFF, PLY or STL file, the other axis if the mesh has a flat base along that axis only. "
              "The first part of a combination decides."},
    {.pointer = MEMBER(ADVANCED, "/output/preview", "camera"),
     .flags = SPEC_OPTIONAL,
     HAS_MEMBERS_IF(has_camera),
     .prose = "The camera. Without it, the surface is seen from the right, the front and above, and fills "
              "the image."},
    {.pointer = MEMBER(ADVANCED, "/output/preview/camera", "position"),
     .title = "Position of the eye",
     .flags = SPEC_REQUIRED,
     POSITION,
     AT(camera.position),
     .prose = "The position of the eye. Points behind it are not visible, also in orthographic images."},
    {.pointer = MEMBER(ADVANCED, "/output/preview/camera", "target"),
     .title = "Point in the middle",
     .flags = SPEC_REQUIRED,
     POSITION,
     AT(camera.target),
     .prose = "The point in the middle of the image."},
    {.pointer = MEMBER(ADVANCED, "/output/preview/camera", "up"),
     .title = "Upward direction",
     .flags = SPEC_DEPENDENT,
     .low = -WORLD_MAX,
     .high = WORLD_MAX,
     AT(camera.up),
     .prose = "The direction that points up in the image; default: the axis of up. It must not be "
              "parallel to the line of sight. A turntable rotates about it."},
    {.pointer = MEMBER(ADVANCED, "/output/preview/camera", "fov"),
     .title = "Angle of view",
     .flags = SPEC_LOW_OPEN,
     .choice = SPEC_CHOICE_LENS,
     .low = 0,
     .high = 3,
     AT(camera.fov),
     .unit = "radians",
     .prose = "The angle of view along the longer side of the image. 0.452 if neither fov nor orthographic "
              "is given."},
    {.pointer = MEMBER(ADVANCED, "/output/preview/camera", "orthographic"),
     .title = "Length shown by a parallel projection",
     LENGTH(0),
     .choice = SPEC_CHOICE_LENS,
     AT(camera.orthographic),
     .prose = "Selects parallel projection: the length that the longer side of the image shows."},
    {.pointer = MEMBER(ADVANCED, "/output/preview", "turntable"),
     .title = "Pictures of a turntable",
     .low = 0,
     .high = 360,
     .otherwise = "0",
     AT(turntable),
     .unit = "frames",
     .prose = "The number of images of one full rotation around the surface: preview.0001.png and so on; "
              "0: none. The axis is the camera's up direction through its target. Without a camera it is "
              "the axis that is up, through the centre of the points."},
    {.pointer = MEMBER(RESEARCH, "/output", "preview_exr"),
     .title = "preview.exr",
     .otherwise = "false",
     AT(has_preview_exr),
     .prose = "Whether to write preview.exr, beside preview.png: the picture with data in each pixel."},
    {.pointer = MEMBER(RESEARCH, "/output", "convergence"),
     .title = "Table of the convergence",
     .otherwise = "false",
     AT(has_convergence),
     .prose = "Whether to write convergence.csv: energy, lambda, step and count of each sweep."},
    {.pointer = MEMBER(BASIC, "/output", "points_vdb"),
     .title = "points.vdb",
     .otherwise = "false",
     AT(points_in[FILE_FORMAT_VDB]),
     .prose = "Whether to write points.vdb: an OpenVDB points grid with N, pscale (half the achieved "
              "spacing) and id (the index of the point in points.ply, from 0)."},
    {.pointer = MEMBER(BASIC, "/output", "points_npz"),
     .title = "points.npz",
     .otherwise = "false",
     AT(points_in[FILE_FORMAT_NPZ]),
     .prose =
         "Whether to write points.npz: an array of NumPy for each property and attribute, in double precision."},
    {.pointer = MEMBER(BASIC, "/output", "points_vtp"),
     .title = "points.vtp",
     .otherwise = "false",
     AT(points_in[FILE_FORMAT_VTP]),
     .prose =
         "Whether to write points.vtp: VTK PolyData with each point as a vertex and an array for each property and "
         "attribute, in double precision."},
    {.pointer = MEMBER(BASIC, "/output", "points_glb"),
     .title = "points.glb",
     .otherwise = "false",
     AT(points_in[FILE_FORMAT_GLTF]),
     .prose = "Whether to write points.glb: the points as glTF, with normals, colours and all attributes."},
    {.pointer = MEMBER(BASIC, "/output", "points_usda"),
     .title = "points.usda",
     .otherwise = "false",
     AT(points_in[FILE_FORMAT_USD]),
     .prose =
         "Whether to write points.usda: UsdGeomPoints as text, with widths, normals, colours and all attributes."},
    GROUP(ADVANCED, "/output", "usd", SPEC_OPTIONAL, "Options of points.usda."),
    {.pointer = MEMBER(ADVANCED, "/output/usd", "instancer"),
     .title = "Instances of a prototype",
     .flags = SPEC_OPTIONAL,
     HAS_MEMBERS_IF(has_instancer),
     .prose =
         "points.usda has a UsdGeomPointInstancer instead of UsdGeomPoints: each point is an instance of a "
         "prototype, with the orientation of output.orient (without it, the shortest turn of +z to the "
         "normal). Requires points_usda."},
    {.pointer = MEMBER(ADVANCED, "/output/usd/instancer", "prototype"),
     .title = "USD file of the prototype",
     .flags = SPEC_REQUIRED,
     PATH,
     AT(instancer.prototype),
     .prose =
         "The path of the USD file whose default prim is the prototype, such as ./rock.usda. It is written as "
         "given; programs that open points.usda resolve a relative path from its directory. hexad "
         "does not open the file."},
    {.pointer = MEMBER(ADVANCED, "/output/usd/instancer", "scale"),
     .title = "Attribute of the scale",
     .low = 1,
     .high = 63,
     AT(instancer.scale),
     .prose =
         "The attribute, by its name in the outputs, that scales the prototype: a number, or a vector of three "
         "components for its axes. Default: the achieved spacing at the point, so a prototype of size 1 is as "
         "large as the spacing."},
    {.pointer = MEMBER(ADVANCED, "/output/usd/instancer", "size"),
     .title = "Factor of all scales",
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = WORLD_MAX,
     .otherwise = "1",
     AT(instancer.size),
     .prose = "A factor of all scales."},
    {.pointer = MEMBER(BASIC, "/output", "mesh"),
     .title = "Triangles between the points",
     .otherwise = "false",
     AT(has_mesh),
     .prose = "Whether to write mesh.ply: triangles whose vertices are the points, with the order and "
              "properties of points.ply. The member mesh of the report states whether the triangles close "
              "the surface. Excludes sampling.points with mode avoid."},
    {.pointer = MEMBER(ADVANCED, "/output", "mesh_usda"),
     .title = "mesh.usda",
     .otherwise = "false",
     AT(mesh_in[FILE_FORMAT_USD]),
     .prose = "Whether to write the mesh as mesh.usda, too: a UsdGeomMesh as text. Requires mesh."},
    {.pointer = MEMBER(ADVANCED, "/output", "label_meshes"),
     .title = "A mesh for each label",
     .otherwise = "false",
     AT(has_label_meshes),
     .prose =
         "Whether to write mesh_label_N.ply for each label N except the background: the part of the mesh "
         "that bounds the label, with outward normals. Such a mesh is closed unless its label reaches the "
         "end of the data, which is an interface with surface.labels.closed. Requires mesh and "
         "surface.labels."},
    {.pointer = MEMBER(ADVANCED, "/output", "directory"),
     .title = "Copy of the results to a directory",
     PATH,
     AT(directory),
     .prose = "The service copies the results into this directory: an absolute path below one of its "
              "output roots. It is created if missing. Files of the same name are replaced. In a sequence, "
              "####, %04d or $F4 stands for the frame number."},

    GROUP(ADVANCED, "", "limits", 0,
          "The resources that the job may use. 0: the default of the service or of the worker."),
    {.pointer = MEMBER(ADVANCED, "/limits", "memory_mb"),
     .title = "Memory, MiB",
     .flags = SPEC_OR_ZERO,
     .low = WORKER_MEMORY_LEAST_MB,
     .high = 1 << 24,
     .otherwise = "0",
     AT(memory_mb),
     .unit = "MiB",
     .prose =
         "The memory of the worker; 0: the service's setting. A job that requires more for its points, "
         "grids or pictures ends with limit_memory before it allocates it. If systemd has delegated a "
         "control group to the service, the kernel kills a worker that uses more, also with limit_memory. "
         "Without a control group, use can briefly exceed the limit: the address space is limited to this "
         "value plus 512 MiB plus 80 MiB for each processor."},
    {.pointer = MEMBER(ADVANCED, "/limits", "timeout_s"),
     .title = "Time, seconds",
     .low = 0,
     .high = 1e7,
     .otherwise = "0",
     AT(timeout_s),
     .unit = "s",
     .prose = "The time that the job, or each frame of it, may run, summed over all attempts. Attempts "
              "that the service itself stopped, as for a restart, do not count."},
    {.pointer = MEMBER(ADVANCED, "/limits", "stall_s"),
     .title = "Time without progress, seconds",
     .low = 0,
     .high = 1e7,
     .otherwise = "0",
     AT(stall_s),
     .unit = "s",
     .prose = "An attempt without progress for this long is stopped, and tried again up to "
              "max_attempts."},
    {.pointer = MEMBER(ADVANCED, "/limits", "max_chunks"),
     .title = "Most chunks of an OME-Zarr",
     .low = 1,
     .high = 1e9,
     .otherwise = "100000",
     AT(max_chunks),
     .unit = "chunks",
     .prose =
         "The maximum number of chunks of an OME-Zarr directory that are read. A region, or a coarser level, needs fewer."},
    {.pointer = MEMBER(ADVANCED, "/limits", "image_pixels"),
     .title = "Most pixels of an image",
     .low = 1,
     .high = 1 << 30,
     .otherwise = "268435456",
     AT(image_pixels),
     .unit = "pixels",
     .prose =
         "The maximum width times height of an image of a mesh (attributes: base_color). A larger one is "
         "refused before it is decoded."},
    {.pointer = MEMBER(ADVANCED, "/limits", "image_scans"),
     .title = "Most scans of a JPEG image",
     .low = 1,
     .high = 100000,
     .otherwise = "500",
     AT(image_scans),
     .unit = "scans",
     .prose =
         "The maximum number of scans of a progressive JPEG image of a mesh. Usual images have about ten; each "
         "takes the time of a decoding."},
    {.pointer = MEMBER(ADVANCED, "/limits", "max_attempts"),
     .title = "Most attempts",
     .low = 0,
     .high = 100,
     .otherwise = "0",
     AT(max_attempts),
     .unit = "attempts",
     .prose = "The maximum number of attempts if the worker crashes."},

    GROUP(BASIC, "", "queue", 0, "The job's place in the queue."),
    {.pointer = MEMBER(ADVANCED, "/queue", "priority"),
     .low = -1000,
     .high = 1000,
     .otherwise = "0",
     AT(priority),
     .prose = "Jobs of higher priority run first."},
    {.pointer = MEMBER(ADVANCED, "/queue", "labels"),
     .title = "Labels to search for",
     .low = 0,
     .high = 32,
     .otherwise = "[]",
     AT_HAS(labels, label_count),
     .prose = "Words to search for the job by, each 1 to 100 characters long."},
    {.pointer = MEMBER(ADVANCED, "/queue", "depends_on"),
     .title = "After the success of jobs",
     .low = 0,
     .high = 1000,
     .otherwise = "[]",
     AT_HAS(depends_on, depends_on_count),
     .prose = "Identifiers of jobs that must succeed before this one starts. If one of them does not "
              "succeed, this job fails."},
    {.pointer = MEMBER(ADVANCED, "/queue", "after"),
     .title = "After the end of jobs",
     .low = 0,
     .high = 1000,
     .otherwise = "[]",
     AT_HAS(after, after_count),
     .prose = "Identifiers of jobs that must end before this one starts, successful or not."},
    {.pointer = MEMBER(ADVANCED, "/queue", "after_frames"),
     .title = "Frame by frame after jobs",
     .low = 0,
     .high = 100,
     .otherwise = "[]",
     AT_HAS(after_frames, after_frames_count),
     .prose =
         "Identifiers of arrays of the same user with all frames of this job. Each frame of this job starts when the same frame of these "
         "jobs has succeeded with an accepted outcome. If it ends otherwise, the frame of this job fails. Requires frames."},
    {.pointer = MEMBER(ADVANCED, "/queue", "accept"),
     .title = "Accepted outcomes",
     .otherwise = "[\"converged\",\"unresolved\",\"not_converged\"]",
     WORDS(SPEC_OUTCOME),
     AT_AS(SPEC_TYPE_WORDS, accept),
     .prose =
         "The outcomes of this job that its users accept; for an array, of each of its frames. A job that names this "
         "one in depends_on or after_frames starts only if this job has such an outcome, and fails otherwise. hexadctl "
         "wait --accept exits with 0 if the outcome is in the list. The state and the outcome of the job do not change."},
    {.pointer = MEMBER(BASIC, "/queue", "frames"),
     .title = "Numbers of the frames",
     .low = 1,
     .high = SPEC_FRAMES_LENGTH_MAX,
     AT(frames),
     .prose =
         "The frame numbers; the job has one task per frame: \"1-100\", \"1-100x2\", \"1-10,20\". The "
         "first ####, %04d or $F4 in each input path stands for the frame number. At least one input path "
         "must contain one, unless by_frame is given; output.directory must contain one in any case. At "
         "most 100000 frames. \"all\": the frames of all files of the first such path at the submission."},
    {.pointer = MEMBER(ADVANCED, "/queue", "by_frame"),
     .title = "Values that change by frame",
     .low = 1,
     .high = 32,
     AT_AS(SPEC_TYPE_FRAME_VALUES, has_frame_values),
     .prose =
         "Members of the spec that change from frame to frame, by JSON Pointer. Each has a list of "
         "exactly one value for each frame, {\"/solver/seed\": [1, 2, 3]}, or a ramp, "
         "{\"/surface/analytic/radius\": {\"from\": 1, \"to\": 2}}: linear in the frame number, from the "
         "lowest to the highest frame. Only members of surface, region, sampling, solver and output may "
         "change; paths, slices, solver.threads and output.directory may not. At most 10000 frames."},
    {.pointer = MEMBER(ADVANCED, "/queue", "files"),
     .title = "Files of a data set",
     .low = 1,
     .high = FRAMES_MOST,
     AT(files),
     .prose =
         "The files of a data set; the job has one frame for each. A list of names, or a pattern such as "
         "\"meshes/*.ply\", with * in its last part. At the submission, the service replaces a pattern by the names "
         "of the files that exist below the input roots, in the order of their bytes. {file} in one input path stands "
         "for the name: {\"mesh\": {\"path\": \"{file}\"}}. Frame k has file k, from 0. Names of uploads may be "
         "listed if the path is {file}. Excludes frames, by_frame, coherent and after_frames. At most 100000 files; "
         "the setting max_files of the service may be lower."},
    {.pointer = MEMBER(ADVANCED, "/queue", "max_running"),
     .title = "Most frames at once",
     .low = 0,
     .high = 100000,
     .otherwise = "0",
     AT(max_running),
     .unit = "frames",
     .prose =
         "The maximum number of frames that run at the same time; 0: as many as the service has room for."},
    {.pointer = MEMBER(ADVANCED, "/queue", "chunk"),
     .title = "Frames that run one after another",
     .low = 1,
     .high = 1000,
     .otherwise = "1",
     AT(chunk),
     .unit = "frames",
     .prose =
         "The number of consecutive frames that run one after another, as the chunk size of render managers. Each frame has limits, attempts and a result of its own. Above 1 it requires "
         "frames and excludes coherent."},
    {.pointer = MEMBER(ADVANCED, "/queue", "coherent"),
     .title = "Points follow the surface",
     .otherwise = "false",
     AT(coherent),
     .prose =
         "Whether each frame starts with the points of the frame before. The points follow the motion of "
         "the surface and keep their ids. Requires frames and the method sized; excludes features, "
         "sampling.points and sampling.alpha."},
    {.pointer = MEMBER(ADVANCED, "/queue", "retention_s"),
     .title = "Time until the results are deleted, seconds",
     .low = 0,
     .high = 1e10,
     .otherwise = "0",
     AT(retention_s),
     .unit = "s",
     .prose = "How long the job and its results are kept after its end; 0: the service's setting."},
    {.pointer = MEMBER(ADVANCED, "/queue", "webhook"),
     .title = "Address to call at the end",
     .low = 1,
     .high = 2000,
     AT(webhook),
     .prose =
         "An http or https address that the service calls when the job has ended. The service must "
         "allow its host. The service repeats the call until the answer is 2xx or the number of retries is "
         "reached. A receiver may be called more than once for the same end, with the same "
         "webhook-id, and is called again when a retried job ends."},
    {.pointer = MEMBER(ADVANCED, "/queue", "slurm"),
     .title = "Options of sbatch",
     .low = 0,
     .high = 32,
     .otherwise = "[]",
     AT_HAS(slurm, slurm_count),
     .part = BUILD_PART_SLURM,
     .prose =
         "Options of sbatch for the job's attempts, as \"--partition=gpu\", where the service runs them in Slurm. "
         "The service must allow each (its setting slurm_allow)."},
};

const size_t spec_row_count = sizeof spec_rows / sizeof *spec_rows;

const char *spec_row_key(const spec_row *row)
{
    return row->pointer + row->key_offset;
}

bool spec_row_is_member(const spec_row *row, const char *group)
{
    const size_t n = strlen(group);
    return row->key_offset == n + 1 && memcmp(row->pointer, group, n) == 0;
}

/* The row of a group, whose pointer is mostly `group` itself, not a copy. */
static const spec_row *find_group(const char *group)
{
    const spec_row *end = spec_rows + spec_row_count, *row = spec_rows;
    while (row < end && row->pointer != group) row++;
    if (row == end)
        for (row = spec_rows; row < end && strcmp(row->pointer, group) != 0;) row++;
    return row < end ? row : NULL;
}

const spec_row *spec_row_first_below(const spec_row *group)
{
    const spec_row *row = group + 1, *end = spec_rows + spec_row_count;
    return row < end && row->key_offset > group->key_offset ? row : NULL;
}

const spec_row *spec_row_first(const char *group)
{
    if (!*group) return spec_rows;
    const spec_row *row = find_group(group);
    return row ? spec_row_first_below(row) : NULL;
}

/* Behind the last row below a group, the key of the next row is nearer to the start of its pointer. */
const spec_row *spec_row_next(const spec_row *member)
{
    const spec_row *row = member + 1, *end = spec_rows + spec_row_count;
    while (row < end && row->key_offset > member->key_offset) row++;
    return row < end && row->key_offset == member->key_offset ? row : NULL;
}

const spec_row *spec_row_find_from(const spec_row *first, const char *key)
{
    const spec_row *row = first;
    while (row && strcmp(spec_row_key(row), key) != 0) row = spec_row_next(row);
    return row;
}

const spec_row *spec_row_find(const char *group, const char *key)
{
    return spec_row_find_from(spec_row_first(group), key);
}

static void print_values(FILE *file, const spec_row *row)
{
    static const char *const types[] = {
        [SPEC_TYPE_GROUP] = "object",
        [SPEC_TYPE_NUMBER] = "number",
        [SPEC_TYPE_INTEGER] = "integer",
        [SPEC_TYPE_LARGE] = "integer",
        [SPEC_TYPE_BOOL] = "boolean",
        [SPEC_TYPE_WORD] = "word",
        [SPEC_TYPE_WORDS] = "[word, ...]",
        [SPEC_TYPE_STRING] = "string",
        [SPEC_TYPE_VECTOR] = "[number x 3]",
        [SPEC_TYPE_TRIPLE] = "[integer x 3]",
        [SPEC_TYPE_NUMBERS] = "[number, ...]",
        [SPEC_TYPE_INTEGERS] = "[integer, ...]",
        [SPEC_TYPE_LISTS] = "[[integer, ...], ...]",
        [SPEC_TYPE_SIZE] = "integer or [integer, integer]",
        [SPEC_TYPE_SURFACE] = "object, as /surface",
        [SPEC_TYPE_SURFACES] = "[object, as /surface, ...]",
        [SPEC_TYPE_GROUPS] = "[object, ...]",
        [SPEC_TYPE_FRAME_VALUES] = "object",
        [SPEC_TYPE_FILES] = "string or [string, ...]",
        [SPEC_TYPE_LABELS] = "[string, ...]",
    };
    fprintf(file, " (%s", types[row->type]);
    if (row->words) {
        fprintf(file, ":");
        for (const char *const *word = row->words; *word; word++) fprintf(file, " \"%s\"", *word);
    } else if (row->type != SPEC_TYPE_GROUP && row->type != SPEC_TYPE_BOOL &&
               row->type != SPEC_TYPE_SURFACE) {
        const char *of = row->type == SPEC_TYPE_STRING         ? " characters"
                         : row->type == SPEC_TYPE_LABELS       ? " texts"
                         : row->type == SPEC_TYPE_FILES        ? " names"
                         : row->type == SPEC_TYPE_SURFACES     ? " surfaces"
                         : row->type == SPEC_TYPE_GROUPS       ? " objects"
                         : row->type == SPEC_TYPE_FRAME_VALUES ? " members"
                                                               : "";
        const char *from = row->flags & SPEC_LOW_OPEN  ? "above"
                           : row->flags & SPEC_OR_ZERO ? "0 or from"
                                                       : "from";
        fprintf(file, ", %s %.16g to %.16g%s", from, row->low, row->high, of);
    }
    if (row->unit) fprintf(file, ", %s%s", row->unit, strcmp(row->unit, "world") == 0 ? " units" : "");
    if (row->otherwise) fprintf(file, ", default %s", row->otherwise);
    if (row->flags & SPEC_REQUIRED) fprintf(file, row->shapes ? ", required for its shape" : ", required");
    if (row->rank != OPTION_BASIC) fprintf(file, ", %s", option_rank_name(row->rank));
    fprintf(file, ")");
}

/* Whether the row is the member or one of its members. */
static bool belongs_to(const spec_row *row, const char *member)
{
    bool whole = *member == '/';
    size_t length = strlen(member);
    for (const char *at = row->pointer; *at && (!whole || at == row->pointer); at++) {
        const char *name = whole ? at : at + 1;
        if (*at == '/' && strncmp(name, member, length) == 0 && (!name[length] || name[length] == '/'))
            return true;
    }
    return false;
}

static void print_row(FILE *file, const spec_row *row)
{
    fputs(row->pointer, file);
    print_values(file, row);
    fputs("\n", file);
    if (row->title) fprintf(file, "    %s.\n", row->title);
    help_text_wrap(file, "    ", row->prose);
    fputs("\n", file);
}

size_t spec_print_help(FILE *file, const char *member)
{
    const option_rank last = member ? OPTION_RESEARCH : OPTION_BASIC;
    const bool all = !member || strcmp(member, SPEC_HELP_ALL) == 0;
    size_t printed = 0;
    for (option_rank rank = OPTION_BASIC; rank <= last; rank++)
        for (size_t i = 0; i < spec_row_count; i++) {
            if (spec_rows[i].rank != rank || (!all && !belongs_to(&spec_rows[i], member))) continue;
            print_row(file, &spec_rows[i]);
            printed++;
        }
    return printed;
}

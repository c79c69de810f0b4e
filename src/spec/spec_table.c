/* The table is one array on purpose, so this file may grow past the length of others. */
#include "spec/spec_table.h"

#include <stdio.h>
#include <string.h>

/* Coordinates and lengths stay where their cubes are far from the limits of a double. */
#define WORLD_MAX 1e12

/* The field's derivatives and their squares stay finite. */
#define COEFFICIENT_MAX 1e30

#define AT(member) .offset = offsetof(spec, member), .has = SPEC_NOWHERE
#define AT_HAS(member, flag) .offset = offsetof(spec, member), .has = offsetof(spec, flag)
#define UNSTORED .offset = SPEC_NOWHERE, .has = SPEC_NOWHERE
#define LATER(where, choose, words_)                                                               \
    {                                                                                              \
        .pointer = where, .type = SPEC_TYPE_LATER, .choice = choose, UNSTORED, .prose = words_     \
    }
#define GROUP(where, flags_, words_)                                                               \
    {                                                                                              \
        .pointer = where, .type = SPEC_TYPE_GROUP, .flags = flags_, UNSTORED, .prose = words_      \
    }
#define SHAPE(s) (1u << SPEC_SHAPE_##s)
#define METHOD(m) (1u << SPEC_METHOD_##m)
/* The methods of the paper, of 2005. */
#define MEYER (METHOD(SIZED) | METHOD(PAPER))

const spec_row spec_rows[] = {
    {.pointer = "/version",
     .type = SPEC_TYPE_INTEGER,
     .flags = SPEC_REQUIRED,
     .low = 1,
     .high = 1,
     UNSTORED,
     .prose = "The version of this contract."},
    {.pointer = "/name",
     .type = SPEC_TYPE_STRING,
     .low = 0,
     .high = 200,
     AT(name),
     .prose = "A name for people."},

    GROUP("/surface", SPEC_REQUIRED, "The surface to sample: exactly one of its members."),
    {.pointer = "/surface/vdb",
     .type = SPEC_TYPE_GROUP,
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     UNSTORED,
     .prose = "A scalar grid of an OpenVDB file, at its isovalue."},
    {.pointer = "/surface/vdb/path",
     .type = SPEC_TYPE_STRING,
     .flags = SPEC_REQUIRED,
     .low = 1,
     .high = 4096,
     AT(surface.vdb.path),
     .prose = "The file; below one of the service's input roots."},
    {.pointer = "/surface/vdb/grid",
     .type = SPEC_TYPE_STRING,
     .low = 0,
     .high = 1000,
     AT(surface.vdb.grid),
     .prose = "The grid's name, \"name[1]\" among equals. May be absent when the file has just one "
              "scalar grid."},
    {.pointer = "/surface/vdb/isovalue",
     .type = SPEC_TYPE_NUMBER,
     .low = -1e30,
     .high = 1e30,
     AT_HAS(surface.vdb.isovalue, surface.vdb.has_isovalue),
     .unit = "the grid's",
     .prose = "The value on the surface. Level sets have 0 without it; fog volumes need it."},
    {.pointer = "/surface/vdb/reconstruction",
     .type = SPEC_TYPE_WORD,
     .words = "interpolating|smoothing",
     .otherwise = "\"interpolating\"",
     AT(surface.vdb.reconstruction),
     .prose = "interpolating: the spline passes through the samples; smoothing: it takes them as "
              "its coefficients, "
              "which blurs noise and moves the surface slightly."},

    {.pointer = "/surface/mesh",
     .type = SPEC_TYPE_GROUP,
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     UNSTORED,
     .prose = "A closed triangle mesh, turned into a level set of exact distances."},
    {.pointer = "/surface/mesh/path",
     .type = SPEC_TYPE_STRING,
     .flags = SPEC_REQUIRED,
     .low = 1,
     .high = 4096,
     AT(surface.mesh.path),
     .prose = "The file, PLY, OBJ, STL, OFF or another format that assimp reads; below one of the "
              "service's input roots. Other files that it names are not read."},
    {.pointer = "/surface/mesh/voxel_size",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .choice = SPEC_CHOICE_VOXELS,
     .low = 0,
     .high = WORLD_MAX,
     AT(surface.mesh.voxel_size),
     .unit = "world",
     .prose = "Size of the level set's voxels, between 1/8191 and 1/8 of the longest side of the "
              "mesh's box. Not beside resolution."},
    {.pointer = "/surface/mesh/resolution",
     .type = SPEC_TYPE_INTEGER,
     .choice = SPEC_CHOICE_VOXELS,
     .low = 8,
     .high = 8191,
     .otherwise = "256",
     AT(surface.mesh.resolution),
     .unit = "voxels",
     .prose = "Voxels along the longest side of the mesh's box; the default where no voxel_size is given. "
              "At 256 nine tenths and more of a scanned mesh lie within 0.05 voxel of the surface that is "
              "sampled, all but creases; 512 takes three times the memory and time to bring in a third of "
              "the rest."},
    {.pointer = "/surface/mesh/band_vox",
     .type = SPEC_TYPE_INTEGER,
     .low = 3,
     .high = 32,
     .otherwise = "4",
     AT(surface.mesh.band_vox),
     .unit = "voxels",
     .prose = "Half-width of the band of distances around the mesh. Particles use four voxels on either "
              "side of the surface; three give the same surface, more take time only."},

    {.pointer = "/surface/analytic",
     .type = SPEC_TYPE_GROUP,
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     UNSTORED,
     .prose = "A surface given by a formula."},
    {.pointer = "/surface/analytic/shape",
     .type = SPEC_TYPE_WORD,
     .flags = SPEC_REQUIRED,
     .words = "sphere|torus|box|ellipsoid|quartic|gyroid",
     AT(surface.analytic.shape),
     .prose = "Which formula."},
    {.pointer = "/surface/analytic/center",
     .type = SPEC_TYPE_VECTOR,
     .low = -WORLD_MAX,
     .high = WORLD_MAX,
     .otherwise = "[0.5,0.5,0.5]",
     .shapes = SHAPE(SPHERE) | SHAPE(TORUS) | SHAPE(BOX) | SHAPE(ELLIPSOID) | SHAPE(QUARTIC) | SHAPE(GYROID),
     AT(surface.analytic.center),
     .unit = "world",
     .prose = "Every shape: its centre."},
    {.pointer = "/surface/analytic/radius",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_REQUIRED | SPEC_LOW_OPEN,
     .low = 0,
     .high = WORLD_MAX,
     .shapes = SHAPE(SPHERE),
     AT(surface.analytic.radius),
     .unit = "world",
     .prose = "sphere: its radius."},
    {.pointer = "/surface/analytic/axis",
     .type = SPEC_TYPE_VECTOR,
     .low = -WORLD_MAX,
     .high = WORLD_MAX,
     .otherwise = "[0,0,1]",
     .shapes = SHAPE(TORUS),
     AT(surface.analytic.axis),
     .prose = "torus: direction of its axis of rotation; not zero, of any length."},
    {.pointer = "/surface/analytic/major_radius",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_REQUIRED | SPEC_LOW_OPEN,
     .low = 0,
     .high = WORLD_MAX,
     .shapes = SHAPE(TORUS),
     AT(surface.analytic.major_radius),
     .unit = "world",
     .prose = "torus: from the centre to the middle of the tube."},
    {.pointer = "/surface/analytic/minor_radius",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_REQUIRED | SPEC_LOW_OPEN,
     .low = 0,
     .high = WORLD_MAX,
     .shapes = SHAPE(TORUS),
     AT(surface.analytic.minor_radius),
     .unit = "world",
     .prose = "torus: radius of the tube, less than major_radius."},
    {.pointer = "/surface/analytic/half_size",
     .type = SPEC_TYPE_VECTOR,
     .flags = SPEC_REQUIRED | SPEC_LOW_OPEN,
     .low = 0,
     .high = WORLD_MAX,
     .shapes = SHAPE(BOX),
     AT(surface.analytic.half_size),
     .unit = "world",
     .prose = "box: half of each side, rounding included."},
    {.pointer = "/surface/analytic/rounding",
     .type = SPEC_TYPE_NUMBER,
     .low = 0,
     .high = WORLD_MAX,
     .otherwise = "0",
     .shapes = SHAPE(BOX),
     AT(surface.analytic.rounding),
     .unit = "world",
     .prose = "box: radius of its edges and corners, at most the smallest half size."},
    {.pointer = "/surface/analytic/radii",
     .type = SPEC_TYPE_VECTOR,
     .flags = SPEC_REQUIRED | SPEC_LOW_OPEN,
     .low = 0,
     .high = WORLD_MAX,
     .shapes = SHAPE(ELLIPSOID),
     AT(surface.analytic.radii),
     .unit = "world",
     .prose = "ellipsoid: half of each axis."},
    {.pointer = "/surface/analytic/r",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = WORLD_MAX,
     .otherwise = "0.13",
     .shapes = SHAPE(QUARTIC),
     AT(surface.analytic.r),
     .unit = "world",
     .prose = "quartic: r of equation (15)."},
    {.pointer = "/surface/analytic/size",
     .type = SPEC_TYPE_VECTOR,
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = WORLD_MAX,
     .otherwise = "[1,1,1]",
     .shapes = SHAPE(GYROID),
     AT(surface.analytic.size),
     .unit = "world",
     .prose = "gyroid: sides of the box that cuts it."},
    {.pointer = "/surface/analytic/period",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_REQUIRED | SPEC_LOW_OPEN,
     .low = 0,
     .high = WORLD_MAX,
     .shapes = SHAPE(GYROID),
     AT(surface.analytic.period),
     .unit = "world",
     .prose = "gyroid: length of one period."},

    {.pointer = "/surface/bspline",
     .type = SPEC_TYPE_GROUP,
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     UNSTORED,
     .prose = "The zero set of a uniform cubic B-spline, by its coefficients; negative is inside. Along "
              "an axis with n coefficients the domain is n - 3 knot intervals of equal length w, and "
              "coefficient i, from 0, belongs to the basis function centred on min + (i - 1) w: the "
              "first and the last stand one interval outside of the domain."},
    {.pointer = "/surface/bspline/dims",
     .type = SPEC_TYPE_TRIPLE,
     .flags = SPEC_REQUIRED,
     .low = 4,
     .high = 4096,
     AT(surface.bspline.dims),
     .prose = "Number of coefficients along x, y and z."},
    GROUP("/surface/bspline/domain", 0, "The box that the spline is defined in."),
    {.pointer = "/surface/bspline/domain/min",
     .type = SPEC_TYPE_VECTOR,
     .low = -WORLD_MAX,
     .high = WORLD_MAX,
     .otherwise = "[0,0,0]",
     AT(surface.bspline.domain.min),
     .unit = "world",
     .prose = "Its lowest corner."},
    {.pointer = "/surface/bspline/domain/max",
     .type = SPEC_TYPE_VECTOR,
     .low = -WORLD_MAX,
     .high = WORLD_MAX,
     .otherwise = "[1,1,1]",
     AT(surface.bspline.domain.max),
     .unit = "world",
     .prose = "Its highest corner, above the lowest in every axis."},
    {.pointer = "/surface/bspline/coefficients",
     .type = SPEC_TYPE_NUMBERS,
     .choice = SPEC_CHOICE_COEFFICIENTS,
     .low = -COEFFICIENT_MAX,
     .high = COEFFICIENT_MAX,
     AT_HAS(surface.bspline.coefficients, surface.bspline.coefficient_count),
     .prose = "The coefficients, x fastest, then y: as many as the product of dims."},
    {.pointer = "/surface/bspline/path",
     .type = SPEC_TYPE_STRING,
     .choice = SPEC_CHOICE_COEFFICIENTS,
     .low = 1,
     .high = 4096,
     AT(surface.bspline.path),
     .prose = "A file with the coefficients in the same order and nothing else: little-endian floats of "
              "32 or of 64 bits, told apart by the file's size; below one of the service's input roots."},

    {.pointer = "/surface/volume",
     .type = SPEC_TYPE_GROUP,
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     UNSTORED,
     .prose = "A dense volume of a file, at its isovalue; inside is above it. World space is the file's own: "
              "NRRD as its space says (left-posterior-superior stays that), NIfTI right-anterior-superior."},
    {.pointer = "/surface/volume/path",
     .type = SPEC_TYPE_STRING,
     .flags = SPEC_REQUIRED,
     .low = 1,
     .high = 4096,
     AT(surface.volume.path),
     .prose = "The file, NRRD (data attached or in files beside it; raw, gzip or ascii), NIfTI-1 or NIfTI-2; "
              "below one of the service's input roots, like the files that it names."},
    {.pointer = "/surface/volume/isovalue",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_REQUIRED,
     .low = -1e30,
     .high = 1e30,
     AT(surface.volume.isovalue),
     .unit = "the volume's",
     .prose = "The value on the surface. Where the surface meets the end of the data it is open."},
    {.pointer = "/surface/volume/reconstruction",
     .type = SPEC_TYPE_WORD,
     .words = "interpolating|smoothing",
     .otherwise = "\"interpolating\"",
     AT(surface.volume.reconstruction),
     .prose = "As in /surface/vdb."},

    {.pointer = "/surface/exr",
     .type = SPEC_TYPE_GROUP,
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     UNSTORED,
     .prose =
         "A stack of OpenEXR images as a dense volume, at its isovalue; inside is above it. Pixel (x, y) of "
         "the k-th slice, from 0, lies at origin + voxel_size (x, y, k): rows count downwards in the "
         "picture, "
         "and pixels have the numbers of the data window, wherever the display window is. The volume is what "
         "the slices' data windows span; a pixel outside of its slice's is 0. Of tiled files with levels the "
         "full one is read; deep images are refused."},
    {.pointer = "/surface/exr/path",
     .type = SPEC_TYPE_STRING,
     .flags = SPEC_REQUIRED,
     .low = 1,
     .high = 4096,
     AT(surface.exr.path),
     .prose =
         "The files, with #### (as many digits, at least) or %04d for the slice's number; below one of the "
         "service's input roots."},
    {.pointer = "/surface/exr/slices",
     .type = SPEC_TYPE_STRING,
     .flags = SPEC_REQUIRED,
     .low = 3,
     .high = 64,
     AT(surface.exr.slices),
     .prose = "Which slices, \"1-93\", or every second one, \"1-93x2\"; at least two, at most 65536."},
    {.pointer = "/surface/exr/part",
     .type = SPEC_TYPE_STRING,
     .low = 0,
     .high = 1000,
     AT(surface.exr.part),
     .prose = "The name of the part. May be absent when just one part has the channel."},
    {.pointer = "/surface/exr/channel",
     .type = SPEC_TYPE_STRING,
     .low = 1,
     .high = 1000,
     AT(surface.exr.channel),
     .prose =
         "The name of the channel, with its layer, \"density\" or \"fog.Y\". May be absent when there is "
         "just one."},
    {.pointer = "/surface/exr/voxel_size",
     .type = SPEC_TYPE_VECTOR,
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = WORLD_MAX,
     .otherwise = "[1,1,1]",
     AT(surface.exr.voxel_size),
     .unit = "world",
     .prose = "Distance between columns, rows and slices."},
    {.pointer = "/surface/exr/origin",
     .type = SPEC_TYPE_VECTOR,
     .low = -WORLD_MAX,
     .high = WORLD_MAX,
     .otherwise = "[0,0,0]",
     AT(surface.exr.origin),
     .unit = "world",
     .prose = "Where pixel (0, 0) of the first slice lies."},
    {.pointer = "/surface/exr/isovalue",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_REQUIRED,
     .low = -1e30,
     .high = 1e30,
     AT(surface.exr.isovalue),
     .unit = "the channel's",
     .prose = "The value on the surface. Where the surface meets the end of the data it is open."},
    {.pointer = "/surface/exr/reconstruction",
     .type = SPEC_TYPE_WORD,
     .words = "interpolating|smoothing",
     .otherwise = "\"interpolating\"",
     AT(surface.exr.reconstruction),
     .prose = "As in /surface/vdb."},
    {.pointer = "/surface/union",
     .type = SPEC_TYPE_SURFACES,
     .choice = SPEC_CHOICE_SURFACE,
     .low = 2,
     .high = 64,
     UNSTORED,
     .prose = "What is in any of the solids. Members are surfaces, combined ones too. Where two meet the "
              "surface has a "
              "sharp edge."},
    {.pointer = "/surface/intersection",
     .type = SPEC_TYPE_SURFACES,
     .choice = SPEC_CHOICE_SURFACE,
     .low = 2,
     .high = 64,
     UNSTORED,
     .prose = "What is in all of the solids."},
    {.pointer = "/surface/difference",
     .type = SPEC_TYPE_SURFACES,
     .choice = SPEC_CHOICE_SURFACE,
     .low = 2,
     .high = 64,
     UNSTORED,
     .prose = "What is in the first solid and in none of the others."},
    {.pointer = "/surface/offset",
     .type = SPEC_TYPE_GROUP,
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     UNSTORED,
     .prose =
         "A surface at a distance. Of spheres, tori, boxes, level sets and meshes, and of combinations of "
         "them and "
         "transforms that keep angles: their distances are moved, so that edges of a combination stay sharp. "
         "The "
         "band of a level set must be wide enough. Surfaces without distances, fogs for one, are refused."},
    {.pointer = "/surface/offset/surface",
     .type = SPEC_TYPE_SURFACE,
     .flags = SPEC_REQUIRED,
     UNSTORED,
     .prose = "Which surface."},
    {.pointer = "/surface/offset/distance",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_REQUIRED,
     .low = -WORLD_MAX,
     .high = WORLD_MAX,
     AT(surface.distance),
     .unit = "world",
     .prose = "Outwards; negative: inwards."},
    {.pointer = "/surface/transform",
     .type = SPEC_TYPE_GROUP,
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_SURFACE,
     UNSTORED,
     .prose = "A surface moved, turned, mirrored, scaled or sheared by a matrix. One that is open may only "
              "change its "
              "axes' order, signs and scales, since rims lie along the world's axes."},
    {.pointer = "/surface/transform/surface",
     .type = SPEC_TYPE_SURFACE,
     .flags = SPEC_REQUIRED,
     UNSTORED,
     .prose = "Which surface."},
    {.pointer = "/surface/transform/matrix",
     .type = SPEC_TYPE_NUMBERS,
     .flags = SPEC_REQUIRED,
     .low = -WORLD_MAX,
     .high = WORLD_MAX,
     AT_HAS(surface.matrix, surface.matrix_count),
     .prose = "16 numbers, row by row, for column vectors: the last row is 0, 0, 0, 1. Invertible."},

    {.pointer = "/region",
     .type = SPEC_TYPE_GROUP,
     .flags = SPEC_OPTIONAL,
     .offset = SPEC_NOWHERE,
     .has = offsetof(spec, has_region),
     .prose = "Only the surface inside this box. Where the box cuts the surface it is open and points lie "
              "along the cut. Curvature is made free of scale by the box of the whole surface all the same."},
    {.pointer = "/region/min",
     .type = SPEC_TYPE_VECTOR,
     .flags = SPEC_REQUIRED,
     .low = -WORLD_MAX,
     .high = WORLD_MAX,
     AT(region.min),
     .unit = "world",
     .prose = "Its lowest corner."},
    {.pointer = "/region/max",
     .type = SPEC_TYPE_VECTOR,
     .flags = SPEC_REQUIRED,
     .low = -WORLD_MAX,
     .high = WORLD_MAX,
     AT(region.max),
     .unit = "world",
     .prose = "Its highest corner, above the lowest in every axis."},

    GROUP("/sampling", SPEC_REQUIRED,
          "How many points: exactly one target (count, spacing, density, control or time_s), and at most one "
          "grading (alpha, curvature or grid)."),
    {.pointer = "/sampling/count",
     .type = SPEC_TYPE_LARGE,
     .choice = SPEC_CHOICE_TARGET,
     .low = 4,
     .high = 1e8,
     AT(count),
     .unit = "points",
     .prose = "Exactly this many points."},
    {.pointer = "/sampling/spacing",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .choice = SPEC_CHOICE_TARGET,
     .low = 0,
     .high = WORLD_MAX,
     AT(spacing),
     .unit = "world",
     .prose = "As many points as give this mean distance between neighbours: 2 A / (sqrt(3) spacing^2)."},
    {.pointer = "/sampling/density",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .choice = SPEC_CHOICE_TARGET,
     .low = 0,
     .high = 1e300,
     AT(density),
     .unit = "1/world^2",
     .prose = "As many points per unit of the surface's area."},
    {.pointer = "/sampling/control",
     .type = SPEC_TYPE_GROUP,
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_TARGET,
     .offset = SPEC_NOWHERE,
     .has = offsetof(spec, has_control),
     .prose =
         "Section 6.1: the smallest system that keeps a lower bound on the count and an upper bound on "
         "sigma at the ideal energy. paper: by insertion and deletion between rounds, from min_count on; "
         "sized: by solving for the count directly, from sigma = sqrt(3) spacing."},
    {.pointer = "/sampling/control/min_count",
     .type = SPEC_TYPE_LARGE,
     .flags = SPEC_REQUIRED,
     .low = 4,
     .high = 1e8,
     AT(control.min_count),
     .unit = "points",
     .prose = "At least this many points."},
    {.pointer = "/sampling/control/max_sigma",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_REQUIRED | SPEC_LOW_OPEN,
     .low = 0,
     .high = WORLD_MAX,
     AT(control.max_sigma),
     .unit = "world",
     .prose = "The support of the potential is at most this: points are inserted until that is enough."},
    {.pointer = "/sampling/control/start_count",
     .type = SPEC_TYPE_LARGE,
     .low = 0,
     .high = 1e8,
     .otherwise = "0",
     AT(control.start_count),
     .unit = "points",
     .prose =
         "How many points paper begins with, at least min_count; 0: min_count. One near the result saves "
         "rounds; of one that is too large points are deleted."},
    {.pointer = "/sampling/control/selection",
     .type = SPEC_TYPE_WORD,
     .words = "biased|random",
     .otherwise = "\"biased\"",
     AT(control.selection),
     .prose =
         "Which points are split or deleted. biased: those of little energy are likelier to split, those of "
         "much to go; random: any. Only paper inserts and deletes."},
    {.pointer = "/sampling/time_s",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .choice = SPEC_CHOICE_TARGET,
     .low = 0,
     .high = 1e6,
     AT(time_s),
     .unit = "s",
     .prose =
         "As many points as the whole job can relax, measure and write in this time on the machine that runs "
         "it, found by runs of ever more points. Not the same bytes twice, and never cached. Fails with "
         "limit_time where not even 200 points fit."},
    {.pointer = "/sampling/alpha",
     .type = SPEC_TYPE_GROUP,
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_GRADING,
     .offset = SPEC_NOWHERE,
     .has = offsetof(spec, has_alpha),
     .prose = "Grading by curvature, equations (13) and (14): alpha = gamma + 1 / (kappa^d + nu), "
              "with kappa made free "
              "of scale by the longest side of the surface's box."},
    {.pointer = "/sampling/alpha/d",
     .type = SPEC_TYPE_NUMBER,
     .low = 0,
     .high = 16,
     .otherwise = "2",
     AT(alpha.d),
     .prose = "Exponent: larger follows the curvature more strongly, below 1 more softly."},
    {.pointer = "/sampling/alpha/gamma",
     .type = SPEC_TYPE_NUMBER,
     .low = 0,
     .high = 1000,
     .otherwise = "0.1",
     AT(alpha.gamma),
     .prose = "Lower bound of alpha, reached where the curvature is strong."},
    {.pointer = "/sampling/alpha/nu",
     .type = SPEC_TYPE_NUMBER,
     .low = 0.001,
     .high = 1000,
     .otherwise = "0.75",
     AT(alpha.nu),
     .prose = "1/nu + gamma is alpha where the surface is flat."},
    {.pointer = "/sampling/alpha/kappa_max",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 1e6,
     .otherwise = "20",
     AT(alpha.kappa_max),
     .prose = "Larger values of the scale-free curvature count as this one."},
    {.pointer = "/sampling/curvature",
     .type = SPEC_TYPE_GROUP,
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_GRADING,
     .offset = SPEC_NOWHERE,
     .has = offsetof(spec, has_curvature),
     .prose = "Spacing by curvature: finer where the surface bends. The request is scaled until it asks for "
              "as many "
              "points as the target."},
    {.pointer = "/sampling/curvature/chord_error",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .choice = SPEC_CHOICE_CURVATURE,
     .low = 0,
     .high = WORLD_MAX,
     AT(curvature.chord_error),
     .unit = "world",
     .prose = "Spacing sqrt(8 chord_error / max(|kappa1|, |kappa2|)): the chord between neighbours is that "
              "far off the "
              "surface. The report says which error the count reaches."},
    {.pointer = "/sampling/curvature/ratio",
     .type = SPEC_TYPE_NUMBER,
     .choice = SPEC_CHOICE_CURVATURE,
     .low = 1,
     .high = 1000,
     AT(curvature.ratio),
     .prose = "Spacing proportional to kappa^-exponent, the largest this many times the least; the least is "
              "where a "
              "hundredth of the area bends more."},
    {.pointer = "/sampling/curvature/exponent",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 100,
     .otherwise = "1",
     AT(curvature.exponent),
     .prose = "How strongly the spacing follows the curvature, with ratio."},
    {.pointer = "/sampling/grid",
     .type = SPEC_TYPE_GROUP,
     .flags = SPEC_OPTIONAL,
     .choice = SPEC_CHOICE_GRADING,
     .offset = SPEC_NOWHERE,
     .has = offsetof(spec, has_grid),
     .prose = "Spacing from a second scalar grid of the surface's VDB file, a painted map. The request is "
              "scaled until "
              "it asks for as many points as the target."},
    {.pointer = "/sampling/grid/name",
     .type = SPEC_TYPE_STRING,
     .flags = SPEC_REQUIRED,
     .low = 1,
     .high = 1024,
     AT(grid.name),
     .prose = "Its name; \"name[1]\" among equals."},
    {.pointer = "/sampling/grid/kind",
     .type = SPEC_TYPE_WORD,
     .words = "spacing|density",
     .otherwise = "\"spacing\"",
     AT(grid.kind),
     .prose = "spacing: the distance between neighbours. density: points per unit of area; 0 asks for none, "
              "but for what "
              "the bounds require."},
    {.pointer = "/sampling/min_spacing",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = WORLD_MAX,
     AT(min_spacing),
     .unit = "world",
     .prose = "Least spacing of a grading (curvature or grid)."},
    {.pointer = "/sampling/max_spacing",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = WORLD_MAX,
     AT(max_spacing),
     .unit = "world",
     .prose = "Largest spacing of a grading (curvature or grid)."},
    {.pointer = "/sampling/gradation",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 10,
     .otherwise = "0.2",
     AT(gradation),
     .prose = "By how much the spacing of a grading may grow per unit of distance along the surface."},

    GROUP("/solver", 0, "How the points are found."),
    {.pointer = "/solver/method",
     .type = SPEC_TYPE_WORD,
     .words = "sized|paper|witkin-heckbert",
     .otherwise = "\"sized\"",
     AT(method),
     .prose =
         "paper: the particle system of Meyer, Georgel and Whitaker (2005). sized: the same, from a "
         "coarse packing to ever finer ones, which leaves fewer defects in less time. The default with "
         "sampling.alpha is paper, to which it belongs. witkin-heckbert: the method that the paper compares "
         "itself with, for comparison; it has a Gaussian energy of its own, splits and deletes points at any "
         "time and does not come to the count that is asked for."},
    {.pointer = "/solver/energy",
     .type = SPEC_TYPE_WORD,
     .words = "cotangent|gaussian|electrostatic",
     .otherwise = "\"cotangent\"",
     .methods = MEYER,
     AT(energy),
     .prose =
         "cotangent: equations (6) and (7). gaussian and electrostatic: for comparison, see section 4; the "
         "Gaussian's deviation is a third of the support, the electrostatic one is truncated at it."},
    {.pointer = "/solver/minimiser",
     .type = SPEC_TYPE_WORD,
     .words = "lm|gradient",
     .otherwise = "\"lm\"",
     .methods = MEYER,
     AT(minimiser),
     .prose = "lm: Levenberg-Marquardt with a lambda per particle, section 5. gradient: steepest descent (5) "
              "with a "
              "fixed step, as for Table 1."},
    {.pointer = "/solver/step",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 10,
     .otherwise = "0.05",
     .methods = MEYER,
     AT(step),
     .unit = "sigma^2",
     .prose = "Step of the gradient minimiser: times the force, in units of sigma^2. Above about 0.2 the "
              "cotangent "
              "overshoots. Only with gradient."},
    {.pointer = "/solver/sigma",
     .type = SPEC_TYPE_NUMBER,
     .low = 0,
     .high = WORLD_MAX,
     .otherwise = "0",
     .methods = MEYER,
     AT(sigma),
     .unit = "world",
     .prose = "Initial support of the potential; adapted to the count. 0: from count and area."},
    {.pointer = "/solver/witkin_heckbert",
     .type = SPEC_TYPE_GROUP,
     .methods = METHOD(WITKIN_HECKBERT),
     UNSTORED,
     .prose = "The parameters of the method \"witkin-heckbert\", with the symbols and the defaults of its "
              "paper (1994). "
              "Its target radius, sigma_hat, comes from the sampling target."},
    {.pointer = "/solver/witkin_heckbert/alpha",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 1000,
     .otherwise = "6",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.alpha),
     .prose = "alpha: amplitude of the repulsion, E_ij = alpha exp(-r^2 / (2 sigma_i^2)). Scales the speed."},
    {.pointer = "/solver/witkin_heckbert/e_hat",
     .type = SPEC_TYPE_NUMBER,
     .low = 0.01,
     .high = 10,
     .otherwise = "0.8",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.e_hat),
     .prose = "E_hat over alpha: the energy that a particle wants. More is denser: at 0.8 neighbours are "
              "two sigma apart."},
    {.pointer = "/solver/witkin_heckbert/rho",
     .type = SPEC_TYPE_NUMBER,
     .low = 0,
     .high = 1000,
     .otherwise = "15",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.rho),
     .prose = "rho: how fast a particle's radius follows its energy, dD/dt = -rho (D - E_hat)."},
    {.pointer = "/solver/witkin_heckbert/phi",
     .type = SPEC_TYPE_NUMBER,
     .low = 0,
     .high = 1000,
     .otherwise = "15",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.phi),
     .prose = "phi: how fast a particle returns to the surface, dF/dt = -phi F, the feedback term of (2)."},
    {.pointer = "/solver/witkin_heckbert/beta",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 1000,
     .otherwise = "10",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.beta),
     .prose = "beta: keeps the rate of a radius finite where there are no neighbours. In units of 1 / "
              "sigma_i, where the paper of 1994 has 1 / length."},
    {.pointer = "/solver/witkin_heckbert/dt",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 1,
     .otherwise = "0.03",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.dt),
     .unit = "time",
     .prose = "Delta t: time step of Euler's method; with the other defaults it is unstable above about "
              "0.07."},
    {.pointer = "/solver/witkin_heckbert/gamma",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 1e6,
     .otherwise = "4",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.gamma),
     .prose = "gamma: a particle slower than gamma sigma_i is near its equilibrium, and may split or die."},
    {.pointer = "/solver/witkin_heckbert/nu",
     .type = SPEC_TYPE_NUMBER,
     .low = 0,
     .high = 10,
     .otherwise = "0.2",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.nu),
     .prose = "nu: a particle whose radius is above its target splits when its energy is above nu E_hat."},
    {.pointer = "/solver/witkin_heckbert/delta",
     .type = SPEC_TYPE_NUMBER,
     .low = 0,
     .high = 0.99,
     .otherwise = "0.7",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.delta),
     .prose = "delta: a particle may die when its radius is below delta times its target, the likelier the "
              "smaller."},
    {.pointer = "/solver/witkin_heckbert/sigma_max",
     .type = SPEC_TYPE_NUMBER,
     .low = 0,
     .high = WORLD_MAX,
     .otherwise = "0",
     .methods = METHOD(WITKIN_HECKBERT),
     AT(witkin_heckbert.sigma_max),
     .unit = "world",
     .prose = "sigma_max: a particle with a larger radius splits in any case. 0: the larger of half of the "
              "surface's longest side and 1.5 target radii."},
    {.pointer = "/solver/init",
     .type = SPEC_TYPE_WORD,
     .words = "surface|random",
     .otherwise = "\"surface\"",
     AT(init),
     .prose = "surface: spread over the surface by area; random: uniform in the domain or, for "
              "volumes, in the voxels "
              "that the surface crosses."},
    {.pointer = "/solver/seed",
     .type = SPEC_TYPE_LARGE,
     .low = 0,
     .high = 9007199254740992.0,
     .otherwise = "0",
     AT(seed),
     .prose = "Seed of the random numbers: the same spec, seed and build give the same bytes."},
    {.pointer = "/solver/threads",
     .type = SPEC_TYPE_INTEGER,
     .low = 0,
     .high = 1024,
     .otherwise = "0",
     AT(threads),
     .prose = "Threads; 0: the worker's share. The result does not depend on it."},
    {.pointer = "/solver/isa",
     .type = SPEC_TYPE_WORD,
     .words = "auto|portable|avx2|avx512",
     .otherwise = "\"auto\"",
     AT(isa),
     .prose =
         "Instruction set of the numerical kernels; auto: the best that the machine has. The result does not "
         "depend on it."},
    {.pointer = "/solver/max_sweeps",
     .type = SPEC_TYPE_INTEGER,
     .low = 1,
     .high = 1e6,
     .otherwise = "5000",
     AT(max_sweeps),
     .unit = "sweeps",
     .prose = "The solve ends after so many sweeps, converged or not."},
    {.pointer = "/solver/step_tolerance",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 1,
     .otherwise = "0.003",
     AT(step_tolerance),
     .unit = "spacings",
     .prose =
         "Converged needs an rms step below this (witkin-heckbert: the rms of what a unit of time would "
         "bring). "
         "What still moves at 0.003 are a few defects: a third of that takes twice the sweeps and changes no "
         "measure of quality by more than seeds do."},
    {.pointer = "/solver/energy_tolerance",
     .type = SPEC_TYPE_NUMBER,
     .flags = SPEC_LOW_OPEN,
     .low = 0,
     .high = 10,
     .otherwise = "0.05",
     AT(energy_tolerance),
     .prose = "Converged needs |E / E_ideal - 1| below this. 0.05 admits the defects that a closed "
              "surface must have and "
              "an area known to 1 % (which is 2.3 % of E), but no packing that is still disordered."},

    GROUP("/output", 0, "What is written."),
    GROUP("/output/ply", 0, "points.ply"),
    {.pointer = "/output/ply/format",
     .type = SPEC_TYPE_WORD,
     .words = "binary_little_endian|ascii",
     .otherwise = "\"binary_little_endian\"",
     AT(ply_format),
     .prose = "Encoding of the PLY file."},
    {.pointer = "/output/ply/precision",
     .type = SPEC_TYPE_WORD,
     .words = "float|double",
     .otherwise = "\"float\"",
     AT(ply_precision),
     .prose = "Type of every property of the PLY file."},
    {.pointer = "/output/preview",
     .type = SPEC_TYPE_GROUP,
     .flags = SPEC_SWITCH,
     .offset = SPEC_NOWHERE,
     .has = offsetof(spec, has_preview),
     .prose = "preview.png and preview.exr; false for none."},
    {.pointer = "/output/preview/size",
     .type = SPEC_TYPE_SIZE,
     .low = 64,
     .high = 8192,
     .otherwise = "[512,512]",
     AT(preview_width),
     .unit = "pixels",
     .prose = "Side of a square picture, or [width, height]."},
    {.pointer = "/output/preview/color",
     .type = SPEC_TYPE_WORD,
     .words = "alpha|curvature",
     AT(preview_color),
     .prose = "What the colours show. Default: alpha where sampling.alpha is given, else curvature."},
    LATER("/output/preview/camera", SPEC_CHOICE_NONE, "Where the picture is taken from."),
    LATER("/output/preview/turntable", SPEC_CHOICE_NONE, "A sequence of pictures around the surface."),
    LATER("/output/points_vdb", SPEC_CHOICE_NONE, "The points as a VDB points grid."),
    LATER("/output/mesh", SPEC_CHOICE_NONE, "A triangle mesh of the points."),
    {.pointer = "/output/directory",
     .type = SPEC_TYPE_STRING,
     .low = 1,
     .high = 4096,
     AT(directory),
     .prose = "Where the service puts a copy of the results: an absolute path below one of its output roots, made when"
              " missing; files of the same names are replaced. Of a sequence #### or %04d is the frame's number."},

    GROUP("/limits", 0, "What the job may use; 0: the default of whoever runs it."),
    {.pointer = "/limits/memory_mb",
     .type = SPEC_TYPE_LARGE,
     .low = 0,
     .high = 1 << 24,
     .otherwise = "0",
     AT(memory_mb),
     .unit = "MiB",
     .prose = "Memory of the worker."},
    {.pointer = "/limits/timeout_s",
     .type = SPEC_TYPE_NUMBER,
     .low = 0,
     .high = 1e7,
     .otherwise = "0",
     AT(timeout_s),
     .unit = "s",
     .prose = "Time of one attempt."},
    {.pointer = "/limits/stall_s",
     .type = SPEC_TYPE_NUMBER,
     .low = 0,
     .high = 1e7,
     .otherwise = "0",
     AT(stall_s),
     .unit = "s",
     .prose = "Time without progress after which an attempt is ended."},
    {.pointer = "/limits/max_attempts",
     .type = SPEC_TYPE_INTEGER,
     .low = 0,
     .high = 100,
     .otherwise = "0",
     AT(max_attempts),
     .unit = "attempts",
     .prose = "How often the job is tried when a worker dies."},

    GROUP("/queue", 0, "The job's place in the queue."),
    {.pointer = "/queue/priority",
     .type = SPEC_TYPE_INTEGER,
     .low = -1000,
     .high = 1000,
     .otherwise = "0",
     AT(priority),
     .prose = "Higher runs first."},
    {.pointer = "/queue/labels",
     .type = SPEC_TYPE_LABELS,
     .low = 0,
     .high = 32,
     .otherwise = "[]",
     AT_HAS(labels, label_count),
     .prose = "Words to find the job by, each of 1 to 100 characters."},
    {.pointer = "/queue/depends_on",
     .type = SPEC_TYPE_LABELS,
     .low = 0,
     .high = 1000,
     .otherwise = "[]",
     AT_HAS(depends_on, depends_on_count),
     .prose = "Identifiers of jobs that must have succeeded before; when one of them does not, this one fails."},
    {.pointer = "/queue/frames",
     .type = SPEC_TYPE_STRING,
     .low = 1,
     .high = 1000,
     AT(frames),
     .prose = "One task per frame: \"1-100\", \"1-100x2\", \"1-10,20\". The first #### or %04d in each path of an input"
              " is the frame's number."},
    LATER("/queue/coherent", SPEC_CHOICE_NONE, "Points that keep their identity over frames."),
    {.pointer = "/queue/retention_s",
     .type = SPEC_TYPE_LARGE,
     .low = 0,
     .high = 1e10,
     .otherwise = "0",
     AT(retention_s),
     .unit = "s",
     .prose = "How long the job and its results are kept after its end. 0: as the service has it."},
    LATER("/queue/webhook", SPEC_CHOICE_NONE, "An address that is told of the end."),
};

const size_t spec_row_count = sizeof spec_rows / sizeof *spec_rows;

const char *spec_row_key(const spec_row *row)
{
    return strrchr(row->pointer, '/') + 1;
}

bool spec_row_is_member(const spec_row *row, const char *group)
{
    size_t n = strlen(group);
    return strncmp(row->pointer, group, n) == 0 && row->pointer + n + 1 == spec_row_key(row);
}

const spec_row *spec_row_find(const char *group, const char *key)
{
    for (size_t i = 0; i < spec_row_count; i++)
        if (spec_row_is_member(&spec_rows[i], group) &&
            strcmp(spec_row_key(&spec_rows[i]), key) == 0)
            return &spec_rows[i];
    return NULL;
}

bool spec_word(const char *list, size_t index, char *out, size_t size)
{
    if (!list) return false;
    for (; index > 0; index--) {
        list = strchr(list, '|');
        if (!list) return false;
        list++;
    }
    snprintf(out, size, "%.*s", (int)strcspn(list, "|"), list);
    return true;
}

static void print_values(FILE *file, const spec_row *row)
{
    static const char *const types[] = {"object",
                                        "number",
                                        "integer",
                                        "integer",
                                        "word",
                                        "string",
                                        "[number x 3]",
                                        "[integer x 3]",
                                        "[number, ...]",
                                        "integer or [integer, integer]",
                                        "object, as /surface",
                                        "[object, as /surface, ...]",
                                        "[string, ...]",
                                        ""};
    fprintf(file, " (%s", types[row->type]);
    if (row->words) {
        fprintf(file, ":");
        char word[64];
        for (size_t i = 0; spec_word(row->words, i, word, sizeof word); i++)
            fprintf(file, " \"%s\"", word);
    } else if (row->type != SPEC_TYPE_GROUP && row->type != SPEC_TYPE_SURFACE) {
        const char *of = row->type == SPEC_TYPE_STRING     ? " characters"
                         : row->type == SPEC_TYPE_LABELS   ? " labels"
                         : row->type == SPEC_TYPE_SURFACES ? " surfaces"
                                                           : "";
        fprintf(file, ", %s %.16g to %.16g%s", row->flags & SPEC_LOW_OPEN ? "above" : "from",
                row->low, row->high, of);
    }
    if (row->unit)
        fprintf(file, ", %s%s", row->unit, strcmp(row->unit, "world") == 0 ? " units" : "");
    if (row->otherwise) fprintf(file, ", default %s", row->otherwise);
    if (row->flags & SPEC_REQUIRED)
        fprintf(file, row->shapes ? ", required for its shape" : ", required");
    fprintf(file, ")");
}

/* The prose, indented and broken at spaces to fit a terminal of 80 columns. */
static void print_prose(FILE *file, const char *prose)
{
    enum { width = 76 };
    while (*prose) {
        size_t n = strlen(prose);
        if (n > width) {
            n = width;
            while (n > 0 && prose[n] != ' ') n--;
            if (n == 0) n = strcspn(prose, " ");
        }
        fprintf(file, "    %.*s\n", (int)n, prose);
        prose += n + (prose[n] == ' ');
    }
}

void spec_print_help(FILE *file)
{
    for (size_t i = 0; i < spec_row_count; i++) {
        const spec_row *row = &spec_rows[i];
        fputs(row->pointer, file);
        if (row->type == SPEC_TYPE_LATER)
            fprintf(file, " (not supported by this version)");
        else
            print_values(file, row);
        fputs("\n", file);
        print_prose(file, row->prose);
        if (row->words_later) {
            char word[64];
            fputs("    Not supported by this version:", file);
            for (size_t k = 0; spec_word(row->words_later, k, word, sizeof word); k++)
                fprintf(file, " \"%s\"", word);
            fputs("\n", file);
        }
        fputs("\n", file);
    }
}

// SPDX-License-Identifier: Apache-2.0
/* spec_words: the words of a spec and their enumerators, one list for each member (see base/core/words.h). */
#ifndef HEXAD_SPEC_SPEC_WORDS_H
#define HEXAD_SPEC_SPEC_WORDS_H

#include "base/core/isa.h"
#include "base/core/words.h"

/* kinds of surface: the members of /surface */
#define SPEC_SURFACE_LIST(ENTRY, prefix)        \
    ENTRY(prefix, VDB, "vdb")                   \
    ENTRY(prefix, ANALYTIC, "analytic")         \
    ENTRY(prefix, BSPLINE, "bspline")           \
    ENTRY(prefix, MESH, "mesh")                 \
    ENTRY(prefix, VOLUME, "volume")             \
    ENTRY(prefix, EXR, "exr")                   \
    ENTRY(prefix, LABELS, "labels")             \
    ENTRY(prefix, UNION, "union")               \
    ENTRY(prefix, INTERSECTION, "intersection") \
    ENTRY(prefix, DIFFERENCE, "difference")     \
    ENTRY(prefix, OFFSET, "offset")             \
    ENTRY(prefix, TRANSFORM, "transform")

typedef enum spec_surface_kind { SPEC_SURFACE_LIST(WORDS_ENUMERATOR, SPEC_SURFACE) } spec_surface_kind;

/* reconstruction, of grids and dense volumes */
#define SPEC_RECONSTRUCTION_LIST(ENTRY, prefix)   \
    ENTRY(prefix, INTERPOLATING, "interpolating") \
    ENTRY(prefix, SMOOTHING, "smoothing")

typedef enum spec_reconstruction {
    SPEC_RECONSTRUCTION_LIST(WORDS_ENUMERATOR, SPEC_RECONSTRUCTION) SPEC_RECONSTRUCTION_COUNT
} spec_reconstruction;

/* /queue/accept: outcomes, from best to worst */
#define SPEC_OUTCOME_LIST(ENTRY, prefix)    \
    ENTRY(prefix, CONVERGED, "converged")   \
    ENTRY(prefix, UNRESOLVED, "unresolved") \
    ENTRY(prefix, NOT_CONVERGED, "not_converged")

typedef enum spec_outcome { SPEC_OUTCOME_LIST(WORDS_ENUMERATOR, SPEC_OUTCOME) } spec_outcome;

/* /surface/mesh/holes */
#define SPEC_HOLES_LIST(ENTRY, prefix) \
    ENTRY(prefix, KEEP, "keep")        \
    ENTRY(prefix, FILL, "fill")

typedef enum spec_holes { SPEC_HOLES_LIST(WORDS_ENUMERATOR, SPEC_HOLES) SPEC_HOLES_COUNT } spec_holes;

/* /surface/mesh/interior */
#define SPEC_INTERIOR_LIST(ENTRY, prefix) \
    ENTRY(prefix, AUTO, "auto")           \
    ENTRY(prefix, KEEP, "keep")           \
    ENTRY(prefix, DROP, "drop")

typedef enum spec_interior {
    SPEC_INTERIOR_LIST(WORDS_ENUMERATOR, SPEC_INTERIOR) SPEC_INTERIOR_COUNT
} spec_interior;

/* /surface/analytic/shape */
#define SPEC_SHAPE_LIST(ENTRY, prefix)    \
    ENTRY(prefix, SPHERE, "sphere")       \
    ENTRY(prefix, TORUS, "torus")         \
    ENTRY(prefix, BOX, "box")             \
    ENTRY(prefix, ELLIPSOID, "ellipsoid") \
    ENTRY(prefix, QUARTIC, "quartic")     \
    ENTRY(prefix, GYROID, "gyroid")       \
    ENTRY(prefix, CYLINDER, "cylinder")   \
    ENTRY(prefix, CONE, "cone")           \
    ENTRY(prefix, CAPSULE, "capsule")     \
    ENTRY(prefix, HALFSPACE, "halfspace")

typedef enum spec_shape { SPEC_SHAPE_LIST(WORDS_ENUMERATOR, SPEC_SHAPE) SPEC_SHAPE_COUNT } spec_shape;

/* /sampling/grid/kind */
#define SPEC_MAP_LIST(ENTRY, prefix)  \
    ENTRY(prefix, SPACING, "spacing") \
    ENTRY(prefix, DENSITY, "density")

typedef enum spec_map_kind { SPEC_MAP_LIST(WORDS_ENUMERATOR, SPEC_MAP) SPEC_MAP_COUNT } spec_map_kind;

/* /sampling/pattern */
#define SPEC_PATTERN_LIST(ENTRY, prefix)  \
    ENTRY(prefix, HEXAGONAL, "hexagonal") \
    ENTRY(prefix, BLUE_NOISE, "blue_noise")

typedef enum spec_pattern {
    SPEC_PATTERN_LIST(WORDS_ENUMERATOR, SPEC_PATTERN) SPEC_PATTERN_COUNT
} spec_pattern;

/* /sampling/points/mode */
#define SPEC_POINTS_LIST(ENTRY, prefix) \
    ENTRY(prefix, KEEP, "keep")         \
    ENTRY(prefix, REFINE, "refine")     \
    ENTRY(prefix, AVOID, "avoid")

typedef enum spec_points_mode {
    SPEC_POINTS_LIST(WORDS_ENUMERATOR, SPEC_POINTS) SPEC_POINTS_COUNT
} spec_points_mode;

/* /sampling/control/selection: how particles to split or delete are selected */
#define SPEC_SELECTION_LIST(ENTRY, prefix) \
    ENTRY(prefix, BIASED, "biased")        \
    ENTRY(prefix, RANDOM, "random")

typedef enum spec_selection {
    SPEC_SELECTION_LIST(WORDS_ENUMERATOR, SPEC_SELECTION) SPEC_SELECTION_COUNT
} spec_selection;

/* /solver/method */
#define SPEC_METHOD_LIST(ENTRY, prefix) \
    ENTRY(prefix, SIZED, "sized")       \
    ENTRY(prefix, PAPER, "paper")       \
    ENTRY(prefix, WITKIN_HECKBERT, "witkin-heckbert")

typedef enum spec_method { SPEC_METHOD_LIST(WORDS_ENUMERATOR, SPEC_METHOD) SPEC_METHOD_COUNT } spec_method;

/* /solver/energy */
#define SPEC_ENERGY_LIST(ENTRY, prefix)   \
    ENTRY(prefix, COTANGENT, "cotangent") \
    ENTRY(prefix, GAUSSIAN, "gaussian")   \
    ENTRY(prefix, ELECTROSTATIC, "electrostatic")

typedef enum spec_energy { SPEC_ENERGY_LIST(WORDS_ENUMERATOR, SPEC_ENERGY) SPEC_ENERGY_COUNT } spec_energy;

/* /solver/minimiser */
#define SPEC_MINIMISER_LIST(ENTRY, prefix) \
    ENTRY(prefix, LM, "lm")                \
    ENTRY(prefix, GRADIENT, "gradient")

typedef enum spec_minimiser {
    SPEC_MINIMISER_LIST(WORDS_ENUMERATOR, SPEC_MINIMISER) SPEC_MINIMISER_COUNT
} spec_minimiser;

/* /solver/init */
#define SPEC_INIT_LIST(ENTRY, prefix) \
    ENTRY(prefix, SURFACE, "surface") \
    ENTRY(prefix, RANDOM, "random")   \
    ENTRY(prefix, SIZED, "sized")

typedef enum spec_init { SPEC_INIT_LIST(WORDS_ENUMERATOR, SPEC_INIT) SPEC_INIT_COUNT } spec_init;

/* /output/ply/format */
#define SPEC_PLY_LIST(ENTRY, prefix)                            \
    ENTRY(prefix, BINARY_LITTLE_ENDIAN, "binary_little_endian") \
    ENTRY(prefix, ASCII, "ascii")

typedef enum spec_ply_format { SPEC_PLY_LIST(WORDS_ENUMERATOR, SPEC_PLY) SPEC_PLY_COUNT } spec_ply_format;

/* /output/ply/precision */
#define SPEC_PRECISION_LIST(ENTRY, prefix) \
    ENTRY(prefix, FLOAT, "float")          \
    ENTRY(prefix, DOUBLE, "double")

typedef enum spec_precision {
    SPEC_PRECISION_LIST(WORDS_ENUMERATOR, SPEC_PRECISION) SPEC_PRECISION_COUNT
} spec_precision;

/* /output/order: of the points in all outputs */
#define SPEC_ORDER_LIST(ENTRY, prefix)        \
    ENTRY(prefix, PROGRESSIVE, "progressive") \
    ENTRY(prefix, SPATIAL, "spatial")         \
    ENTRY(prefix, ID, "id")

typedef enum spec_order { SPEC_ORDER_LIST(WORDS_ENUMERATOR, SPEC_ORDER) SPEC_ORDER_COUNT } spec_order;

/* /output/preview/color */
#define SPEC_COLOR_LIST(ENTRY, prefix)    \
    ENTRY(prefix, ALPHA, "alpha")         \
    ENTRY(prefix, CURVATURE, "curvature") \
    ENTRY(prefix, ENERGY, "energy")       \
    ENTRY(prefix, SPACING, "spacing")     \
    ENTRY(prefix, DEGREE, "degree")       \
    ENTRY(prefix, SHADING, "shading")

typedef enum spec_color { SPEC_COLOR_LIST(WORDS_ENUMERATOR, SPEC_COLOR) SPEC_COLOR_COUNT } spec_color;

/* /output/preview/up */
#define SPEC_UP_LIST(ENTRY, prefix) \
    ENTRY(prefix, AUTO, "auto")     \
    ENTRY(prefix, Y, "y")           \
    ENTRY(prefix, Z, "z")
typedef enum spec_up { SPEC_UP_LIST(WORDS_ENUMERATOR, SPEC_UP) SPEC_UP_COUNT } spec_up;

/* /output/preview/map */
#define SPEC_MAP_COLORS_LIST(ENTRY, prefix) \
    ENTRY(prefix, VIRIDIS, "viridis")       \
    ENTRY(prefix, GRAY, "gray")             \
    ENTRY(prefix, DIVERGING, "diverging")

typedef enum spec_map_colors {
    SPEC_MAP_COLORS_LIST(WORDS_ENUMERATOR, SPEC_MAP_COLORS) SPEC_MAP_COLORS_COUNT
} spec_map_colors;

/* /output/preview/compression */
#define SPEC_COMPRESSION_LIST(ENTRY, prefix) \
    ENTRY(prefix, NONE, "none")              \
    ENTRY(prefix, RLE, "rle")                \
    ENTRY(prefix, ZIPS, "zips")              \
    ENTRY(prefix, ZIP, "zip")

typedef enum spec_compression {
    SPEC_COMPRESSION_LIST(WORDS_ENUMERATOR, SPEC_COMPRESSION) SPEC_COMPRESSION_COUNT
} spec_compression;

/* /output/preview/channels */
#define SPEC_CHANNELS_LIST(ENTRY, prefix) \
    ENTRY(prefix, BASIC, "basic")         \
    ENTRY(prefix, ALL, "all")

typedef enum spec_channels {
    SPEC_CHANNELS_LIST(WORDS_ENUMERATOR, SPEC_CHANNELS) SPEC_CHANNELS_COUNT
} spec_channels;

/* /attributes/type: the kind of the values, which determines how transforms change them and how formats name
 * them */
#define SPEC_ATTRIBUTE_LIST(ENTRY, prefix) \
    ENTRY(prefix, AUTO, "auto")            \
    ENTRY(prefix, FLOAT, "float")          \
    ENTRY(prefix, INT, "int")              \
    ENTRY(prefix, VECTOR, "vector")        \
    ENTRY(prefix, NORMAL, "normal")        \
    ENTRY(prefix, COLOR, "color")          \
    ENTRY(prefix, UV, "uv")

typedef enum spec_attribute_type {
    SPEC_ATTRIBUTE_LIST(WORDS_ENUMERATOR, SPEC_ATTRIBUTE) SPEC_ATTRIBUTE_COUNT
} spec_attribute_type;

/* /attributes/interpolation */
#define SPEC_INTERPOLATION_LIST(ENTRY, prefix) \
    ENTRY(prefix, LINEAR, "linear")            \
    ENTRY(prefix, CUBIC, "cubic")              \
    ENTRY(prefix, NEAREST, "nearest")

typedef enum spec_interpolation {
    SPEC_INTERPOLATION_LIST(WORDS_ENUMERATOR, SPEC_INTERPOLATION) SPEC_INTERPOLATION_COUNT
} spec_interpolation;

/* /solver/isa */
#define SPEC_ISA_LIST(ENTRY, prefix) \
    ENTRY(prefix, AUTO, "auto")      \
    ISA_LIST(ENTRY, prefix)

typedef enum spec_isa { SPEC_ISA_LIST(WORDS_ENUMERATOR, SPEC_ISA) SPEC_ISA_COUNT } spec_isa;

/* /outcome/require: measures of the report that a job can bound (doc/report.md); last column: the bound is a
 * minimum */
#define SPEC_REQUIRE_LIST(ENTRY, prefix)                      \
    ENTRY(prefix, HEX_FRACTION, hex_fraction, true)           \
    ENTRY(prefix, EDGE_CV, edge_cv, false)                    \
    ENTRY(prefix, AREA_CV, area_cv, false)                    \
    ENTRY(prefix, ENERGY_EXCESS, energy_excess, false)        \
    ENTRY(prefix, DISORDER, disorder, false)                  \
    ENTRY(prefix, DEFECT_SHARE, defect_share, false)          \
    ENTRY(prefix, MIN_SPACING_RATIO, min_spacing_ratio, true) \
    ENTRY(prefix, CLOSE_SHARE, close_share, false)            \
    ENTRY(prefix, COVERAGE, coverage, false)                  \
    ENTRY(prefix, MISSING_SHARE, missing_share, false)        \
    ENTRY(prefix, UNMEASURED_SHARE, unmeasured_share, false)  \
    ENTRY(prefix, MAX_RESIDUAL, max_residual, false)          \
    ENTRY(prefix, RMS_RESIDUAL, rms_residual, false)

#define SPEC_REQUIRE_ENUMERATOR(prefix, NAME, word, minimum) prefix##_##NAME,
typedef enum spec_required_measure {
    SPEC_REQUIRE_LIST(SPEC_REQUIRE_ENUMERATOR, SPEC_REQUIRE) SPEC_REQUIRE_COUNT
} spec_required_measure;
#undef SPEC_REQUIRE_ENUMERATOR

#endif

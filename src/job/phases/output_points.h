// SPDX-License-Identifier: Apache-2.0
/* output_points: the points and the mesh of a result in their final form, before they are written or
 * returned. */
#ifndef HEXAD_JOB_PHASES_OUTPUT_POINTS_H
#define HEXAD_JOB_PHASES_OUTPUT_POINTS_H

#include "io/points/quantity.h"
#include "job/phases/results_input.h"
#include "job/phases/instances.h"
#include "sampling/voronoi/triangulation.h"

typedef struct output_points {
    points set;    /* the set of the input, with orientations and colours if outputs need them */
    bool as_float; /* floats represent the positions; false also if doubles are requested */
    instances turned;
    vec3 *color;
} output_points;

/* Measures the residuals, chooses the precision, and makes the orientations. `has_color`: makes colours if the
 * set has none. Sets all members of *facts but those of the mesh. Free *out after failure, too. Error:
 * limit_memory. */
bool output_points_make(const results_input *in, bool has_color, threads *pool, output_points *out,
                        report_outputs *facts, error *e);
void output_points_free(output_points *o);

typedef struct output_mesh {
    points vertices; /* the set with triangles, and their labels */
    triangulation made;
    int64_t (*labels)[2];
    uint32_t (*side)[2];
} output_mesh;

/* Makes the triangles between the points of `set`, and sets the members of *facts about them. Free *out after
 * failure, too. Errors: limit_memory, cancelled. */
bool output_mesh_make(const results_input *in, const points *set, threads *pool, output_mesh *out,
                      report_outputs *facts, error *e);
void output_mesh_free(output_mesh *m);

/* An origin near the centre, rounded to steps of about the longest side. Frames of a sequence that move less
 * mostly have the same origin, so that programs that interpolate translations between frames do not change
 * it. */
vec3 output_points_origin(const points *set);

/* The look of pictures; values of an attribute are added later. */
quantity_look output_points_look(const spec *s);

#endif

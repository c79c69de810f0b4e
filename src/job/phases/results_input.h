// SPDX-License-Identifier: Apache-2.0
/* results_input: the points of a job that a delivery takes. */
#ifndef HEXAD_JOB_PHASES_RESULTS_INPUT_H
#define HEXAD_JOB_PHASES_RESULTS_INPUT_H

#include "geometry/mesh/mesh.h"
#include "io/points/points.h"
#include "io/points/scene.h"
#include "job/report/report.h"
#include "sampling/solver/solver.h"
#include "spec/spec.h"
#include "surface/field/field.h"
#include "surface/labels/label_surface.h"

typedef struct results_input {
    const spec *spec;
    const field *field; /* in world space, as the points of the set; 0 on the surface; NULL: residuals are not
                         * measured */
    const points *set;
    const label_surface *labels; /* for interfaces; otherwise NULL */
    const field *sampled;        /* the field that was sampled, in its own space */
    const solver_points *solved; /* the points in that space; the mesh is made from them */
    const mesh *triangles;       /* on which the points lie; or NULL */
    const uint32_t (*corner)[3]; /* triangles between the points, if known; otherwise NULL */
    size_t corners;
    const bool *
        kept; /* per point of the set: given, so that its distance from the surface does not count; or NULL */
    const uint32_t *place; /* index in the set of each point of `solved`; NULL: the order is the same */
    const char *comments;  /* of points.ply, see ply_write; NULL: the default */
    const scene_instancer *instancer; /* of points.usda; set by the delivery */
    int frame;                        /* number of the frame in a sequence */
    bool y_up;                        /* y, not z, points up in pictures and scenes */
    bool thin;                        /* many points lie on walls thinner than the spacing */
    double h;                         /* spacing of the ideal packing, world units */
    const solver_sweep *sweeps;       /* at least one */
    size_t sweep_count;
} results_input;

#endif

// SPDX-License-Identifier: Apache-2.0
/* results: the files of a finished job. Each is written under a temporary name, read from the disk again,
 * compared with what was written, and then renamed (files/file.h). */
#ifndef HEXAD_JOB_PHASES_RESULTS_H
#define HEXAD_JOB_PHASES_RESULTS_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/field/field.h"
#include "io/points/points.h"
#include "io/points/scene.h"
#include "base/json/json.h"
#include "surface/labels/label_surface.h"
#include "geometry/mesh/mesh.h"
#include "job/report/report.h"
#include "sampling/solver/solver.h"
#include "spec/spec.h"
#include "files/file.h"

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
    const scene_instancer *instancer; /* of points.usda; set by results_write */
    int frame;                        /* number of the frame in a sequence */
    bool y_up;                        /* y, not z, points up in pictures and scenes */
    bool unresolved;                  /* many points lie on walls thinner than the spacing */
    double h;                         /* spacing of the ideal packing, world units */
    const solver_sweep *sweeps;       /* at least one */
    size_t sweep_count;
} results_input;

/* Writes the outputs of spec->output to `directory`, and appends {name, bytes, sha256} of each file to
 * `outputs`. Errors: storage_full, storage_failed (also if a file is not read as it was written), internal,
 * limit_memory, cancelled. */
bool results_write(const char *directory, const results_input *in, threads *pool, json *outputs,
                   report_outputs *out, error *e);

/* Writes the summary and then the report: a directory with a report is complete. */
bool results_write_report(const char *directory, const json *report, error *e);

/* results_remove removes the results of an earlier run; results_clear the temporary files of an
 * interrupted one. */
bool results_remove(const char *directory, error *e);
void results_clear(const char *directory);

#endif

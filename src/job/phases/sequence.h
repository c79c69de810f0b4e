// SPDX-License-Identifier: Apache-2.0
/* sequence: a frame of a coherent sequence. It starts from the points of the previous frame, keeps their ids,
 * and gives each point a velocity. It reads the previous frame's points.ply and report.json, and needs no
 * daemon.
 */
#ifndef HEXAD_JOB_PHASES_SEQUENCE_H
#define HEXAD_JOB_PHASES_SEQUENCE_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "io/points/ply.h"
#include "base/json/json.h"
#include "sampling/solver/solver.h"
#include "sampling/solver/frame_transfer.h"

/* The results of the previous frame, open. */
typedef struct sequence_files {
    FILE *points, *report;
    FILE *summary; /* NULL: the result has none */
} sequence_files;

typedef struct sequence {
    int frame, previous_frame; /* previous_frame is -1 in the first frame */
    uint32_t next_id;          /* the next unused id of the sequence */
    /* energy_excess of the last frame that was sampled without points of a previous one; 0: unknown */
    double excess_alone;
    /* the same of the last frame that was eased, or sampled without points */
    double excess_eased;
    ply_file before; /* empty after the transfer */
    size_t carried, born, died;
    registration motion;
    vec3 *start, *origin; /* position of each point after and before the transfer; NULL in a first frame */
    uint32_t *id;
    vec3 *velocity; /* world units per frame */
    double drift_median, drift_p95,
        drift_max; /* distance of carried points from `start`, divided by the spacing */
} sequence;

/* Opens the results in a directory. Error: input_missing. */
bool sequence_open(const char *directory, sequence_files *out, error *e);
void sequence_close(sequence_files *files); /* accepts closed files */

/* Reads the previous frame, and compares its bytes with the hashes that were stored with it; `files` NULL: this
 * frame is the first. `beside`: a thread of its own may hash. Errors: input_damaged, limit_memory. */
bool sequence_begin(sequence *s, int frame, const sequence_files *files, bool beside, error *e);

/* Transfers the points of the previous frame, and sets them in `params`. The caller frees *out. Errors: those
 * of frame_transfer_points. */
bool sequence_transfer(sequence *s, const field *f, const surface *scan, frame_transfer_params params,
                       threads *pool, frame_transfer *out, error *e);

/* The excess energy above which a frame with transferred points is eased (solver_params.max_excess); 0: never. */
double sequence_max_excess(const sequence *s, size_t count);

/* For final points: computes velocities, assigns ids to new points, and measures the drift. Errors:
 * limit_memory; internal (ids are exhausted). */
bool sequence_end(sequence *s, const solver_points *p, error *e);

/* Adds the member `sequence`; `energy_excess` is that of this frame. `is_eased`: the solve took longer steps. */
void sequence_describe(const sequence *s, double energy_excess, bool is_eased, json *report);
void sequence_free(sequence *s);

#endif

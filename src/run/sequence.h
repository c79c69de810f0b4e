/* sequence: a frame of a coherent sequence. It takes over the points of the frame before, and says of its own
 * which of those each is (id) and how fast it goes (velocity). Needs no daemon: what it knows of the frame
 * before are that frame's points.ply and report.json. */
#ifndef HEXAD_RUN_SEQUENCE_H
#define HEXAD_RUN_SEQUENCE_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "base/error.h"
#include "base/threads.h"
#include "formats/ply.h"
#include "json/json.h"
#include "sampler/sampler.h"
#include "sequence/frame_transfer.h"

/* The results of the frame before, open. */
typedef struct sequence_files {
    FILE *points, *report;
} sequence_files;

typedef struct sequence {
    int frame, previous_frame; /* -1: it is the first */
    uint32_t next_id;          /* that no point of this frame or those before it has had */
    ply_file before;           /* empty once its points were carried */
    size_t carried, born, died;
    registration motion;
    vec3 *start, *origin; /* of each point: where it was carried to, and from; NULL in a first frame */
    uint32_t *id;
    vec3 *velocity;                            /* world units per frame */
    double drift_median, drift_p95, drift_max; /* of those carried: from `start`, over their spacing */
} sequence;

/* Opens the results in a directory. Errors: input_missing. */
bool sequence_open(const char *directory, sequence_files *out, error *e);
void sequence_close(sequence_files *files); /* also when nothing is open */

/* Reads the frame before; without `files` the frame is the first. Errors: input_damaged, limit_memory. */
bool sequence_begin(sequence *s, int frame, const sequence_files *files, error *e);

/* Carries the points of the frame before, which `params` need not have; those of *out are the caller's to free.
 * Errors: as frame_transfer_points. */
bool sequence_transfer(sequence *s, const field *f, const surface *scan, frame_transfer_params params,
                       threads *pool, frame_transfer *out, error *e);

/* The points are final: gives velocities, ids to those that have none yet, and measures the drift. Errors:
 * limit_memory; internal when there are no more ids. */
bool sequence_end(sequence *s, const sampler_points *p, error *e);

void sequence_describe(const sequence *s, json *report);
void sequence_free(sequence *s);

#endif

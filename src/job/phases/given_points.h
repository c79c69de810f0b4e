// SPDX-License-Identifier: Apache-2.0
/* given_points: the points of sampling.points: read, checked against the surface, and found again in the
 * result. One thread at a time; work is done on the job's pool. */
#ifndef HEXAD_JOB_PHASES_GIVEN_POINTS_H
#define HEXAD_JOB_PHASES_GIVEN_POINTS_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "base/json/json.h"
#include "job/source/source.h"
#include "spec/spec.h"
#include "sampling/solver/frame_transfer.h"
#include "sampling/solver/solver.h"

typedef struct given_points {
    size_t count;       /* rows of the file; 0: none are given */
    vec3 *world;        /* per row, as in the file */
    vec3 *position;     /* per row, in the space that is sampled */
    vec3 *normal;       /* per row: unit normal of the surface at its place */
    vec3 *projected;    /* per row: on the sampled surface; NULL before given_points_place */
    uint32_t *patch;    /* per row: patch of its place; NULL without patches */
    double farthest;    /* largest distance of a point from the surface, over h */
    size_t start_count; /* with mode refine: different points, the first entries of `projected`, `normal` and
                      * `patch` */
    /* With mode keep, of the result: */
    uint32_t *row; /* per point: its row, or GIVEN_POINTS_NEW */
    bool *kept;    /* per point */
} given_points;

#define GIVEN_POINTS_NEW FRAME_TRANSFER_NONE /* rows are those of frame_transfer.fixed */

/* Reads the file of the spec, if it names one. Free *out after failure, too. Errors: those of
 * source_open_file and mesh_file_read_points, with the path. */
bool given_points_read(const spec *s, source *from, size_t memory_limit, given_points *out, error *e);

/* Finds the places of the points on the surface. The exact position decides the wall: the nearest patch; of several
 * patches that meet there, the first (mesh_place.h). `h`: spacing of an even packing of `count` points. Errors:
 * spec_invalid (the count is too small), input_unsupported (a point is too far from the surface; names its
 * row), not_supported (surface or mode), limit_memory, cancelled. */
bool given_points_place(given_points *g, const spec *s, const source *from, double h, size_t count,
                        threads *pool, error *e);

/* With mode keep: sets row and kept of `count` points; `row` has those of the points that are kept, see
 * frame_transfer.fixed. Error: limit_memory. */
bool given_points_note(given_points *g, const uint32_t *row, size_t count, error *e);

/* Puts points that are kept back at their positions. `point`: per position its point, NULL: it is its index.
 * `world`: positions are in world space, else in the space that is sampled. */
void given_points_restore(const given_points *g, const uint32_t *point, size_t count, bool world,
                          vec3 *position);

/* The arrays of given_points_walls. */
typedef struct given_walls {
    vec3 *normal;
    uint32_t *point, *patch;
    uint8_t *flags;
} given_walls;

/* Replaces the copies of kept points, for the measures: a kept point has one for each patch on which its exact
 * position lies, whatever the solver has. `points`: number of points, of which *copies has the solver's copies; its
 * positions, spacings and places are dropped. *out owns the new arrays. *copies is unchanged if no points are kept,
 * or if the surface is not sampled on triangles. Free *out also after failure. Error: limit_memory. */
bool given_points_walls(const given_points *g, const source *from, size_t points, solver_patch_points *copies,
                        given_walls *out, error *e);
void given_walls_free(given_walls *w);

/* Bytes of memory of all rows. */
double given_points_bytes(const given_points *g);

/* Adds the member `points` to the report. */
void given_points_describe(const given_points *g, const spec *s, json *report);
void given_points_free(given_points *g);

#endif

// SPDX-License-Identifier: Apache-2.0
/* avoided_points: with mode avoid of sampling.points, chooses the points of the result: those points of a
 * packing of the whole surface that are farthest from the given points. One thread at a time; work is done
 * on the job's pool. */
#ifndef HEXAD_JOB_PHASES_AVOIDED_POINTS_H
#define HEXAD_JOB_PHASES_AVOIDED_POINTS_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "job/phases/given_points.h"
#include "job/source/source.h"
#include "spec/spec.h"
#include "surface/scan/surface.h"

typedef struct avoided_points {
    size_t wanted; /* points of the result; 0: all that are far enough */
    double slack;  /* additional points of the packing, since the number of points that are far enough
                    * varies */
    int rounds;    /* number of packings that were made and had too few or too many points */
    /* Of the last packing: */
    bool *taken; /* per point: it is in the result; NULL: all are */
    size_t taken_count, packed_count;
    double nearest; /* least distance of a point of the result from a given one, world units */
} avoided_points;

/* Computes how many points a packing of the whole surface must have for about `count` of them to be far
 * enough from the given points. *packed is unchanged if the target is not a count, or if no points are
 * avoided. Errors: no_surface (no place is far enough), spec_invalid (too many points), limit_memory,
 * cancelled. */
bool avoided_points_plan(const given_points *g, const spec *s, const source *from, const surface *scan,
                         size_t count, threads *pool, avoided_points *out, size_t *packed, error *e);

/* Chooses the points of the result from a packing: `count` positions in the space that is sampled. If too few
 * or far too many of them are far enough, *packed is the number of points for another packing;
 * otherwise 0. Does nothing if no points are avoided. Errors: as avoided_points_plan. */
bool avoided_points_choose(avoided_points *a, const given_points *g, const spec *s, const source *from,
                           const vec3 *position, size_t count, size_t *packed, error *e);

/* Adds what was chosen to the member `points` of the report. */
void avoided_points_describe(const avoided_points *a, json *report);
void avoided_points_free(avoided_points *a);

#endif

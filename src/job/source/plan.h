// SPDX-License-Identifier: Apache-2.0
/* plan: the number of points that a job requests, and whether it fits into the job's memory. Pure functions,
 * any thread.
 */
#ifndef HEXAD_JOB_SOURCE_PLAN_H
#define HEXAD_JOB_SOURCE_PLAN_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"
#include "spec/spec.h"

/* The range of sampling.count, and of counts computed from other targets. */
#define PLAN_COUNT_MIN 4.0
#define PLAN_COUNT_MAX 1e8

/* Whether the method `paper` with amplitudes solves from coarse to fine: by default, unless the count is
 * controlled, or another energy or minimiser is chosen. */
bool plan_grades_by_levels(const spec *s);

/* Whether defects of the converged packing are repaired (solver_repair_defects). */
bool plan_repairs_defects(const spec *s);

/* Bytes that particles may take: the job's `limit` minus the bytes of the process, the source, pictures and
 * repair regions. May be negative. */
double plan_particle_memory(const spec *s, size_t limit, size_t source_bytes);

/* Bytes of the pictures while they are drawn. */
double plan_picture_memory(const spec *s);

/* What the memory of particles depends on, beside the spec. */
typedef struct plan_particles {
    bool
        is_continued; /* points are carried over, from the previous frame or around given points that are kept */
    bool
        has_patches; /* the surface consists of patches: triangles, interfaces of labels, faces with sharp edges */
    double more_bytes; /* per point, such as those of attributes */
} plan_particles;

/* Bytes that `count` particles take at the peak of the job: an upper bound. */
double plan_bytes(const spec *s, plan_particles of, double count);

/* The largest number of particles, which may be a fraction, for which plan_bytes is at most `bytes`. */
double plan_fitting(const spec *s, plan_particles of, double bytes);

/* Memory of a job, bytes. */
typedef struct plan_memory {
    double left;  /* of the limit, for particles */
    double limit; /* of the job */
    double most;  /* the largest limit that the job may have; 0: unknown */
} plan_memory;

/* Whether `count` particles fit into the memory that is left. Error: limit_memory. */
bool plan_check_memory(const spec *s, plan_particles of, double count, const plan_memory *memory, error *e);

/* The spacing that the target requires for any area. For `resolve`: the least one that min_spacing permits.
 * 0: the target is a count or a time. */
double plan_spacing(const spec *s);

/* Computes the count from the target, which is not a time, and the surface's area. `points`: the count that
 * the sizing field requires if the target is `resolve`. Error: spec_invalid (the count is out of range). */
bool plan_count(const spec *s, double area, double points, size_t *out, error *e);

#endif

// SPDX-License-Identifier: Apache-2.0
/* advice: changes of a spec that would improve its result, as members of the spec with values computed from
 * the data.
 *
 * Reports, estimates and descriptions of files contain it as `advice: [{code, message, set}]`: a stable code,
 * a complete sentence for people, and the members to set, by their JSON Pointers. Pure functions, any thread.
 */
#ifndef HEXAD_JOB_REPORT_ADVICE_H
#define HEXAD_JOB_REPORT_ADVICE_H

#include <stddef.h>

#include "base/json/json.h"
#include "sampling/sizing/clearance.h"
#include "spec/spec.h"

typedef struct advice_resolution {
    double spacing; /* of a uniform packing, world units */
    /* number of points at that spacing; rounded up to two digits, and consistent with `spacing` */
    double count;
    bool of_voxels; /* it separates walls of half a voxel; the surface has thinner ones */
    bool reached;   /* the present spacing is at most that of `of_voxels` */
} advice_resolution;

/* The resolution that separates the walls of a surface: `area` in world units squared, `count` points at
 * present, whose spacing has to be multiplied by `factor` <= 1. A factor of 1, and 0 without a limit, mean unknown;
 * 1/2 is used.
 * `thinnest`: thickness of the thinnest walls to separate (source_thinnest_wall); 0: no limit. */
advice_resolution advice_resolve(double area, size_t count, double factor, double thinnest);

/* The factor for advice_resolve from measured walls: 0 if walls are closer than the smallest distance that was
 * measured and the data determine none below `thinnest`. */
double advice_factor(const clearance *walls, double thinnest);

/* Adds the share of the points, or of the surface, that is in walls thinner than the spacing, and the resolution
 * that separates them. The share of the points is a warning. That of the surface is for results whose points
 * represent it, and for estimates: it matters only if triangles are made from the points alone, and is advice with
 * the code `thin_walls`, which sets nothing. */
void advice_put_walls(json *advice, json *warnings, const spec *s, double share, bool of_surface,
                      advice_resolution to);

/* Appends an item and returns its object `set`, which `list` owns. */
json *advice_append(json *list, const char *code, const char *message);

/* Memory of a job, MiB. */
typedef struct advice_memory {
    double needed; /* limits.memory_mb needed for the advised number of points */
    double limit;  /* the present limit */
    double most;   /* the largest limit that the job may have; 0: unknown */
} advice_memory;

/* Appends an item with the code `unresolved` that sets the target of the spec, and limits.memory_mb if more than
 * the present limit is needed. It sets nothing if no job may have that many points or that much memory. */
void advice_append_resolution(json *list, const spec *s, double area, advice_resolution to,
                              const advice_memory *memory);

#endif

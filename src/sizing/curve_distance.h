/* curve_distance: how far a place is from the nearest curve of a patch, or of all. Immutable once made, safe in any thread. */
#ifndef HEXAD_SIZING_CURVE_DISTANCE_H
#define HEXAD_SIZING_CURVE_DISTANCE_H

#include "base/error.h"
#include "field/patches.h"

typedef struct curve_distance curve_distance;

/* Of curves that are looked at every `step` > 0. `joined`: all patches count as one, which is patch 0. Error: limit_memory. */
curve_distance *curve_distance_new(const field_patches *patches, bool joined, double step, error *e);
void curve_distance_free(curve_distance *d);

/* INFINITY for a patch without curves. Too large by (step / 2)^2 over twice the distance at most. */
double curve_distance_at(const curve_distance *d, uint32_t patch, vec3 x);

/* The same, and the nearest place looked at, which stays as it is for a patch without curves. */
double curve_distance_nearest(const curve_distance *d, uint32_t patch, vec3 x, vec3 *nearest);

#endif

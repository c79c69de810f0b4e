/* nearest: the nearest of some points to any place, by a tree of halves (Bentley 1975).
 *
 * Looking is safe in any number of threads. The points stay the caller's, and where they are.
 */
#ifndef HEXAD_PACKING_NEAREST_H
#define HEXAD_PACKING_NEAREST_H

#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "geometry/vec3.h"

typedef struct nearest nearest;

/* Of 1 to 2^32 - 1 points. NULL and limit_memory when memory is out. */
nearest *nearest_new(const vec3 *points, size_t count, error *e);
void nearest_free(nearest *n);

/* The point nearest to x, and how far it is; or any that is no farther than `enough`, which is found sooner. */
uint32_t nearest_find(const nearest *n, vec3 x, double enough, double *distance);

#endif

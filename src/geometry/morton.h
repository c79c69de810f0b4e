/* morton: points in the order of Morton's curve, along which neighbours in space are near each other.
 *
 * G. M. Morton 1966, "A computer oriented geodetic data base". The order is stable: points of one cell keep
 * theirs. */
#ifndef HEXAD_GEOMETRY_MORTON_H
#define HEXAD_GEOMETRY_MORTON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/vec3.h"

/* order[k]: the point that comes k-th, of `count`, which are finite. The cells are finer than points that
 * fill a surface are apart. `pool` may be NULL. Error: limit_memory. */
bool morton_order(const vec3 *x, size_t count, threads *pool, uint32_t *order, error *e);

#endif

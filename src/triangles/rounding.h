/* rounding: how far the coordinates of a mesh may be off. Pure functions. Threads: those of a pool, or NULL, whose number does not show. */
#ifndef HEXAD_TRIANGLES_ROUNDING_H
#define HEXAD_TRIANGLES_ROUNDING_H

#include "base/threads.h"
#include "triangles/mesh.h"

/* A coordinate is off by `absolute` plus `relative` times itself. */
typedef struct rounding {
    double absolute, relative;
} rounding;

/* Coordinates may have been computed in doubles, by a map of the whole mesh: three products and three sums, each off by 2^-53 of the
 * largest coordinate. If all are floats, they were rounded to these then, by 2^-24 of themselves. rounding_at_most takes them for
 * floats without a look. */
rounding rounding_of(const mesh *m, threads *pool);
rounding rounding_at_most(const mesh *m, threads *pool);

/* How far from a line or a plane points can be that are rounded places of it, of which these are three. Each is off by sqrt(3) times what
 * its coordinates are off, and the line by as much as the points on it. */
double rounding_reach(const rounding *r, const vec3 corner[3]);

#endif

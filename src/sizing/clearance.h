/* clearance: by how much a spacing is too coarse for points to tell the sheets of a surface apart.
 *
 * Points are drawn evenly from the surface. From each, rays go to both sides, along the normal and at an angle to it, up to
 * the first sheet that faces the point's own. The sheets are told apart where the spacing is at most the largest with
 * which neither bound of voronoi/resolution.h holds at any ray's end. Sheets that are nearer than half a cell, or of
 * patches an eighth of the spacing, count as so far apart.
 */
#ifndef HEXAD_SIZING_CLEARANCE_H
#define HEXAD_SIZING_CLEARANCE_H

#include "base/error.h"
#include "base/threads.h"
#include "sizing/sizing_field.h"
#include "surface/surface.h"

typedef struct clearance {
    double unresolved_share; /* of the surface, at the given spacing: facing sheets are too near there */
    /* With the spacing times this factor nearly all of the surface is resolved; 1: it is with the given one. Where
     * the spacing varies, it is meant in proportion. */
    double factor;
} clearance;

/* Of the requested spacing: `sizing`, or where that is NULL, h. Errors: limit_memory, cancelled. Deterministic for any
 * number of threads. */
bool clearance_measure(const surface *scan, const sizing_field *sizing, double h, threads *pool,
                       clearance *out, error *e);

#endif

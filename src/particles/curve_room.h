/* curve_room: how much room the patches of a surface leave between their curves. */
#ifndef HEXAD_PARTICLES_CURVE_ROOM_H
#define HEXAD_PARTICLES_CURVE_ROOM_H

#include "base/error.h"
#include "surface/surface.h"

/* The distance from the curves of its patch that a tenth of the surface has, or more; INFINITY without curves. Places are
 * drawn evenly; distances are good to a part of `h`. The surface is one of patches. Error: limit_memory. */
bool curve_room_find(const surface *scan, double h, double *distance, error *e);

#endif

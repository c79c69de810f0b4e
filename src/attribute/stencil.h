/* stencil: which samples of a lattice a value between them is made of, and with what weights. Index space. Pure
 * functions. */
#ifndef HEXAD_ATTRIBUTE_STENCIL_H
#define HEXAD_ATTRIBUTE_STENCIL_H

#include <stdbool.h>
#include <stdint.h>

#include "geometry/vec3.h"

typedef enum stencil_kind {
    STENCIL_LINEAR,
    STENCIL_CUBIC, /* Catmull and Rom: goes through the samples, and its slope there is that of their neighbours */
    STENCIL_NEAREST
} stencil_kind;

/* `count` samples along each axis from `first` on; weights along an axis add up to 1. */
typedef struct stencil {
    int count;
    int32_t first[3];
    double weight[3][4];
} stencil;

/* False where the place is beyond all indices. */
bool stencil_at(stencil_kind kind, vec3 index, stencil *out);

#endif

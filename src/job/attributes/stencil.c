// SPDX-License-Identifier: Apache-2.0
#include "job/attributes/stencil.h"

#include <math.h>

bool stencil_at(stencil_kind kind, vec3 index, stencil *out)
{
    static const int counts[] = {[STENCIL_LINEAR] = 2, [STENCIL_CUBIC] = 4, [STENCIL_NEAREST] = 1};
    out->count = counts[kind];
    for (int a = 0; a < 3; a++) {
        double x = vec3_get(index, a), low = kind == STENCIL_NEAREST ? round(x) : floor(x), t = x - low;
        double *w = out->weight[a];
        if (!(fabs(x) < INT32_MAX - 4)) return false;
        out->first[a] = (int32_t)low - (kind == STENCIL_CUBIC);
        switch (kind) {
        case STENCIL_NEAREST:
            w[0] = 1;
            break;
        case STENCIL_LINEAR:
            w[0] = 1 - t;
            w[1] = t;
            break;
        case STENCIL_CUBIC:
            w[0] = 0.5 * t * (-1 + t * (2 - t));
            w[1] = 1 + 0.5 * t * t * (-5 + 3 * t);
            w[2] = 0.5 * t * (1 + t * (4 - 3 * t));
            w[3] = 0.5 * t * t * (t - 1);
            break;
        }
    }
    return true;
}

#include "particles/curve_room.h"

#include <math.h>
#include <stdlib.h>

#include "base/compare.h"
#include "base/memory.h"
#include "sizing/curve_distance.h"

/* Places that are looked at, the share that is to have the room, and how often curves are looked at, over h. */
enum { PLACES = 4096 };
static const double SHARE = 0.1, STEP = 0.25;
static const uint64_t SEED = 1;

bool curve_room_find(const surface *scan, double h, double *distance, error *e)
{
    const double *before = scan->area_before;
    const size_t *begin = scan->parts.begin;
    double *room = mem_array(PLACES, sizeof *room, "the room beside curves", e);
    curve_distance *curves = room ? curve_distance_new(scan->field->patches, false, STEP * h, e) : NULL;
    size_t found = 0;
    uint32_t patch = 0;
    for (size_t k = 0; curves && k < PLACES; k++) {
        rng r = rng_seed(SEED, k);
        const double where = ((double)k + rng_uniform(&r)) / PLACES * scan->area;
        while (patch + 1 < scan->field->patches->count && before[begin[patch + 1]] <= where) patch++;
        const double low = before[begin[patch]], high = before[begin[patch + 1]];
        vec3 x;
        if (surface_patch_point(scan, before, patch, fmin(fmax((where - low) / (high - low), 0), 1), &r, &x))
            room[found++] = curve_distance_at(curves, patch, x);
    }
    if (curves) {
        qsort(room, found, sizeof *room, compare_doubles);
        *distance = found > 0 ? room[(size_t)((1 - SHARE) * (double)(found - 1))] : INFINITY;
    }
    const bool ok = curves != NULL;
    curve_distance_free(curves);
    free(room);
    return ok;
}

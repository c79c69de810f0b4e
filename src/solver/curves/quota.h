/* quota: who gets how many of the particles on one level of a surface with patches: rows along the curves, which are held
 * fixed, and the other particles of each patch, none of which can go to another. World space. */
#ifndef HEXAD_SOLVER_ALLOTMENT_H
#define HEXAD_SOLVER_ALLOTMENT_H

#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "solver/curves/curve_samples.h"
#include "solver/particles/particles.h"
#include "sizing/sizing_field.h"
#include "surface/surface.h"

/* What is shared out, and by what. */
typedef struct quota_input {
    const field *field; /* with patches */
    const surface *scan;
    const sizing_field *sizing; /* NULL: even */
    double even;                /* spacing that the sizing field is relative to */
} quota_input;

typedef struct quota {
    double spacing; /* h: of rows, and of the packing behind them */
    curve_samples rows;
    uint32_t *free;    /* of each patch its other particles */
    size_t free_count; /* their sum */
} quota;

/* `count` points in all, those on curves counted once. Release also after failure. Error: limit_memory. */
bool quota_for_count(const quota_input *in, size_t count, quota *out, error *e);

/* As many as this spacing asks for, but no more than `most` of them on curves. */
bool quota_for_spacing(const quota_input *in, double spacing, size_t most, quota *out, error *e);
void quota_free(quota *a);

/* Points in all, and particles: a point on a curve is a particle for each patch there. */
static inline size_t quota_points(const quota *a)
{
    return a->rows.count + a->free_count;
}
static inline size_t quota_particles(const quota *a)
{
    return a->rows.copies + a->free_count;
}

/* Adds the particles of the rows to those there are, for which there is room; or first takes those away that are held on curves
 * now. Error: limit_memory. */
void quota_add_rows(const quota *a, particles *p);
bool quota_replace_rows(const quota *a, particles *p, error *e);

#endif

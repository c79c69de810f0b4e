/* allotment: who gets how many of the particles on one level of a surface with patches: rows along the curves, which are held
 * fixed, and the other particles of each patch, none of which can go to another. World space. */
#ifndef HEXAD_PARTICLES_ALLOTMENT_H
#define HEXAD_PARTICLES_ALLOTMENT_H

#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "curves/curve_rows.h"
#include "particles/particles.h"
#include "sizing/sizing_field.h"
#include "surface/surface.h"

/* What is shared out, and by what. */
typedef struct allotment_input {
    const field *field; /* with patches */
    const surface *scan;
    const sizing_field *sizing; /* NULL: even */
    double even;                /* spacing that the sizing field is relative to */
} allotment_input;

typedef struct allotment {
    double spacing; /* h: of rows, and of the packing behind them */
    curve_rows rows;
    uint32_t *free;    /* of each patch its other particles */
    size_t free_count; /* their sum */
} allotment;

/* `count` points in all, those on curves counted once. Release also after failure. Error: limit_memory. */
bool allotment_for_count(const allotment_input *in, size_t count, allotment *out, error *e);

/* As many as this spacing asks for, but no more than `most` of them on curves. */
bool allotment_for_spacing(const allotment_input *in, double spacing, size_t most, allotment *out, error *e);
void allotment_free(allotment *a);

/* Points in all, and particles: a point on a curve is a particle for each patch there. */
static inline size_t allotment_points(const allotment *a)
{
    return a->rows.count + a->free_count;
}
static inline size_t allotment_particles(const allotment *a)
{
    return a->rows.stands + a->free_count;
}

/* Adds the particles of the rows to those there are, for which there is room; or first takes those away that are held on curves
 * now. Error: limit_memory. */
void allotment_add_rows(const allotment *a, particles *p);
bool allotment_replace_rows(const allotment *a, particles *p, error *e);

#endif

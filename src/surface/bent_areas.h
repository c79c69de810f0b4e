/* bent_areas: the areas of cells that the surface crosses and in which it bends: if there are many, their areas are
 * estimated from samples.
 *
 * The area of a cell is measured by 4^3 parts or, in less time, by 2^3 parts or by its own triangles. The faster
 * estimates are too small by a share that is similar for similar cells. If all of the surface is as the part that the
 * samples were chosen by, 8 000 cells or more are measured by all parts, one of eight at most, and 50 000 or more by
 * half as many along each axis. Areas of fogs are off by some 4e-4 then, of noise by 1.3e-3. Units: world, squared. No
 * state, any threads.
 */
#ifndef HEXAD_SURFACE_BENT_AREAS_H
#define HEXAD_SURFACE_BENT_AREAS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Areas by all parts and by half of them, of cells that have both, and how many have; by half of the parts and by
 * triangles, of those that have these. */
typedef struct bent_sums {
    double whole, half_of_whole, half, rough_of_half;
    size_t wholes;
} bent_sums;

/* One of `whole` bent cells is measured by all its parts, and one of `half` by half as many along each axis; `whole` is
 * a multiple of `half`. Both 1: all are measured by all. */
typedef struct bent_samples {
    uint32_t whole, half;
} bent_samples;

/* The samples for this number of cells. */
bent_samples bent_choose(double cells);

/* Whether cell k is in the sample of one of `every` cells. */
bool bent_is_drawn(size_t k, uint32_t every);

/* `area`: of `cells` cells. Values below 0 are estimates with the sign reversed: by half of the parts if the cell is
 * in the sample for that, else by its triangles. They are scaled by the ratios of the sampled cells of the same stretch,
 * since the shape of a surface varies by place. `sums`: of each `grain` cells. */
void bent_settle(double *area, size_t cells, size_t grain, const bent_sums *sums, bent_samples every);

#endif

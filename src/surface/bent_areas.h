/* bent_areas: the areas of cells that the surface crosses and in which it bends, where these are so many that some speak for others.
 *
 * A cell's parts tell its area, 4^3 of them or, in less time, 2^3, which is less by a share that is alike for cells that
 * are alike; so is what its own triangles tell. If all of the surface is as the part that the samples were chosen by, 8 000 cells or
 * more are measured by all parts, one of eight at most, and 50 000 or more by half as many along each axis. Areas of fogs are off by
 * some 4e-4 then, of noise by 1.3e-3. Units: world, squared. No state, any threads.
 */
#ifndef HEXAD_SURFACE_BENT_AREAS_H
#define HEXAD_SURFACE_BENT_AREAS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Areas by all parts and by half of them, of cells that have both, and how many have; by half of the parts and by triangles, of those
 * that have these. */
typedef struct bent_sums {
    double whole, half_of_whole, half, rough_of_half;
    size_t wholes;
} bent_sums;

/* Of so many bent cells there is one that is measured by all its parts, and one by half of them; the former is a multiple of the latter.
 * Both 1: all are measured by all. */
typedef struct bent_samples {
    uint32_t whole, half;
} bent_samples;

/* For so many cells. */
bent_samples bent_choose(double cells);

/* Whether cell k is one of so many. */
bool bent_is_drawn(size_t k, uint32_t every);

/* Areas of `cells` cells, of which those below 0 are not known yet: they are what half of the parts tell where the cell is drawn for
 * that, else what triangles tell. These become as large as the others say, those of the same stretch: what a surface is like goes by
 * the place. `sums`: of each `grain` cells. */
void bent_settle(double *area, size_t cells, size_t grain, const bent_sums *sums, bent_samples every);

#endif

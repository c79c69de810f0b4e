// SPDX-License-Identifier: Apache-2.0
#include "surface/scan/bent_areas.h"

#include <math.h>

/* Minimum number of cells that are measured by all their parts, and by half as many along each axis. At most
 * one of SAMPLE_EVERY cells is measured by all parts. */
static const double LEAST_WHOLE = 8000, LEAST_HALF = 50000, SAMPLE_EVERY = 8;
/* Cells that are measured by all parts in a stretch, over which their ratios are averaged. */
static const size_t WHOLE_IN_STRETCH = 250;

bool bent_is_drawn(size_t k, uint32_t every)
{
    return (uint32_t)(k * 0x9E3779B97F4A7C15u >> 32) % every == 0;
}

bent_samples bent_choose(double cells)
{
    const double half = fmax(floor(cells / LEAST_HALF), 1),
                 whole = fmax(floor(cells / LEAST_WHOLE), SAMPLE_EVERY);
    return (bent_samples){(uint32_t)(floor(whole / half) * half), (uint32_t)half};
}

static void add_sums(bent_sums *to, const bent_sums *from)
{
    to->whole += from->whole;
    to->half_of_whole += from->half_of_whole;
    to->half += from->half;
    to->rough_of_half += from->rough_of_half;
    to->wholes += from->wholes;
}

static void settle_stretch(double *area, size_t first, size_t last, const bent_sums *known,
                           bent_samples every)
{
    const double of_half = known->half_of_whole > 0 ? known->whole / known->half_of_whole : 1,
                 of_rough = known->rough_of_half > 0 ? of_half * known->half / known->rough_of_half : 1;
    for (size_t k = first; k < last; k++)
        if (area[k] < 0) area[k] *= -(bent_is_drawn(k, every.half) ? of_half : of_rough);
}

void bent_settle(double *area, size_t cells, size_t grain, const bent_sums *sums, bent_samples every)
{
    bent_sums before = {0}, known = {0};
    size_t begins_before = 0, begins = 0;
    for (size_t k = 0; k * grain < cells; k++) {
        add_sums(&known, &sums[k]);
        if (known.wholes < WHOLE_IN_STRETCH) continue;
        settle_stretch(area, begins_before, begins, &before, every);
        before = known;
        known = (bent_sums){0};
        begins_before = begins;
        begins = (k + 1) * grain;
    }
    add_sums(&before, &known); /* the last stretch has too few cells for a ratio of its own */
    settle_stretch(area, begins_before, cells, &before, every);
}

// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/thin_walls.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/isa.h"
#include "base/core/memory.h"
#include "base/core/rng.h"

/* Samples of a line that decide on its middle edge: three on each side. */
enum { SAMPLES = 6 };
/* Maximum second difference of the samples of a side, over the change of slope at the edge. On walls that are flat within
 * three samples the ratio is near 0, in noise about 1. */
static const float MOST_BEND = 0.25f;
/* A wall is thin if it is thinner than this number of voxels. */
static const float THIN = 2;

struct thin_walls_search {
    size_t width, height, slices;
    float *slice[SAMPLES]; /* F of the last slices, the newest last */
    uint8_t *candidate;    /* of each sample of a row */
    rng random;            /* chooses the kinks that are stored */
    thin_walls_found found;
};

size_t thin_walls_bytes(int64_t width, int64_t height)
{
    return (size_t)(width * height) * SAMPLES * sizeof(float) + (size_t)width +
           THIN_WALLS_KEPT * sizeof(thin_walls_edge);
}

thin_walls_search *thin_walls_begin(int64_t width, int64_t height, error *e)
{
    thin_walls_search *s = mem_alloc(sizeof *s);
    s->width = (size_t)width;
    s->height = (size_t)height;
    s->random = rng_seed(0, 0);
    s->candidate = mem_array(s->width, 1, "a slice of the volume", e);
    s->found.kink = mem_array(THIN_WALLS_KEPT, sizeof *s->found.kink, "the thin walls of the volume", e);
    bool ok = s->candidate && s->found.kink;
    for (int k = 0; ok && k < SAMPLES; k++)
        ok = (s->slice[k] = mem_array(s->width * s->height, sizeof(float), "a slice of the volume", e)) !=
             NULL;
    if (ok) return s;
    thin_walls_end(s);
    return NULL;
}

/* Whether a wall without a sample crosses the edge between f[2] and f[3]; see thin_walls.h. */
static bool is_lost(const float f[SAMPLES])
{
    const float sign = f[2] < 0 ? -1 : 1, left = sign * f[2], right = sign * f[3],
                bend_left = sign * (f[0] - 2 * f[1] + f[2]), bend_right = sign * (f[3] - 2 * f[4] + f[5]),
                beyond_left = 2 * left - sign * f[1] + bend_left,
                beyond_right = 2 * right - sign * f[4] + bend_right;
    /* how far each side lies above the other, continued one */
    const float above = left - beyond_right, below = right - beyond_left, kink = above + below;
    if (!(above > 0 && below > 0) || fabsf(bend_left) + fabsf(bend_right) > MOST_BEND * kink) return false;
    return left + above / kink * (beyond_left - left) < 0;
}

/* Whether a wall with the one sample f[1] is thin; the others are outside. */
static bool is_thin(const float f[3])
{
    return f[1] / (f[1] - f[0]) + f[1] / (f[1] - f[2]) < THIN;
}

/* The samples of many lines: sample k of line i is at[k][i]. */
typedef struct lines {
    const float *at[SAMPLES];
} lines;

/* Counts the crossings of the edges between at[2] and at[3], and marks those where F falls towards the isovalue on both
 * sides, steeply enough to be lost, or where a wall with one sample ends. */
ISA_CLONES static uint32_t mark(const lines *l, size_t count, uint8_t *restrict candidate, uint32_t *marked)
{
    const float *restrict a = l->at[1], *restrict b = l->at[2], *restrict c = l->at[3],
                          *restrict d = l->at[4];
    uint32_t found = 0, any = 0;
    for (size_t i = 0; i < count; i++) {
        const uint32_t crossed = (b[i] < 0) != (c[i] < 0), single = (a[i] < 0) == (c[i] < 0);
        const float fall = fabsf(a[i]) - fabsf(b[i]), rise = fabsf(d[i]) - fabsf(c[i]);
        const uint32_t kink = (fabsf(b[i]) < fall) & (fabsf(c[i]) < rise), wall = b[i] < 0;
        const uint32_t is = (crossed & single & wall) | ((crossed ^ 1) & kink);
        found += crossed;
        any += is;
        candidate[i] = (uint8_t)is;
    }
    *marked = any;
    return found;
}

/* Reservoir sampling: each of the kinks is stored with the same probability. */
static void add_kink(thin_walls_search *s, const thin_walls_edge *edge)
{
    thin_walls_found *f = &s->found;
    const uint64_t at = f->kinks < THIN_WALLS_KEPT ? f->kinks : rng_next(&s->random) % (f->kinks + 1);
    f->kinks++;
    if (at < THIN_WALLS_KEPT) f->kink[at] = *edge;
}

/* `first`: the edge of line 0; those of the others follow along the first axis. */
static void count_lines(thin_walls_search *s, const lines *l, size_t count, thin_walls_edge first)
{
    uint32_t marked;
    s->found.crossed += mark(l, count, s->candidate, &marked);
    for (size_t i = 0; marked > 0 && i < count; i++) {
        if (!s->candidate[i]) continue;
        marked--;
        float f[SAMPLES];
        thin_walls_edge edge = first;
        edge.at[0] += (int32_t)i;
        for (int k = 0; k < SAMPLES; k++) f[k] = l->at[k][i];
        if ((f[2] < 0) != (f[3] < 0))
            s->found.thin += is_thin(f + 1) ? 2 : 0;
        else if (is_lost(f))
            add_kink(s, &edge);
    }
}

void thin_walls_add(thin_walls_search *s, const double *values, double isovalue, double no_data)
{
    enum { LOW = SAMPLES / 2 - 1 }; /* the first sample of the middle edge */
    float *now = s->slice[0];
    for (int k = 1; k < SAMPLES; k++) s->slice[k - 1] = s->slice[k];
    s->slice[SAMPLES - 1] = now;
    const int32_t z = (int32_t)s->slices++;
    const double rounded = (double)(float)no_data;
    for (size_t i = 0; i < s->width * s->height; i++)
        now[i] = values[i] == no_data || values[i] == rounded ? NAN : (float)(isovalue - values[i]);
    for (size_t y = 0; y < s->height; y++) {
        const float *row = now + y * s->width;
        const int32_t at = (int32_t)y;
        lines along, across, through;
        for (size_t k = 0; k < SAMPLES; k++) {
            along.at[k] = row + k;
            across.at[k] = row + k * s->width;
            through.at[k] = s->slice[k] + y * s->width;
        }
        if (s->width >= SAMPLES)
            count_lines(s, &along, s->width - SAMPLES + 1, (thin_walls_edge){{LOW, at, z}, 0});
        if (y + SAMPLES <= s->height)
            count_lines(s, &across, s->width, (thin_walls_edge){{0, at + LOW, z}, 1});
        if (s->slices >= SAMPLES)
            count_lines(s, &through, s->width, (thin_walls_edge){{0, at, z - SAMPLES + 1 + LOW}, 2});
    }
}

thin_walls_found thin_walls_take(thin_walls_search *s)
{
    const thin_walls_found found = s->found;
    s->found = (thin_walls_found){0};
    return found;
}

void thin_walls_end(thin_walls_search *s)
{
    if (!s) return;
    for (int k = 0; k < SAMPLES; k++) free(s->slice[k]);
    free(s->candidate);
    thin_walls_free(&s->found);
    free(s);
}

void thin_walls_free(thin_walls_found *f)
{
    free(f->kink);
    *f = (thin_walls_found){0};
}

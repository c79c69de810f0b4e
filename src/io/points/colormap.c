// SPDX-License-Identifier: Apache-2.0
#include "io/points/colormap.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/compare.h"
#include "base/core/elementary.h"
#include "base/core/memory.h"

/* Minimum range relative to the centre. Noise of the curvature of a volume is about a percent; with this
 * range it has one hue. */
static const double min_range = 0.05;

/* Maximum number of values for percentiles, evenly spaced in the set. */
enum { PERCENTILE_SAMPLES = 65536 };
static const double low_share = 0.02, high_share = 0.98;

void colormap_viridis(double t, double srgb[3])
{
    static const double c[7][3] = {
        {0.2777273272234177, 0.005407344544966578, 0.3340998053353061},
        {0.1050930431085774, 1.404613529898575, 1.384590162594685},
        {-0.3308618287255563, 0.214847559468213, 0.09509516302823659},
        {-4.634230498983486, -5.799100973351585, -19.33244095627987},
        {6.228269936347081, 14.17993336680509, 56.69055260068105},
        {4.776384997670288, -13.74514537774601, -65.35303263337234},
        {-5.435455855934631, 4.645852612178535, 26.3124352495832},
    };
    t = fmin(fmax(t, 0), 1);
    for (int k = 0; k < 3; k++) {
        double value = 0;
        for (int i = 6; i >= 0; i--) value = value * t + c[i][k];
        srgb[k] = fmin(fmax(value, 0), 1);
    }
}

void colormap_color(colormap_map map, double t, double srgb[3])
{
    static const double start = 0.08, gray_start = 0.2; /* darker colours would be black when shaded */
    static const double ends[2][3] = {{0.13, 0.40, 0.67}, {0.70, 0.09, 0.17}}, middle = 0.95;
    t = fmin(fmax(t, 0), 1);
    if (map == COLORMAP_VIRIDIS) {
        colormap_viridis(start + (1 - start) * t, srgb);
        return;
    }
    for (int k = 0; k < 3; k++)
        srgb[k] = map == COLORMAP_GRAY ? gray_start + (1 - gray_start) * t
                                       : middle + fabs(2 * t - 1) * (ends[t > 0.5][k] - middle);
}

double colormap_linear(double srgb)
{
    /* IEC 61966-2-1 */
    return srgb <= 0.04045 ? srgb / 12.92 : elementary_pow((srgb + 0.055) / 1.055, 2.4);
}

bool colormap_scale_of(const double *values, size_t count, bool root, double least, colormap_scale *out,
                       error *e)
{
    size_t samples = count < PERCENTILE_SAMPLES ? count : PERCENTILE_SAMPLES;
    double *sorted = mem_array(samples, sizeof *sorted, "the colour scale", e);
    if (!sorted) return false;
    for (size_t i = 0; i < samples; i++)
        sorted[i] = values[samples == count ? i : (size_t)((double)i / (double)samples * (double)count)];
    qsort(sorted, samples, sizeof *sorted, compare_doubles);
    double low = samples ? sorted[(size_t)(low_share * (double)(samples - 1))] : 0;
    double high = samples ? sorted[(size_t)ceil(high_share * (double)(samples - 1))] : 1;
    free(sorted);
    double middle = 0.5 * (low + high);
    least = fmax(min_range * fabs(middle), least);
    if (high - low < least) {
        low = middle - 0.5 * least;
        high = middle + 0.5 * least;
    }
    if (root && low < 0) { /* the range was extended below 0 */
        high -= low;
        low = 0;
    }
    *out = (colormap_scale){low, high, root, COLORMAP_VIRIDIS};
    return true;
}

double colormap_scale_place(const colormap_scale *s, double value)
{
    double a = s->low, b = s->high;
    if (s->root) {
        a = sqrt(a);
        b = sqrt(b);
        value = sqrt(fmax(value, 0));
    }
    return fmin(fmax((value - a) / (b - a), 0), 1);
}

double colormap_scale_value(const colormap_scale *s, double t)
{
    if (!s->root) return s->low + t * (s->high - s->low);
    double a = sqrt(s->low), root = a + t * (sqrt(s->high) - a);
    return root * root;
}

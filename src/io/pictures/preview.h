// SPDX-License-Identifier: Apache-2.0
/* preview: renders a point set as shaded discs in its tangent planes.
 *
 * Every point is a disc of about its local spacing, coloured by a quantity. Dark, slightly larger discs just
 * below ("bodies") close the gaps, so that the far side does not show through and the packing is visible.
 * Discs seen from behind, inside an open surface, are dark. Discs of few pixels merge, so that a million
 * points look like a surface.
 *
 * The picture is computed from 3 x 3 samples per pixel. The data of a pixel (preview_span) are those of its
 * centre sample and are never averaged. The same points and options give the same bytes, for any number of
 * threads. Any number of threads may read a finished image.
 */
#ifndef HEXAD_IO_PICTURES_PREVIEW_H
#define HEXAD_IO_PICTURES_PREVIEW_H

#include <stdbool.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "io/pictures/camera.h"
#include "io/points/colormap.h"
#include "io/points/points.h"
#include "io/points/quantity.h"

enum { PREVIEW_SIZE_MIN = 64, PREVIEW_SIZE_MAX = 8192 };

/* Depth of an empty pixel: larger than any depth, so that the depth test of a compositor puts it behind, and
 * finite, so that filters give no NaN. */
#define PREVIEW_FAR 1e30f

typedef struct preview_options {
    int width, height; /* pixels, PREVIEW_SIZE_MIN .. PREVIEW_SIZE_MAX */
    quantity_look color;
    const camera_place *camera; /* NULL: a camera that shows the whole set */
    bool y_up;                  /* y, not z, points up */
    /* Discs would cover each other: they are drawn smaller, and the legend has the reason. */
    bool thin;
} preview_options;

typedef struct image {
    int width, height;
    unsigned char *rgb; /* 3 bytes per pixel, sRGB, with background and legend */
    uint16_t *rgba;     /* 4 per pixel, half floats: linear light, premultiplied by coverage, no legend */
    uint32_t *hit;      /* private: code of the centre sample of each pixel */
    points points;      /* not owned; its arrays outlive the image */
    camera camera;
    vec3 up; /* in camera space */
    double scale_of_discs;
    double radius_max;    /* maximum radius of a disc, world units */
    double extent;        /* half diagonal of the set's box, > 0 */
    double far;           /* orthographic cameras: an upper bound of all depths */
    colormap_scale scale; /* of the colours */
} image;

/* Draws the set. The caller frees *out with preview_free. Errors: internal (an empty set, values that are not
 * finite or exceed 1e25; the solver never returns such), limit_memory, cancelled. */
bool preview_render(const points *set, const preview_options *options, threads *pool, image **out, error *e);

/* The `frames` cameras of a turntable around the set, for preview_render_from. The set is valid for
 * preview_render. */
void preview_orbit(const points *set, const preview_options *options, int frames, camera *out);
bool preview_render_from(const points *set, const preview_options *options, const camera *from, threads *pool,
                         image **out, error *e);

void preview_free(image *picture); /* accepts NULL */

/* A run of pixels of a row whose centres show the same point, or nothing. */
typedef struct preview_span {
    int end;     /* last pixel plus 1 */
    uint32_t id; /* index of the point plus 1; 0: empty, and the other members are 0 */
    vec3 normal;
    double kappa, spacing;
    vec3 center, plane; /* the disc in camera space; plane: its normal */
    double radius;
} preview_span;

/* The span that starts at pixel x of row y. */
preview_span preview_span_at(const image *picture, int x, int y);

/* The place in camera space (the third coordinate is the depth) at the centre of pixel (x, y) of the span. */
vec3 preview_place(const image *picture, const preview_span *span, int x, int y);

/* The depths of the pixels of the span from x. */
void preview_depths(const image *picture, const preview_span *span, int x, int y, float *depth);

#endif

/* preview: a point set as a picture, shaded discs in their tangent planes.
 *
 * Every point is a disc of about its local spacing, coloured by a quantity; a dark body of slightly
 * larger discs, sunk a little below them, closes the gaps, so that the far side does not show
 * through and the packing can be seen. Discs seen from behind, inside an open surface, are dark.
 * Discs of few pixels grow together, so that a million points look like a surface.
 *
 * The picture is computed from 3 x 3 samples a pixel; the data of a pixel (preview_sample) belong
 * to its centre sample alone and are never averaged. The same points and options give the same
 * bytes, drawn by any number of threads; any number may read a finished image.
 */
#ifndef HEXAD_FORMATS_PREVIEW_H
#define HEXAD_FORMATS_PREVIEW_H

#include <stdbool.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "formats/camera.h"
#include "formats/colormap.h"
#include "formats/points.h"
#include "formats/quantity.h"

enum { PREVIEW_SIZE_MIN = 64, PREVIEW_SIZE_MAX = 8192 };

/* Depth of a pixel that shows nothing: farther than anything, so that depth tests of a compositor
 * put it behind, yet finite, so that its filters make no NaN of it. */
#define PREVIEW_FAR 1e30f

typedef struct preview_options {
    int width, height; /* pixels, PREVIEW_SIZE_MIN .. PREVIEW_SIZE_MAX */
    quantity_look color;
    const camera_place *camera; /* NULL: one that sees all of the set */
    bool y_up;                  /* y is up, not z */
    bool unresolved; /* discs would cover each other: they are drawn smaller, and the legend says why */
} preview_options;

typedef struct image {
    int width, height;
    unsigned char *rgb; /* 3 a pixel, sRGB, on a neutral background, with the legend */
    uint16_t *rgba;     /* 4 a pixel, half floats: linear light, multiplied by coverage, no legend */
    uint32_t *hit;      /* private: what the centre sample shows */
    points points;      /* borrowed: its arrays must outlive the image */
    camera camera;
    vec3 up; /* in camera space */
    double scale_of_discs;
    double radius_max;    /* no disc is larger, world units */
    double extent;        /* half diagonal of the set's box, > 0 */
    double far;           /* parallel cameras: no disc is as deep */
    colormap_scale scale; /* of the colours */
} image;

/* What stands at the centre of a pixel. */
typedef struct preview_sample {
    uint32_t id;   /* index of the point plus one; 0: nothing, then the rest is 0 and depth PREVIEW_FAR */
    float depth;   /* along the camera's axis, world units */
    vec3 position; /* on the disc, world space */
    vec3 normal;   /* of the disc */
    double kappa, spacing; /* kappa and achieved spacing of the point */
} preview_sample;

/* Draws the set; the caller frees with preview_free. An empty set, values that are not finite and
 * lengths beyond 1e25 are errors (internal: the solver never delivers such); cancelled when the pool was
 * told to stop. */
bool preview_render(const points *set, const preview_options *options, threads *pool, image **out, error *e);

/* The cameras of a turn around the set, for preview_render_from: `frames` of them. The set is one that
 * preview_render draws. */
void preview_orbit(const points *set, const preview_options *options, int frames, camera *out);
bool preview_render_from(const points *set, const preview_options *options, const camera *from, threads *pool,
                         image **out, error *e);

void preview_free(image *picture); /* accepts NULL */

/* The centre sample of pixel (x, y), counted from the top left. */
preview_sample preview_at(const image *picture, int x, int y);

/* What the centres of neighbouring pixels of a row show: one point's disc, or nothing. */
typedef struct preview_span {
    int end;     /* the first pixel beyond */
    uint32_t id; /* and what follows: as in preview_sample */
    vec3 normal;
    double kappa, spacing;
    vec3 center, plane; /* the disc in camera space; plane: its normal */
    double radius;
} preview_span;

/* From pixel x of row y on. */
preview_span preview_span_at(const image *picture, int x, int y);

/* The place in camera space, whose third coordinate is the depth, that pixel (x, y) of the span shows. */
vec3 preview_place(const image *picture, const preview_span *span, int x, int y);

/* The depths of all pixels of the span from x on. */
void preview_depths(const image *picture, const preview_span *span, int x, int y, float *depth);

#endif

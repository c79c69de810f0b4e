// SPDX-License-Identifier: Apache-2.0
/* disc: rasterises discs in space into bands of samples of a picture, with a depth test.
 *
 * The extent of a disc in a row of samples follows from the roots of a quadratic. For the depth test, discs
 * are cones: depth increases towards the rim. The same discs in the same order give the same samples on every
 * machine. Bands are independent of each other.
 */
#ifndef HEXAD_IO_PICTURES_DISC_H
#define HEXAD_IO_PICTURES_DISC_H

#include <stdbool.h>
#include <stdint.h>

#include "io/pictures/camera.h"

/* Samples along each side of a pixel: odd, so that the centre sample is at the centre of the pixel. */
enum { DISC_SAMPLES = 3 };

/* Code of a sample: 0: empty; otherwise index + 1 with these flags. */
#define DISC_BODY 0x80000000u
#define DISC_RING 0x40000000u
#define DISC_INDEX 0x3FFFFFFFu

/* A disc in camera space. */
typedef struct disc {
    vec3 center, normal;
    double radius;
    double cone; /* added to the depth at the rim, for the depth test */
    uint32_t code;
    bool ring; /* its outline is drawn with DISC_RING */
} disc;

/* Number of samples drawn at a time. */
enum { DISC_BLOCK = 16 };

/* Rows of a picture. The caller owns the arrays and zeroes them. Arrays of samples extend DISC_BLOCK elements
 * beyond the last row. */
typedef struct disc_band {
    int width, top, rows; /* in samples */
    float *key;           /* inverse depth, with the cone; the maximum wins; 0: empty */
    uint32_t *code;
    int (*drawn)[2]; /* per row: the first sample that is not empty, and the last one plus 1 */
    float *farthest; /* per tile: the minimum key, see disc_band_note_tiles */
} disc_band;

size_t disc_band_tiles(int width, int rows); /* number of tiles of a band */

void disc_band_begin(const disc_band *b); /* call it before the first disc */
void disc_band_empty(const disc_band *b); /* clears the samples that were drawn */

/* A bounding ball of discs, in camera space; it does not contain the eye. */
typedef struct disc_ball {
    vec3 center;
    double radius;
} disc_ball;

/* The first and the last of `rows` rows of samples that the ball, or a dot at its centre, may cover. first >
 * last: none. */
void disc_ball_rows(const camera *c, const disc_ball *ball, int rows, int *first, int *last);

/* Updates `farthest` from the samples drawn so far, for disc_ball_is_hidden. */
void disc_band_note_tiles(const disc_band *b);

/* Whether closer samples cover all rows and columns of the ball: drawing its contents would change
 * nothing. */
bool disc_ball_is_hidden(const camera *c, double far, const disc_ball *ball, const disc_band *b);

/* `far`: an upper bound of all depths, for orthographic cameras. */
void disc_draw(const camera *c, double far, const disc *d, const disc_band *b);

/* Draws the disc as one sample: discs smaller than a pixel may fall between samples. */
void disc_draw_dot(const camera *c, double far, const disc *d, const disc_band *b);

#endif

/* disc: discs in space, drawn into bands of samples of a picture, the nearest in front.
 *
 * Each row of a disc lies between the roots of a quadratic. Discs that overlap are cones as far as the order goes: depth
 * grows towards the rim. The same discs in the same order give the same samples on every machine. Bands do not depend on
 * each other.
 */
#ifndef HEXAD_FORMATS_DISC_H
#define HEXAD_FORMATS_DISC_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/camera.h"

/* Samples along each side of a pixel: an odd number, so that the middle one is the pixel's centre. */
enum { DISC_SAMPLES = 3 };

/* A sample's code: 0 nothing, else index + 1 with these marks. */
#define DISC_BODY 0x80000000u
#define DISC_RING 0x40000000u
#define DISC_INDEX 0x3FFFFFFFu

/* A disc in camera space. */
typedef struct disc {
    vec3 center, normal;
    double radius;
    double cone; /* added to the depth test at the rim */
    uint32_t code;
    bool ring; /* its outline is drawn with DISC_RING */
} disc;

/* Samples are drawn so many at a time. */
enum { DISC_BLOCK = 16 };

/* Some rows of a picture. The arrays are the caller's, zeroed; those of samples end DISC_BLOCK beyond the last row. */
typedef struct disc_band {
    int width, top, rows; /* in samples */
    float *key;           /* inverse depth, with the cone: the greatest wins; 0 where nothing is */
    uint32_t *code;
    int (*drawn)[2]; /* of each row the first sample that is not empty, and that beyond the last */
    float *farthest; /* of each tile the least key, as disc_band_note_tiles finds it */
} disc_band;

size_t disc_band_tiles(int width, int rows); /* how many tiles such a band has */

void disc_band_begin(const disc_band *b); /* before the first disc */
void disc_band_empty(const disc_band *b); /* zeroes what was drawn */

/* What holds discs, in camera space; it does not reach the eye. */
typedef struct disc_ball {
    vec3 center;
    double radius;
} disc_ball;

/* The first and last of `rows` rows of samples that the ball may cover, and a dot at its centre; first > last if there are none. */
void disc_ball_rows(const camera *c, const disc_ball *ball, int rows, int *first, int *last);

/* Looks at what is drawn so far, for disc_ball_is_hidden. */
void disc_band_note_tiles(const disc_band *b);

/* Whether something nearer was there already wherever the ball may be: to draw what it holds would change nothing. */
bool disc_ball_is_hidden(const camera *c, double far, const disc_ball *ball, const disc_band *b);

/* `far`: no disc is as deep, for parallel cameras. */
void disc_draw(const camera *c, double far, const disc *d, const disc_band *b);

/* One sample: a disc without a pixel's extent may fall between them. */
void disc_draw_dot(const camera *c, double far, const disc *d, const disc_band *b);

#endif

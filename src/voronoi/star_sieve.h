/* star_sieve: which triangles of a point and those around may be of the surface (voronoi.h), told in single precision for many at
 * once. None is left out that voronoi.c would take; of a fog's that stay four in five are taken. Pure functions, safe in any thread.
 */
#ifndef HEXAD_VORONOI_STAR_SIEVE_H
#define HEXAD_VORONOI_STAR_SIEVE_H

#include "voronoi/voronoi.h"

/* Triangles of a larger circumradius, in spacings, span a hole or reach across a boundary. An ideal one has 0.58,
 * those of a vacancy 1. */
#define STAR_WIDEST 1.5
/* So much of the line of places that are as far from three points, in spacings, is looked at either way at least. */
#define STAR_DEEP 0.5

/* A point and those around, nearest first. */
typedef struct star_around {
    uint32_t count; /* at most VORONOI_STAR_MAX */
    vec3 at, normal;
    double spacing;
    const double *x, *y, *z, *nx, *ny, *nz, *other; /* places, normals and spacings of those around */
    const double *square;                           /* how far each and all behind it are at least, squared */
} star_around;

/* Those around from the one at hand and over its spacing. */
typedef struct star_sieve {
    uint32_t count;
    float x[VORONOI_STAR_MAX], y[VORONOI_STAR_MAX], z[VORONOI_STAR_MAX];
    float nx[VORONOI_STAR_MAX], ny[VORONOI_STAR_MAX], nz[VORONOI_STAR_MAX];
    float widest[VORONOI_STAR_MAX]; /* twice the widest circumradius there */
    float finest[VORONOI_STAR_MAX]; /* the lesser of both spacings */
    float square[VORONOI_STAR_MAX];
    float own_nx, own_ny, own_nz, loose;
} star_sieve;

void star_sieve_fill(const star_around *around, star_sieve *out);

/* Of `count` thirds (places in the sieve, not `at`) it leaves those whose triangles with the point at hand and the one at `at` may
 * be of the surface, in their order, and returns how many. `by` receives who takes most of each one's line of places that are as far
 * from its corners, on either side; -1: nobody. It is a guess: another may take a little more. */
uint32_t star_sieve_thirds(const star_sieve *s, uint32_t at, uint32_t count, uint32_t third[VORONOI_STAR_MAX],
                           int32_t by[VORONOI_STAR_MAX][2]);

#endif

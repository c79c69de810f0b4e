/* spline: uniform cubic B-splines in three variables, from a block of coefficients.
 *
 * A brick holds the coefficients that the 8^3 cells of a block need: 11^3 of them, from -1 to +9
 * along each axis relative to the block's lowest voxel, contiguous, the third axis fastest.
 * Source: Unser 1999, "Splines: A Perfect Fit for Signal and Image Processing", box 2.
 */
#ifndef HEXAD_VOLUME_SPLINE_H
#define HEXAD_VOLUME_SPLINE_H

#define SPLINE_BRICK_SIDE 11
#define SPLINE_BRICK_SIZE (SPLINE_BRICK_SIDE * SPLINE_BRICK_SIDE * SPLINE_BRICK_SIDE)

/* A value with its derivatives along the index axes, per voxel. */
typedef struct spline_jet {
    double f;
    double d[3];               /* x, y, z */
    double xx, yy, zz, xy, xz, yz;
} spline_jet;

/* At the point `t` (each component in [0, 1]) of cell `cell` (each in 0..7) of the brick.
 * spline_gradient leaves the second derivatives untouched. */
void spline_gradient(const float *brick, const int cell[3], const double t[3], spline_jet *out);
void spline_hessian(const float *brick, const int cell[3], const double t[3], spline_jet *out);

#endif

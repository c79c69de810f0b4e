// SPDX-License-Identifier: Apache-2.0
/* quaternion: unit quaternions x y z w that turn +z to a normal. Pure functions.
 *
 * The rotation first turns about +z by an angle, the twist, and then turns +z to the normal by the
 * shortest way. */
#ifndef HEXAD_IO_POINTS_QUATERNION_H
#define HEXAD_IO_POINTS_QUATERNION_H

#include "geometry/space/vec3.h"

/* `normal` is a unit vector, `twist` in radians. w >= 0. For a normal along -z the rotation is about +x. */
void quaternion_of_normal(vec3 normal, double twist, double out[4]);

/* The twist with which +x turns to the direction of `along`, projected onto the plane of the normal. 0 if
 * this has no length. */
double quaternion_twist_along(vec3 normal, vec3 along);

/* q x q^-1 */
vec3 quaternion_rotate(const double q[4], vec3 x);

#endif

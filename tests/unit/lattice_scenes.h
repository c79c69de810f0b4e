// SPDX-License-Identifier: Apache-2.0
/* lattice_scenes: surfaces whose points form a perfect lattice with the spacing 1. Release them with
 * scene_free. */
#ifndef HEXAD_TESTS_LATTICE_SCENES_H
#define HEXAD_TESTS_LATTICE_SCENES_H

#include "measured_scene.h"

#define ROW 0.86602540378443864676 /* distance of two rows of the lattice */

/* An open rectangle in z = 0 of n spacings by rows - 1 rows (odd `rows`). Two sides are rows of points. The
 * other two sides are zigzags: every second row has a point on the side. */
scene scene_rectangle(int n, int rows);
scene scene_open_triangle(int n); /* equilateral, n spacings per side */

/* A closed box of the size of scene_rectangle, between z = 0 and z = thickness. Both walls have the points of
 * the rectangle. The rims have no points except those on the edges of the walls. */
scene scene_plate(int n, int rows, double thickness);
scene scene_cube(int n); /* with a square grid on each face */

/* An open tube with rings of n points. Neighbours are exactly one spacing apart in space. */
scene scene_tube(int n, int rows);

/* A torus with `rows` rows of n points around its axis. Spacings vary from 0.7 to 1.3. */
scene scene_torus(int n, int rows);

/* Regular solids with n spacings per side, centred at the origin. */
scene scene_tetrahedron(int n);
scene scene_octahedron(int n);
scene scene_icosahedron(int n);

/* A sphere of radius 1 centred at the origin, of triangles between meridians and parallels, without
 * points. */
scene scene_sphere(int along, int around);

/* Half planes of n spacings by `rows` - 1 rows that meet in the x axis, at these angles to the y axis. */
scene scene_half_planes(int n, int rows, const double *angle, int count);

/* Two concentric icosahedra with n spacings per side. The inner one and its spacings are smaller by this
 * factor. */
scene scene_shells(int n, double factor);

#endif

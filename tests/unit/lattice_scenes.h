/* lattice_scenes: surfaces on which points lie in perfect order, one spacing of 1 apart. To be released by scene_free. */
#ifndef HEXAD_TESTS_LATTICE_SCENES_H
#define HEXAD_TESTS_LATTICE_SCENES_H

#include "measured_scene.h"

#define ROW 0.86602540378443864676 /* distance of two rows */

/* An open rectangle in z = 0 of n spacings by rows - 1 rows (odd `rows`). Two sides hold rows; the other two are zigzags of which every second row
 * has a point on the side. */
scene scene_rectangle(int n, int rows);
scene scene_open_triangle(int n); /* an equilateral triangle of n spacings a side */

/* A closed box of that rectangle's size between z = 0 and z = thickness, with that rectangle's points on both walls and none on its rims, but for
 * those on their edges. */
scene scene_plate(int n, int rows, double thickness);
scene scene_cube(int n); /* a square grid on each of its faces */

/* An open tube with rings of n points; neighbours are exactly one spacing apart in space. */
scene scene_tube(int n, int rows);

/* Rows along the long way round: `rows` of n points. Spacings vary from 0.7 to 1.3. */
scene scene_torus(int n, int rows);

/* Regular solids of n spacings a side around the origin. */
scene scene_tetrahedron(int n);
scene scene_octahedron(int n);
scene scene_icosahedron(int n);

/* A sphere of radius 1 around the origin, of triangles between meridians and parallels. It has no points. */
scene scene_sphere(int along, int around);

/* Half planes of n spacings by `rows` - 1 rows that meet in the x axis, at these angles from the y axis. */
scene scene_half_planes(int n, int rows, const double *angle, int count);

/* Two icosahedra around the origin with n spacings a side, the inner one smaller by this factor and with spacings as much smaller. */
scene scene_shells(int n, double factor);

#endif

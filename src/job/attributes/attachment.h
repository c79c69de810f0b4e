// SPDX-License-Identifier: Apache-2.0
/* attachment: positions of points on the mesh files of a surface, and the same positions in other frames of
 * the meshes.
 *
 * The position of a point is stored as a polygon of a file, three of its corners and their barycentric
 * weights, so that the file suffices to evaluate it: position = sum of weight[k] * vertex(corner[k]). Indices
 * begin at 0 and follow the order of the file. Two meshes have the same topology if their polygons have the
 * same vertex indices. World space; `to_world` transforms a file to it. One thread.
 */
#ifndef HEXAD_JOB_ATTRIBUTES_ATTACHMENT_H
#define HEXAD_JOB_ATTRIBUTES_ATTACHMENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "io/points/points.h"
#include "geometry/space/vec3.h"
#include "io/meshes/mesh_array.h"
#include "surface/triangles/mesh_patches.h"

/* The properties that determine the indices of polygons, corners and vertices. */
typedef struct attachment_topology {
    uint64_t vertices, faces, corners; /* corners: of all polygons */
    uint64_t hash;                     /* of the vertices of all corners */
} attachment_topology;

/* attachment_comment: the comment line of points.ply with the topology of mesh `index`, without its line end;
 * the caller frees it. attachment_parse_comment returns false if the line is another one. */
char *attachment_comment(size_t index, const attachment_topology *topology);
bool attachment_parse_comment(const char *line, size_t *index, attachment_topology *out);

typedef struct attachment_file {
    int fd;                  /* open for reading, at any offset; stays the caller's */
    const char *path;        /* for messages; its extension determines the format */
    const mesh_array *array; /* read instead of the file; or NULL */
    double to_world[3][4];
    attachment_topology topology; /* result of attachment_find; required by attachment_evaluate */
} attachment_file;

/* The arrays that store the positions, in the order of points: attributes with a common name and these
 * suffixes. */
enum { ATTACHMENT_MESH, ATTACHMENT_FACE, ATTACHMENT_CORNER, ATTACHMENT_WEIGHT, ATTACHMENT_ARRAYS };

typedef struct attachment_array {
    const char *suffix;
    point_attribute_kind kind;
    int components;
    bool is_double; /* in every format that has doubles */
} attachment_array;

extern const attachment_array attachment_arrays[ATTACHMENT_ARRAYS];

/* Maximum distance of a point from its mesh, in requested spacings of the point. Points of level sets are
 * projected onto the triangles. Points on caps of a region, or in a blend of parts, are farther away. */
#define ATTACHMENT_TOLERANCE 0.05

typedef struct attachment_counts {
    size_t outside;  /* number of points that lie on no mesh; their indices are -1 */
    double distance; /* largest distance of the other points from their stored positions, in spacings */
} attachment_counts;

/* Finds the nearest position on all meshes; of equal distances the first mesh. On an edge, the face is the one
 * whose normal is most nearly parallel to the point's normal (mesh_place.h). The corners are counter-clockwise seen
 * from the side of the point's normal, and begin with the lowest index. Sets the topology of each file. Errors: those of mesh_file_read, prefixed with the path. */
bool attachment_find(attachment_file *files, size_t file_count, size_t memory_limit, size_t count,
                     const vec3 *position, const vec3 *normal, const double *spacing,
                     double *const values[ATTACHMENT_ARRAYS], attachment_counts *counts, error *e);

/* Evaluates position and normal of the points with a stored position; others are unchanged. A normal is
 * interpolated between the normals at the three corners. The normal at a corner is the mean of the normals of
 * the polygons there that deviate from the point's own polygon by at most ATTACHMENT_CREASE, weighted by
 * their angles there. Polygons that the file orients the other way are reversed: across edges of two
 * polygons their order of vertices decides, so that the faces of a sharp edge do not count as one. Errors: input_unsupported (the topology differs; the message has the difference),
 * input_damaged (an index is beyond the mesh), those of mesh_file_read. */
bool attachment_evaluate(const attachment_file *files, size_t file_count, size_t memory_limit, size_t count,
                         const double *const values[ATTACHMENT_ARRAYS], vec3 *position, vec3 *normal,
                         error *e);

#define ATTACHMENT_CREASE MESH_PATCHES_ANGLE /* radians */

#endif

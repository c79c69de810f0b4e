/* attachment: where points lie on the mesh files of a surface, and where these places are in other frames of the meshes.
 *
 * The place of a point is a polygon of a file, three of its corners and their barycentric weights, so that it can be evaluated from the file
 * alone: position = sum of weight[k] * vertex(corner[k]). Numbers begin at 0 and follow the order of the file. Two meshes have the same
 * topology if their polygons have the same vertices, by their numbers. World space; `to_world` moves a file to it. One thread.
 */
#ifndef HEXAD_ATTRIBUTE_ATTACHMENT_H
#define HEXAD_ATTRIBUTE_ATTACHMENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "formats/points.h"
#include "geometry/vec3.h"
#include "mesh/mesh_patches.h"

/* What determines the numbers of polygons, corners and vertices. */
typedef struct attachment_topology {
    uint64_t vertices, faces, corners; /* corners: of all polygons */
    uint64_t hash;                     /* of the vertices of all corners */
} attachment_topology;

/* The comment line of points.ply with the topology of mesh `index`, without its line end; the caller frees it. Parsing: false if the line is
 * another one. */
char *attachment_comment(size_t index, const attachment_topology *topology);
bool attachment_parse_comment(const char *line, size_t *index, attachment_topology *out);

typedef struct attachment_file {
    int fd;           /* open for reading, at any offset; stays the caller's */
    const char *path; /* for messages; its ending determines the format */
    double to_world[3][4];
    attachment_topology topology; /* result of attachment_find; required by attachment_evaluate */
} attachment_file;

/* The arrays of places, in the order of points: attributes of points with a common name and these suffixes. */
enum { ATTACHMENT_MESH, ATTACHMENT_FACE, ATTACHMENT_CORNER, ATTACHMENT_WEIGHT, ATTACHMENT_ARRAYS };

typedef struct attachment_array {
    const char *suffix;
    point_attribute_kind kind;
    int components;
    bool is_double; /* in every format that has doubles */
} attachment_array;

extern const attachment_array attachment_arrays[ATTACHMENT_ARRAYS];

/* Largest distance from its mesh of a point that lies on it, in requested spacings of the point. The points of level sets are projected onto the
 * triangles, and those on caps of a region or in a blend of parts are farther away. */
#define ATTACHMENT_TOLERANCE 0.05

typedef struct attachment_counts {
    size_t outside;  /* points that lie on no mesh; all their numbers are -1 */
    double distance; /* largest distance of the other points from their places, in spacings */
} attachment_counts;

/* Finds the places: the nearest of all meshes, the first one at equal distances. The corners are counter-clockwise seen from the
 * side of the point's normal, and begin with the least one. Sets the topology of each file. Errors: those of mesh_file_read,
 * prefixed with the path. */
bool attachment_find(attachment_file *files, size_t file_count, size_t memory_limit, size_t count,
                     const vec3 *position, const vec3 *normal, const double *spacing,
                     double *const values[ATTACHMENT_ARRAYS], attachment_counts *counts, error *e);

/* Evaluates position and normal of the points that have a place; others are not changed. A normal is interpolated between the normals at the
 * three corners. The normal at a corner is the mean of the normals of the polygons at its place that deviate from the polygon's own by at most
 * ATTACHMENT_CREASE, weighted by their angles there. Errors: input_unsupported (the topology differs; the message says in what),
 * input_damaged (a place that the mesh does not have), those of mesh_file_read. */
bool attachment_evaluate(const attachment_file *files, size_t file_count, size_t memory_limit, size_t count,
                         const double *const values[ATTACHMENT_ARRAYS], vec3 *position, vec3 *normal,
                         error *e);

#define ATTACHMENT_CREASE MESH_PATCHES_ANGLE /* radians */

#endif

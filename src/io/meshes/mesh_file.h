// SPDX-License-Identifier: Apache-2.0
/* mesh_file: a mesh from an open file, read by a process of its own (see mesh_reader). */
#ifndef HEXAD_IO_MESHES_MESH_FILE_H
#define HEXAD_IO_MESHES_MESH_FILE_H

#include <stddef.h>

#include "base/core/error.h"
#include "base/core/reader.h"
#include "geometry/mesh/mesh.h"
#include "io/meshes/mesh_reader.h"
#include "io/meshes/mesh_textures.h"

typedef struct mesh_file {
    int fd;           /* open for reading, a regular file; its offset does not matter. It is not closed. */
    const char *path; /* its ending determines the format */
    /* path of a program whose commands of mesh_reader.h call mesh_reader_main; NULL: this program itself */
    const char *program;
    size_t memory_limit; /* bytes: for the reading process, and again for the mesh */
} mesh_file;

/* Reads the triangles of a file. Every count, number and index of the answer is checked. The mesh is not
 * welded. Adds warnings to *notes, some of them possibly also on failure. *out is unchanged on failure; free
 * it with mesh_free after success. Errors, which do not name the file:
 * - input_damaged: also if the reading process crashes, or takes more than 60 s of CPU time and 1 s for each
 *   MiB of the file;
 * - input_unsupported;
 * - no_surface: there is no triangle;
 * - limit_memory;
 * - internal: the process cannot be started. */
bool mesh_file_read(const mesh_file *file, mesh *out, mesh_notes *notes, error *e);

/* Attributes of the vertices of a mesh other than their positions: numbers, normals, colours, ... Each array
 * has values of all vertices. */
typedef struct mesh_values {
    size_t count;             /* number of arrays */
    mesh_reader_values *head; /* per array: name, kind, number of components */
    double **value;           /* per array: head.components numbers for each vertex, vertex by vertex */
} mesh_values;

/* mesh_file_read, and the attributes. The triangles are those of mesh_file_read. Where corners of faces have values,
 * as texture coordinates of OBJ, each corner of a face has a vertex of its own. Values of parts that do not have them
 * are NaN. `notes`: NULL if mesh_file_read adds the same ones. *out and *values are unchanged on failure; free both
 * after success. */
bool mesh_file_read_values(const mesh_file *file, mesh *out, mesh_values *values, mesh_notes *notes,
                           error *e);
void mesh_values_free(mesh_values *values);

/* Finds the array with this name, or NULL for none. Errors: attribute_missing, with the names that there are;
 * input_unsupported (several arrays have the name). */
bool mesh_values_find(const mesh_values *values, const char *name, size_t *which, error *e);

/* The polygons of a file, from which its triangles are cut. Polygon p has size[p] corners; its first one is
 * corner first[p] of all. Polygons are numbered from 0 in the order of the file, those of fewer than three
 * corners included. */
typedef struct mesh_polygons {
    size_t count, corners;
    uint32_t *size;   /* number of corners of each polygon */
    size_t *first;    /* count + 1 */
    uint32_t *corner; /* vertex of each corner */
} mesh_polygons;

/* Reads the mesh without repair, with its polygons. Errors: as mesh_file_read. Free *out and *polygons after
 * success. */
bool mesh_file_read_polygons(const mesh_file *file, mesh *out, mesh_polygons *polygons, error *e);
void mesh_polygons_free(mesh_polygons *polygons); /* accepts a zeroed object */

/* The polygon of each triangle of the mesh. The caller frees the array. NULL: limit_memory. */
uint32_t *mesh_polygons_of_triangles(const mesh_polygons *p, size_t triangles, error *e);

/* The first corner of a polygon that has the vertex, counted from its first one. A vertex may occur twice. */
uint32_t mesh_polygons_find_corner(const mesh_polygons *p, uint32_t polygon, uint32_t vertex);

/* Reads the mesh without repair, with its textures and the values that belong to them (mesh_textures.h). Libraries and
 * images that are files are named, not read. Notes, errors: as mesh_file_read; input_unsupported: other formats than
 * OBJ, PLY, glTF, 3MF and COLLADA. Free *out, *values and *textures after success. */
bool mesh_file_read_textures(const mesh_file *file, mesh *out, mesh_values *values, mesh_textures *textures,
                             mesh_notes *notes, error *e);

/* Reads a file of materials (MTL). Errors: as mesh_file_read_textures. */
bool mesh_file_read_materials(const mesh_file *file, mesh_textures *textures, error *e);

/* Points of a PLY or NPZ file: its vertices, in double precision. The caller frees *out. Errors:
 * input_damaged (also for a coordinate that is not finite, with its row, from 0), input_unsupported
 * (another ending), limit_memory. */
bool mesh_file_read_points(const mesh_file *file, vec3 **out, size_t *count, error *e);

/* Reads and checks only the answer of the reader process, as mesh_file_parse does. */
bool mesh_file_parse_points(reader *r, size_t memory_limit, vec3 **out, size_t *count, error *e);

/* Reads and checks only the answer of the reader process, from its first byte to its end. *header receives
 * the header of the answer. *notes receives its warnings. `values`, `polygons`, `textures`: NULL if the answer
 * has none; otherwise zeroed before the call, and to be freed with mesh_values_free, mesh_polygons_free and
 * mesh_textures_free, also after failure. *out is unchanged on failure.
 * Errors: as mesh_file_read. */
bool mesh_file_parse(reader *r, size_t memory_limit, mesh_reader_header *header, mesh *out, mesh_notes *notes,
                     mesh_values *values, mesh_polygons *polygons, mesh_textures *textures, error *e);

/* Reads and checks only the part of the answer that has the textures. */
bool mesh_file_parse_textures(reader *r, size_t memory_limit, mesh_textures *out, error *e);

#endif

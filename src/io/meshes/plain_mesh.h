// SPDX-License-Identifier: Apache-2.0
/* plain_mesh: OBJ, PLY, STL, VTK, GIfTI, OFF, glTF and 3MF files, and points of NPZ files, read without a
 * library, in the precision that they have.
 *
 * A reader reads a whole file, or refuses it with a message that gives the place. glTF and 3MF have a third
 * result: a file with contents that are not supported here is left to the library assimp
 * (mesh_reader.h). Runs in the process that reads. Threads: none.
 */
#ifndef HEXAD_IO_MESHES_PLAIN_MESH_H
#define HEXAD_IO_MESHES_PLAIN_MESH_H

#include <stdarg.h>
#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/file_format.h"
#include "base/xml/xml.h"
#include "io/meshes/mesh_reader.h"

typedef struct plain_textures plain_textures;

/* An array of values of the vertices. */
typedef struct plain_values {
    mesh_reader_values head;
    float *value; /* head.components numbers for each vertex, vertex by vertex */
} plain_values;

typedef struct plain_mesh_unusable {
    uint32_t vertex;
    const char *at;
} plain_mesh_unusable;

typedef struct plain_mesh {
    size_t vertices, triangles, others; /* others: points and lines */
    size_t crossed;                     /* polygons that cross themselves */
    double (*vertex)[3];
    uint32_t (*triangle)[3];
    uint32_t *corner;                               /* scratch: corners of the polygon that is being read */
    size_t vertex_room, triangle_room, corner_room; /* capacities, in entries */
    const volatile sig_atomic_t *stop;              /* as in array_view; of files: NULL */
    const char *vertex_at; /* set by readers of text: the place of the vertex that is added next; or NULL */
    plain_mesh_unusable *unusable; /* vertices that are not usable (mesh_check), with their places */
    size_t unusables, unusable_room;
    error_code refused;              /* ERROR_NONE: the file is not refused */
    char text[MESH_READER_TEXT_MAX]; /* of a refused file: the message; otherwise warnings, one a line */
    /* 3MF: factor that converts the coordinates of the file to millimetres; 0: there is none. `vertex` has
     * been multiplied already; if the library reads the file, the caller multiplies. */
    double unit;
    bool is_binary;        /* places in messages are bytes, not lines */
    bool is_quantised;     /* glTF: the coordinates are integers, which the library does not read */
    bool has_hidden_nodes; /* nodes that are not in `vertex`, and that the library places */
    bool keeps_polygons;   /* the polygons of the file are kept, in addition to the triangles */
    size_t polygons, polygon_corners;
    uint32_t *polygon_size;   /* number of corners of each polygon, in the order of the file */
    uint32_t *polygon_corner; /* vertices of the corners, polygon after polygon */
    size_t polygon_room, polygon_corner_room;
    bool keeps_values; /* values of the vertices are kept, by readers for which plain_mesh_reads_values */
    plain_values values[MESH_VALUES_MOST];
    uint32_t value_arrays;
    plain_textures *textures; /* of the polygons (plain_textures.h), owned by the caller; NULL: not wanted */
} plain_mesh;

/* Reads a file with the reader for `ending`, the extension of its name (any case). data[size] is 0. *out
 * need not be initialised. After success free it with plain_mesh_free. False: *out has no arrays, and there
 * is nothing to free; out->refused is the error, or ERROR_NONE if the file is left to the library. Formats
 * that only this reader reads (plain_mesh_is_only_reader) are never left to the library. */
bool plain_mesh_read(const char *ending, const char *data, size_t size, plain_mesh *out);

/* As plain_mesh_read, and keeps the polygons. */
bool plain_mesh_read_polygons(const char *ending, const char *data, size_t size, plain_mesh *out);

/* As plain_mesh_read, and keeps the values of the vertices. Requires plain_mesh_reads_values. */
bool plain_mesh_read_values(const char *ending, const char *data, size_t size, plain_mesh *out);

/* Whether this module reads the values of the vertices of files with this extension: VTK and GIfTI. */
bool plain_mesh_reads_values(const char *ending);

/* As plain_mesh_read_polygons, and reads the textures of OBJ, PLY, glTF and 3MF to *textures, which need not be
 * initialised. Free textures->all with mesh_textures_free in any case. */
bool plain_mesh_read_textures(const char *ending, const char *data, size_t size, plain_textures *textures,
                              plain_mesh *out);

/* Whether this module reads the textures of files with this extension. */
bool plain_mesh_reads_textures(const char *ending);

/* Whether this module reads the format. */
bool plain_mesh_reads(file_format format);

/* Whether only this module reads the mesh of files with this extension: OBJ, PLY, STL, OFF, VTK (.vtk,
 * .vtp), GIfTI and NPZ. (Attributes of the vertices of OBJ, PLY, STL and OFF files are read by the library, see
 * mesh_file_read_values.) */
bool plain_mesh_is_only_reader(const char *ending);

void plain_mesh_free(plain_mesh *m);

/* ---- the readers of the formats. *out is zeroed before the call. When a reader fails, *out keeps what was
 * read up to there: the caller frees it with plain_mesh_free. plain_mesh_read does so. */

bool plain_mesh_read_obj(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_ply(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_stl(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_off(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_gltf(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_3mf(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_vtk(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_gifti(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_npz(const char *data, size_t size, plain_mesh *out); /* points without triangles */
/* also a legacy VTK file whose name ends in .vtp */
bool plain_mesh_read_vtp(const char *data, size_t size, plain_mesh *out);

/* ---- functions for these readers */

/* Refuses the file, unless it is refused already; returns false. */
bool plain_mesh_refuse(plain_mesh *m, error_code code, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Refuses the file as damaged at the place `at`: "line 12 ...", or "byte 12 ..." if m->is_binary. */
bool plain_mesh_refuse_at(plain_mesh *m, const char *data, const char *at, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* Refuses the file with limit_memory. Returns false. */
bool plain_mesh_refuse_memory(plain_mesh *m);

/* Returns the file as a C string: the text behind the byte order mark, if there is one. Points into `data`.
 * NULL: the file is UTF-16, or has a byte 0 before other bytes, and is refused. */
const char *plain_mesh_text(const char *data, size_t size, plain_mesh *m);

/* Reads an XML document, whose `begin` has refused the file where it returns false. `what` names the file in
 * messages. False: the file is refused. */
bool plain_mesh_read_xml(plain_mesh *m, xml *document, const char *what);

/* Makes room for n items of an array, which grows by a factor. False: memory is out, and the file is refused. */
bool plain_mesh_make_room(plain_mesh *m, void **items, size_t *room, size_t n, size_t size);

/* Adds a line to a text. False: there is no room for it. */
bool plain_mesh_append(char *text, size_t size, const char *format, va_list arguments);

/* Adds a warning to m->text, unless there is no room for it. */
void plain_mesh_warn(plain_mesh *m, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Reserves room for the given number of entries. False, here and in the next four functions: the file is
 * refused, because memory is out or a stated limit is exceeded. */
bool plain_mesh_expect(plain_mesh *m, size_t vertices, size_t triangles);

/* Adds a vertex. At most 2^32 - 2 vertices. */
bool plain_mesh_add_vertex(plain_mesh *m, const double at[3]);

/* Reserves room for the given number of corners in m->corner. */
bool plain_mesh_expect_corners(plain_mesh *m, size_t corners);

/* Adds a polygon of existing vertices. A polygon of more than three corners is cut into triangles (see
 * polygon.h). False also if that takes too much work. A polygon with fewer than three corners is counted
 * in m->others. */
bool plain_mesh_add_polygon(plain_mesh *m, const uint32_t *corner, size_t corners);

/* Adds a triangle of existing vertices. Its orientation is reversed if `is_mirrored` (in a part that a
 * transformation mirrors). */
bool plain_mesh_add_triangle(plain_mesh *m, uint32_t a, uint32_t b, uint32_t c, bool is_mirrored);

/* Adds an array of values of all vertices that have been read. *out: its numbers, initially 0, to be set by the
 * caller; NULL if the array is not kept, because it has 0 or more than MESH_VALUES_COMPONENTS components, or because
 * there are MESH_VALUES_MOST arrays. False: memory is out. */
bool plain_mesh_add_values(plain_mesh *m, const char *name, mesh_values_kind kind, size_t components,
                           float **out);

/* Reads a decimal number, "nan" or "inf" at *at, and moves *at behind it. Blanks (spaces and tabs) may
 * precede it; a blank, an end of a line or the end of the text must follow it. Correctly rounded. False:
 * there is no such number. */
bool plain_mesh_number(const char **at, double *out);

#endif

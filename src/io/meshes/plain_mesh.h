// SPDX-License-Identifier: Apache-2.0
/* plain_mesh: OBJ, PLY, STL, VTK, GIfTI, OFF, glTF and 3MF files, and points of NPZ files, read without a
 * library, in the precision that they have.
 *
 * A reader reads a whole file, or refuses it with a message that gives the place. glTF has a third result: a
 * mesh that is compressed with Draco is left to the library assimp (library_mesh.h). Runs in the process that
 * reads. Threads: none.
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
    double *value;      /* head.components numbers for each vertex, vertex by vertex */
    size_t count, room; /* number of vertices that have their values; capacity, in vertices */
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
    bool is_binary;                  /* places in messages are bytes, not lines */
    const char *end;                 /* behind the content that the file declares; NULL: it declares none */
    size_t rest;                     /* offset of other data behind it; 0: there are none */
    bool needs_library;              /* the file is not refused, but left to the library */
    bool keeps_polygons;             /* the polygons of the file are kept, in addition to the triangles */
    size_t polygons, polygon_corners;
    uint32_t *polygon_size;   /* number of corners of each polygon, in the order of the file */
    uint32_t *polygon_corner; /* vertices of the corners, polygon after polygon */
    size_t polygon_room, polygon_corner_room;
    /* Values of the vertices are kept. What a file has for each corner of a polygon, such as texture coordinates
     * of OBJ, is that of a vertex of its own for each corner. */
    bool keeps_values;
    plain_values values[MESH_VALUES_MOST];
    uint32_t value_arrays;
    plain_textures
        *textures; /* materials and images (plain_textures.h), owned by the caller; NULL: not wanted */
} plain_mesh;

/* Reads a file of a format that plain_mesh_reads. data[size] is 0. Of *out the members keeps_polygons, keeps_values
 * and textures are set; the others are zero. After success free it with plain_mesh_free. False: *out has no arrays,
 * and there is nothing to free; out->needs_library, or out->refused is the error. Textures: of OBJ, PLY, glTF and
 * 3MF, with keeps_values, of which those of mesh_textures.h are kept alone; free textures->all with mesh_textures_free
 * in any case. */
bool plain_mesh_read(file_format format, const char *data, size_t size, plain_mesh *out);

/* Whether this module reads the format, and the textures of its files. */
bool plain_mesh_reads(file_format format);
bool plain_mesh_reads_textures(file_format format);

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

/* Adds an array of values. NULL: it is not kept, because values are not, because it has 0 or more than
 * MESH_VALUES_COMPONENTS components, or because there are MESH_VALUES_MOST arrays. */
plain_values *plain_mesh_add_values(plain_mesh *m, const char *name, mesh_values_kind kind,
                                    size_t components);

/* The array of this name, which is added if there is none. */
plain_values *plain_mesh_find_values(plain_mesh *m, const char *name, mesh_values_kind kind,
                                     size_t components);

/* Drops arrays of values that no vertex has, and completes the others. To be called after the last vertex. */
bool plain_mesh_complete_values(plain_mesh *m);

/* The place of a vertex that is not usable, as vertex_at was; NULL: it is usable, or its place is not known. */
const char *plain_mesh_unusable_at(const plain_mesh *m, uint32_t vertex);

/* Adds a copy of a vertex, with its values. */
bool plain_mesh_copy_vertex(plain_mesh *m, uint32_t vertex);

/* Sets the values of a vertex. Vertices before it without values have NaN. `v` NULL: nothing is done. False: memory
 * is out. */
bool plain_mesh_set_values(plain_mesh *m, plain_values *v, size_t vertex, const double *value);

/* Divides colours by the number that is full intensity, `full`. 0: 255 if one of them exceeds 1, otherwise 1. An opacity that is
 * absent, which is NaN, is 1. `v` NULL: nothing is done. Refuses colours of which some are below 0, or above both 255 and
 * `full`; `type`: of their numbers. */
bool plain_mesh_scale_colors(plain_mesh *m, plain_values *v, double full, const char *type);

/* Reads a decimal number, "nan" or "inf" at *at, and moves *at behind it. Blanks (spaces and tabs) may
 * precede it; a blank, an end of a line or the end of the text must follow it. Correctly rounded. False:
 * there is no such number. */
bool plain_mesh_number(const char **at, double *out);

#endif

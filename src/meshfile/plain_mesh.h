/* plain_mesh: OBJ, PLY, STL, VTK, GIfTI, OFF, glTF and 3MF files read without a library, in the precision that they have.
 *
 * A reader takes a whole file or refuses it with a message that gives the place. OFF, glTF and 3MF have a third answer:
 * a file with contents that are not known here is left to the library. Runs in the process that reads. Threads: none.
 */
#ifndef HEXAD_MESHFILE_PLAIN_MESH_H
#define HEXAD_MESHFILE_PLAIN_MESH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "meshfile/mesh_reader.h"

typedef struct plain_mesh {
    size_t vertices, triangles, others; /* others: points and lines */
    size_t crossed;                     /* polygons that cross themselves */
    double (*vertex)[3];
    uint32_t (*triangle)[3];
    uint32_t *corner; /* of the polygon that is read */
    size_t vertex_room, triangle_room, corner_room;
    error_code refused;              /* of a file that is refused; `text` says why */
    char text[MESH_READER_TEXT_MAX]; /* of a file that is read: warnings, one a line */
    double unit;                     /* 0; or by what the coordinates of the file are multiplied */
    bool is_quantised;               /* its coordinates are integers, which the library does not read */
} plain_mesh;

/* By the ending of the file's name. data[size] is 0. False: the file is left, or refused; *out has no arrays. A file of
 * one of the formats that only this reader reads is never left. plain_mesh_free. */
bool plain_mesh_read(const char *ending, const char *data, size_t size, plain_mesh *out);

/* Whether files with this ending are read here only: OBJ, PLY, STL, VTK and GIfTI. */
bool plain_mesh_is_only_reader(const char *ending);

void plain_mesh_free(plain_mesh *m);

/* ---- for the readers of the formats: each leaves what it has read in *out when it fails */

bool plain_mesh_read_obj(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_ply(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_stl(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_off(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_gltf(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_3mf(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_vtk(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_gifti(const char *data, size_t size, plain_mesh *out);
bool plain_mesh_read_vtp(const char *data, size_t size,
                         plain_mesh *out); /* also a legacy file by this name */

/* Of 3MF and AMF: how many millimetres the unit of a document is, with a warning unless it is 1; a unit that is not
 * known is refused. No unit is a millimetre. */
bool plain_mesh_read_unit(const char *unit, size_t length, plain_mesh *out, double *millimetres);

/* Refuses the file, unless it is refused already; returns false. */
bool plain_mesh_refuse(plain_mesh *m, error_code code, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Refuses a text as damaged: "line 12 ...", of the line at `at`. */
bool plain_mesh_refuse_line(plain_mesh *m, const char *data, const char *at, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* Refuses the file with limit_memory. Returns false. */
bool plain_mesh_refuse_memory(plain_mesh *m);

/* Text as strings have it: without a byte order mark, and to its end. NULL, and the file is refused: it is UTF-16, or
 * has a byte 0 before other bytes. */
const char *plain_mesh_text(const char *data, size_t size, plain_mesh *m);

/* Adds a warning, unless there is no room for it. */
void plain_mesh_warn(plain_mesh *m, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Reserves room for the given number of entries. False: no memory, and the file is refused, here and below. */
bool plain_mesh_expect(plain_mesh *m, size_t vertices, size_t triangles);

bool plain_mesh_add_vertex(plain_mesh *m, const double at[3]);

/* Reserves room for the given number of corners in m->corner. False: no memory. */
bool plain_mesh_expect_corners(plain_mesh *m, size_t corners);

/* Adds a polygon of existing vertices. A polygon of more than three corners is cut into triangles (see polygon.h).
 * False: that takes too much work, or no memory. A polygon with fewer than three corners is counted as another element. */
bool plain_mesh_add_polygon(plain_mesh *m, const uint32_t *corner, size_t corners);

/* Adds a triangle of vertices that are there, whose corners are turned round in a mirrored part. False: no memory. */
bool plain_mesh_add_triangle(plain_mesh *m, uint32_t a, uint32_t b, uint32_t c, bool is_mirrored);

/* Reads a decimal number, "nan" or "inf" that blanks (spaces and tabs) may precede, and behind which is a blank, an end
 * of a line or the end. Correctly rounded. False: there is none. */
bool plain_mesh_number(const char **at, double *out);

#endif

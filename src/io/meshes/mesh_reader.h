// SPDX-License-Identifier: Apache-2.0
/* mesh_reader: a mesh file as plain arrays, by plain_mesh or by assimp (library_mesh).
 *
 * It runs in a process of its own, started by mesh_file: the library can crash on a hostile file and take any
 * amount of memory and time. The process has one open descriptor for the file and no other input. It opens no
 * other file, and after the limits are set it cannot open any descriptor.
 *
 * Its answer (base/core/reader) is, in this order:
 * 1. warnings as the text, one a line, and a mesh_reader_header;
 * 2. the vertices (three doubles each) and the triangles (three uint32_t each);
 * 3. for MESH_VALUES_COMMAND and MESH_TEXTURES_COMMAND only: a uint32_t, the number of attribute arrays, and for each
 *    array a mesh_reader_values and vertices * components doubles, vertex by vertex;
 * 4. for MESH_POLYGONS_COMMAND only: two uint64_t, the number of polygons and of all their corners; the
 *    number of corners of each polygon, and the vertices of all corners, uint32_t each;
 * 5. for MESH_TEXTURES_COMMAND only: a mesh_textures_header, the materials, the names of the libraries, the images, and
 *    the bytes of the images.
 */
#ifndef HEXAD_IO_MESHES_MESH_READER_H
#define HEXAD_IO_MESHES_MESH_READER_H

#include <stdint.h>

#define MESH_READER_COMMAND "read-mesh"
#define MESH_READER_TEXT_MAX 512

typedef struct mesh_reader_header {
    uint64_t vertices, triangles;
    uint64_t others;  /* number of points and lines, which are skipped */
    uint64_t crossed; /* number of polygons that cross themselves */
    /* offset in the file of the first byte after the declared content, if other data follow, which are not
     * read; 0: none follow */
    uint64_t end;
} mesh_reader_header;

/* Command that also answers the polygons of the file, from which the triangles are cut: part 4 of the answer
 * above. A polygon of n > 2 corners has n - 2 consecutive triangles, others have none. */
#define MESH_POLYGONS_COMMAND "read-mesh-polygons"

/* Command that also answers attributes of the vertices other than their positions: part 3 of the answer
 * above. */
#define MESH_VALUES_COMMAND "read-mesh-values"
/* Maximum number of arrays, size of a name with its byte 0, maximum number of components. Further arrays are
 * skipped. */
enum { MESH_VALUES_MOST = 64, MESH_VALUES_NAME_SIZE = 64, MESH_VALUES_COMPONENTS = 4 };

typedef enum mesh_values_kind {
    MESH_VALUES_NUMBER,
    MESH_VALUES_WHOLE, /* an integer label (material, group): that of the nearest corner */
    MESH_VALUES_NORMAL,
    MESH_VALUES_COLOR,
    MESH_VALUES_UV,
    MESH_VALUES_KINDS
} mesh_values_kind;

/* Head of an attribute array. */
typedef struct mesh_reader_values {
    char name[MESH_VALUES_NAME_SIZE];
    uint32_t kind, components; /* kind: a mesh_values_kind; components: 1 .. MESH_VALUES_COMPONENTS */
} mesh_reader_values;

/* Command that also answers the textures: the parts 3, with the arrays of mesh_textures.h alone, and 5. */
#define MESH_TEXTURES_COMMAND "read-mesh-textures"
/* Command that reads a file of materials (MTL) and answers part 1 with an empty header, and part 5. */
#define MESH_MATERIALS_COMMAND "read-mesh-materials"

/* The program `read-mesh EXTENSION MEMORY CPU_SECONDS`, or with another of these commands as its
 * first word. Reads the file on descriptor 0, writes the answer to descriptor 1, allocates at most
 * MEMORY bytes beyond its memory at the start. Returns (or exits with) the exit status: 0 if the answer, a
 * mesh or an error, was written completely. */
int mesh_reader_main(int argc, char **argv);

/* Shared object that contains mesh_reader_main, for programs that are not linked with it. */
#define MESH_READER_MODULE "hexad-mesh.so"

#endif

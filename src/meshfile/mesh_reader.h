/* mesh_reader: a mesh file as plain arrays, by plain_mesh or else by assimp; the only user of that library.
 *
 * It runs in a process of its own, started by mesh_file: the library can crash on a hostile file and take any amount of
 * memory and time. It is given the bytes of one open file and nothing else: no other file is opened, and after the
 * limits are set no descriptor can be.
 *
 * What it writes is a header, then `text_length` bytes of a message or of warnings, one a line, then vertices (three
 * doubles each) and triangles (three uint32_t each), in the machine's own byte order, as both ends are one machine.
 */
#ifndef HEXAD_MESHFILE_MESH_READER_H
#define HEXAD_MESHFILE_MESH_READER_H

#include <stdint.h>

#define MESH_READER_COMMAND "read-mesh"
#define MESH_READER_MAGIC 0x3368736D64786568u /* "hexdmsh3" */
#define MESH_READER_TEXT_MAX 512

typedef struct mesh_reader_header {
    uint64_t magic;
    uint32_t code;        /* an error_code; ERROR_NONE: arrays follow */
    uint32_t text_length; /* at most MESH_READER_TEXT_MAX; with ERROR_NONE the text is warnings */
    uint64_t vertices, triangles;
    uint64_t others;  /* points and lines, which were left out */
    uint64_t crossed; /* polygons that cross themselves */
    uint64_t end; /* 0; or where in the file what it declares ends and other data begin, which are not read */
} mesh_reader_header;

/* What each vertex has beside its place. The command below answers as the other and then, of what all vertices have, with a
 * uint32_t, how many arrays follow, and of each one of these and the numbers, floats, vertex after vertex. */
#define MESH_VALUES_COMMAND "read-mesh-values"
enum { MESH_VALUES_MOST = 64, MESH_VALUES_NAME_SIZE = 64, MESH_VALUES_COMPONENTS = 4 };

typedef enum mesh_values_kind {
    MESH_VALUES_NUMBER,
    MESH_VALUES_WHOLE, /* the same at all corners of a triangle */
    MESH_VALUES_NORMAL,
    MESH_VALUES_COLOR,
    MESH_VALUES_UV,
    MESH_VALUES_KINDS
} mesh_values_kind;

typedef struct mesh_reader_values {
    char name[MESH_VALUES_NAME_SIZE];
    uint32_t kind, components;
} mesh_reader_values;

/* The program `read-mesh EXTENSION MEMORY CPU_SECONDS`: reads the file on descriptor 0, writes to
 * descriptor 1, allocates at most MEMORY bytes beyond its memory at the start. Returns the exit status, 0 when the
 * answer, good or bad, was written whole. */
int mesh_reader_main(int argc, char **argv);

/* The module that contains it, unless it is linked in. */
#define MESH_READER_MODULE "hexad-mesh.so"

#endif

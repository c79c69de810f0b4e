/* mesh_file: a mesh from an open file, read by a process of its own (see mesh_reader). */
#ifndef HEXAD_MESHFILE_MESH_FILE_H
#define HEXAD_MESHFILE_MESH_FILE_H

#include <stddef.h>
#include <stdio.h>

#include "base/error.h"
#include "triangles/mesh.h"
#include "meshfile/mesh_reader.h"

typedef struct mesh_file {
    int fd;              /* open for reading, at any offset; stays the caller's */
    const char *path;    /* its ending determines the format */
    const char *program; /* what runs mesh_reader_main as its command read-mesh; NULL: this program itself */
    size_t memory_limit; /* bytes, of the reading process and of the mesh */
} mesh_file;

/* Every count, number and index of what comes back is checked. Errors: input_damaged, also when the reading
 * process dies of the file or takes too long; input_unsupported; no_surface when there is no triangle;
 * limit_memory. They do not name the file. *out is untouched on failure, otherwise for mesh_free. */
bool mesh_file_read(const mesh_file *file, mesh *out, mesh_notes *notes, error *e);

/* What all vertices of a mesh have beside their places. */
typedef struct mesh_values {
    size_t count;
    mesh_reader_values *head; /* of each array */
    float **value;            /* head.components a vertex */
} mesh_values;

/* The same with these; the mesh is as the file has it. Free *values after success. */
bool mesh_file_read_values(const mesh_file *file, mesh *out, mesh_values *values, error *e);
void mesh_values_free(mesh_values *values);

/* Reads and checks only the answer of the reader process, from its first byte to its end. *header is the answer's
 * header. *notes receives its warnings. `values`: NULL where none are to come; else for mesh_values_free, after failure,
 * too. */
bool mesh_file_parse(FILE *stream, size_t memory_limit, mesh_reader_header *header, mesh *out,
                     mesh_notes *notes, mesh_values *values, error *e);

#endif

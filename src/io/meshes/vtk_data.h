/* vtk_data: what VTK's PolyData is made of, in its text and XML forms, and the mesh that it becomes. Runs in the
 * process that reads. Threads: none.
 */
#ifndef HEXAD_IO_MESHES_VTK_DATA_H
#define HEXAD_IO_MESHES_VTK_DATA_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "io/meshes/plain_mesh.h"

typedef enum vtk_type {
    VTK_INT8,
    VTK_UINT8,
    VTK_INT16,
    VTK_UINT16,
    VTK_INT32,
    VTK_UINT32,
    VTK_INT64,
    VTK_UINT64,
    VTK_FLOAT,
    VTK_DOUBLE,
    VTK_TYPES
} vtk_type;

/* Bytes of a number. */
size_t vtk_type_bytes(vtk_type type);

/* Whether a type holds whole numbers. */
bool vtk_type_is_whole(vtk_type type);

/* The number at any address; in the other byte order if `swapped`. */
double vtk_number(const void *at, vtk_type type, bool swapped);
int64_t vtk_whole(const void *at, vtk_type type, bool swapped); /* of whole types */

/* Kinds of cells. The vertex lists of the cells of a kind are stored one after the other. */
typedef enum vtk_cells_kind { VTK_VERTS, VTK_LINES, VTK_STRIPS, VTK_POLYS, VTK_CELLS_KINDS } vtk_cells_kind;

/* The word for the kind in an XML file: "Verts". */
const char *vtk_cells_name(vtk_cells_kind kind);

/* Adds a cell with the vertices m->vertex[first + vertex[k]], k < count. `cell`: its number among the cells of
 * `kind`, from 0, for messages. Polygons are cut into triangles and strips become triangles; verts and lines are
 * counted as others. False: the file is refused. */
bool vtk_add_cell(plain_mesh *m, vtk_cells_kind kind, int64_t cell, const int64_t *vertex, size_t count,
                  size_t first);

#endif

// SPDX-License-Identifier: Apache-2.0
/* vtk_data: the cells of VTK's PolyData, in its text and XML forms, and their conversion to triangles. Runs
 * in the process that reads. Threads: none.
 */
#ifndef HEXAD_IO_MESHES_VTK_DATA_H
#define HEXAD_IO_MESHES_VTK_DATA_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/number.h"
#include "io/meshes/plain_mesh.h"

/* Kinds of cells. The vertex lists of the cells of a kind are stored one after the other. */
typedef enum vtk_cells_kind { VTK_VERTS, VTK_LINES, VTK_STRIPS, VTK_POLYS, VTK_CELLS_KINDS } vtk_cells_kind;

/* The word for the kind in an XML file: "Verts". */
const char *vtk_cells_name(vtk_cells_kind kind);

/* Adds a cell with the vertices m->vertex[first + vertex[k]], k < count. `cell`: its number among the cells
 * of `kind`, from 0, for messages. Polygons are cut into triangles and strips become triangles; verts and
 * lines are counted as others. False: the file is refused. */
bool vtk_add_cell(plain_mesh *m, vtk_cells_kind kind, int64_t cell, const int64_t *vertex, size_t count,
                  size_t first);

#endif

// SPDX-License-Identifier: Apache-2.0
/* volume_field: an open volume as a field: its value, derivatives and side (inside or outside) at any place,
 * also far from its stored voxels. Internal to volume.c and volume_field.c; others use volume.h. Reading: any
 * thread.
 */
#ifndef HEXAD_SURFACE_VOLUME_VOLUME_FIELD_H
#define HEXAD_SURFACE_VOLUME_VOLUME_FIELD_H

#include "surface/field/spline.h"
#include "geometry/space/block_map.h"
#include "surface/volume/coefficient_block.h"
#include "surface/volume/crossed_cells.h"
#include "surface/volume/hidden_crossing.h"
#include "surface/volume/ringing.h"
#include "surface/volume/volume.h"

/* Voxels around the crossed cells within which F is defined. A longer Newton or trial step has left the
 * surface. */
#define VOLUME_FIELD_MARGIN 4

struct volume {
    field base; /* first: the field's functions get this pointer */
    double to_index[3][4], to_world[3][4];
    double cell_radius; /* from the centre of a cell to its farthest corner, world units */
    double low[3],
        high[3]; /* bounding box of the coefficient blocks in index space; no lookup is needed outside */
    /* Side of all places outside that box, 1 or -1; 0 if the surface may cross its faces, at the end of
     * the data. */
    double beyond;
    block_map map;
    coefficient_blocks coefficients; /* of the map's blocks */
    uint64_t *inside;         /* 8 words per block: voxels that are inside, as the active flags of vdb.h */
    uint8_t *crossed;         /* 64 bytes per block: crossed cells, as rows of crossing_block */
    uint8_t *hidden_crossing; /* likewise: cells with a crossed face whose corners have one sign */
    uint8_t *flat, *gentle;   /* likewise: cells by their field_bend */
    const spline *spline;
    crossed_cells cells;    /* of the map's blocks */
    ringing_limits ringing; /* limited samples; likewise */
    mesh_faces *faces;      /* of a mesh; or NULL */
    bool projects;          /* points will be projected onto the faces */
    bool loose;             /* dense data whose faces are not axis-aligned */
    volume_info info;
};

extern const field_ops volume_field_ops;

/* The bounding box of the boxes of all cells, world space. */
bbox volume_field_cells_box(const volume *v);

/* The side of all places outside the bounding box of the coefficient blocks, or 0 if its corners differ.
 * Coefficient blocks, sides and cells have been set. */
double volume_field_side_beyond(const volume *v);

#endif

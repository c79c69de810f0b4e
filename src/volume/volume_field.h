/* volume_field: a volume once it is open, as a field. Between volume.c, which makes it, and the functions that sample it;
 * others use volume.h. Reading is safe in any number of threads. */
#ifndef HEXAD_VOLUME_VOLUME_FIELD_H
#define HEXAD_VOLUME_VOLUME_FIELD_H

#include "field/spline.h"
#include "geometry/block_map.h"
#include "volume/brick.h"
#include "volume/crossed_cells.h"
#include "volume/grazed.h"
#include "volume/volume.h"

/* Voxels around the crossed cells in which F is defined: a Newton step or a trial step of a particle
 * that goes farther than this has left its surface anyway. */
#define VOLUME_FIELD_MARGIN 4

struct volume {
    field base; /* first: the field's functions get this pointer */
    double to_index[3][4], to_world[3][4];
    double cell_radius;     /* from a cell's middle to its farthest corner, world units */
    double low[3], high[3]; /* the bricks' box in index space; outside of it no lookup is needed */
    double
        beyond; /* the side of all that is there, 1 or -1; 0 where the surface may part it, at the data's end */
    block_map map;
    bricks bricks;          /* of the map's blocks */
    uint64_t *inside;       /* 8 words a block: voxels that are inside, as in vdb.h's active flags */
    uint8_t *crossed;       /* 64 bytes a block: crossed cells, as in crossing_block's rows */
    uint8_t *grazed;        /* likewise: those with a face that the surface passes between its corners */
    uint8_t *flat, *gentle; /* likewise: cells by their field_bend */
    const spline *spline;
    crossed_cells cells; /* of the map's blocks */
    mesh_faces *faces;   /* of a mesh that keeps them, or NULL */
    bool loose;          /* dense data whose faces are not aligned with the world's axes */
    volume_info info;
};

extern const field_ops volume_field_ops;

/* The least box round the boxes of all cells, in world space. */
bbox volume_field_cells_box(const volume *v);

/* The side of what lies beyond the bricks' box, once bricks, sides and cells are there; 0 where its corners differ. */
double volume_field_side_beyond(const volume *v);

#endif

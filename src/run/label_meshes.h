/* label_meshes: the part of a mesh between labels that bounds one of them, as a mesh of its own. */
#ifndef HEXAD_RUN_LABEL_MESHES_H
#define HEXAD_RUN_LABEL_MESHES_H

#include "base/error.h"
#include "formats/points.h"

enum { LABEL_MESHES_MOST = 128 };

/* The vertices that it needs, with places alone and the attribute `point`, their place in the whole; triangles are turned so that
 * normals point out of the label. Not to be copied: `set` points into it. */
typedef struct label_mesh_part {
    points set;
    point_attribute point;
    size_t
        open_edges; /* at which one more triangle goes one way than the other: at the end of the data, or holes */
    size_t nonmanifold_edges; /* in more than two triangles */
    double volume;            /* inside; NaN where edges are open */
    vec3 *position;
    double *index;
    uint32_t (*triangle)[3];
} label_mesh_part;

/* Of `whole`, which has triangles with labels. Release also after failure. Errors: limit_memory. */
bool label_mesh_part_make(const points *whole, int64_t label, label_mesh_part *out, error *e);
void label_mesh_part_free(label_mesh_part *p);

#endif

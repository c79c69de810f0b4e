/* resolution: the voxels of a mesh's level set, as fine as the points and the thickness of the mesh ask for.
 *
 * Voxels begin with the usual number along the longest side, or with the spacing where that is smaller: creases are
 * rounded over a voxel, and points must not see that. Where thin parts do not show they are made smaller. The
 * memory that they may take, and a number along the longest side, bound them. Pure functions.
 */
#ifndef HEXAD_VOLUME_RESOLUTION_H
#define HEXAD_VOLUME_RESOLUTION_H

#include <stddef.h>

#include "triangles/mesh.h"

typedef struct resolution_request {
    double voxel_size;   /* world units; 0: from the resolution */
    int resolution;      /* voxels along the longest side; 0 and no voxel size: chosen here */
    int max_resolution;  /* of what is chosen */
    double spacing;      /* of the points, world units; 0: from the count */
    double count;        /* of the points; 0: the spacing alone counts */
    double least;        /* voxels must not be smaller, world units */
    size_t memory_limit; /* bytes, for points and surface */
    double point_bytes;  /* bytes that a point takes */
} resolution_request;

typedef struct resolution {
    double longest, area; /* of the mesh */
    double spacing;       /* of the points; 0: not known */
    double voxel_size;
    double finest;         /* voxels that thin parts may ask for; 0: given by the job, nothing is chosen */
    const char *chosen_by; /* "spec", "default", "spacing" or "thickness" */
    const char
        *limited_by; /* "max_resolution", "memory" or "band" if smaller voxels were asked for, else NULL */
} resolution;

/* The voxels to begin with. */
resolution resolution_begin(const mesh *m, const resolution_request *request);

/* Voxels for thin parts: `all` shows them all, `worth` what can be shown (see fidelity.h). Returns whether they
 * are smaller than those that there are. */
bool resolution_refine(resolution *r, const resolution_request *request, double all, double worth);

/* Voxels between those that took too much memory and `enough`, which did not. */
void resolution_relent(resolution *r, double enough);

#endif

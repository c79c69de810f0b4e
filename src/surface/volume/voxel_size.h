// SPDX-License-Identifier: Apache-2.0
/* voxel_size: chooses the voxel size of a mesh's level set, from the spacing of the points and the thickness
 * of the mesh.
 *
 * The first size is the usual number of voxels along the longest side, or the spacing if that is smaller:
 * creases are rounded over a voxel, and the points must not resolve this. Parts of a combination have fewer
 * voxels if they get few points. It is reduced if thin parts are not represented. Memory and a maximum number
 * along the longest side bound it. Pure functions.
 */
#ifndef HEXAD_SURFACE_VOLUME_VOXEL_SIZE_H
#define HEXAD_SURFACE_VOLUME_VOXEL_SIZE_H

#include <stddef.h>

#include "geometry/mesh/mesh.h"

typedef struct voxel_size_request {
    double voxel_size;  /* world units; 0: from the resolution */
    int resolution;     /* voxels along the longest side; 0 and no voxel size: chosen here */
    int max_resolution; /* maximum of a chosen resolution */
    double spacing;     /* of the points, world units; 0: follows from the count */
    double count;       /* of the points; 0: the spacing alone counts */
    double
        per_spacing; /* voxels along the spacing that suffice, for few points; 0: the usual number of voxels */
    double least;    /* minimum voxel size, world units */
    size_t memory_limit; /* for points and surface, bytes */
    double point_bytes;  /* bytes per point */
} voxel_size_request;

typedef struct resolution {
    double longest, area; /* of the mesh, world units */
    double spacing;       /* of the points, world units; 0: unknown */
    double voxel_size;
    double finest; /* minimum voxel size for thin parts; 0: the job gives the size, nothing is chosen */
    const char *chosen_by; /* "spec", "default", "spacing" or "thickness" */
    /* "max_resolution", "memory" or "band" if smaller voxels were requested; otherwise NULL */
    const char *limited_by;
} resolution;

/* The first voxel size. */
resolution voxel_size_begin(const mesh *m, const voxel_size_request *request);

/* Chooses voxels for thin parts: `all` would represent all of them, `worth` those that can be represented
 * (see fidelity.h). Returns whether they are smaller than the present ones. */
bool voxel_size_refine(resolution *r, const voxel_size_request *request, double all, double worth);

/* Chooses voxels between those that exceeded the memory and `enough`, which did not. */
void voxel_size_coarsen(resolution *r, double enough);

#endif

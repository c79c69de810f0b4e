// SPDX-License-Identifier: Apache-2.0
/* measured_surface: the triangles or grid cells on which the measures of a result are computed.
 *
 * Meshes and interfaces of labels are measured on their triangles. A mesh that was sampled through a level
 * set is measured on its triangles if no part of it can be hidden: it has one component. All other surfaces
 * are measured on the cells of their scan.
 */
#ifndef HEXAD_JOB_PHASES_MEASURED_SURFACE_H
#define HEXAD_JOB_PHASES_MEASURED_SURFACE_H

#include "sampling/measures/facets.h"
#include "job/source/source.h"

typedef struct measured_surface {
    facets_input facets;
    bool own_normals; /* measure with the normals of the triangles: those of the level set may differ */
    uint32_t *patch_piece;
    uint32_t (*patch_labels)[2]; /* for interfaces of labels; otherwise NULL */
    /* for a mesh that is measured on its level set: places that the level set does not represent */
    const vec3 *lost_place;
    size_t lost_places;
    vec3 *vertex;                 /* vertices in world units, if the mesh has another unit; otherwise NULL */
    const mesh *mesh;             /* of a level set, if the surface is measured on it; otherwise NULL */
    const field_patches *patches; /* of facets.patch_piece, if there are several pieces; otherwise NULL */
    const int64_t *patch_euler;   /* of mesh_patches, if the surface is such a mesh; otherwise NULL */
    double *euler; /* of each piece, after measured_surface_find_euler; NAN: it cannot be determined */
} measured_surface;

/* Refers to the source and the scan, which outlive *out. Close *out also after failure. Error:
 * limit_memory. */
bool measured_surface_open(const source *s, const surface *scan, measured_surface *out, error *e);

/* Sets the Euler characteristic of each piece: of triangles, vertices minus edges plus triangles; of a scan, by the signs
 * of F at the corners of its cells. Errors: limit_memory, cancelled. */
bool measured_surface_find_euler(measured_surface *m, threads *pool, error *e);
void measured_surface_close(measured_surface *m); /* accepts a zeroed object */

#endif

/* measured_surface: the triangles or grid cells on which the measures of a job's result are taken.
 *
 * A mesh and the interfaces of labels are measured on their triangles, also where a mesh was sampled through a level set, if it has one
 * part, so that none can lie inside another, and hides nothing. All other surfaces are measured on the cells of their scan.
 */
#ifndef HEXAD_RUN_MEASURED_SURFACE_H
#define HEXAD_RUN_MEASURED_SURFACE_H

#include "measures/facets.h"
#include "source/source.h"

typedef struct measured_surface {
    facets_input facets;
    bool own_normals; /* points take the normals of the triangles: those of the level set may differ */
    uint32_t *patch_piece;
    uint32_t (*patch_labels)[2]; /* of the interfaces of labels, else NULL */
    const vec3 *lost_place; /* of a mesh that is measured on its level set: places that this leaves out */
    size_t lost_places;
    vec3 *vertex; /* of a mesh whose vertices are kept in another unit */
} measured_surface;

/* Refers to the source and the scan, which must outlive *out. Release *out also after failure. Error: limit_memory. */
bool measured_surface_open(const source *s, const surface *scan, measured_surface *out, error *e);
void measured_surface_close(measured_surface *m); /* a zeroed one will do */

#endif

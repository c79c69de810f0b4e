/* label_surface: the interfaces of a segmentation as patches on the triangles between its labels. */
#ifndef HEXAD_LABELS_LABEL_SURFACE_H
#define HEXAD_LABELS_LABEL_SURFACE_H

#include "base/threads.h"
#include "field/field.h"
#include "json/json.h"
#include "labels/label_volume.h"
#include "mesh/mesh_patches.h"

typedef struct label_surface_request {
    slices *from; /* the volume; no longer needed once it is open */
    const spec_labels *spec;
    double spacing; /* of the points; 0: by their count */
    double count;
    size_t memory_limit;
    threads *pool;
} label_surface_request;

typedef struct label_surface label_surface;

/* Errors: those of label_volume_read, label_mesh_make and mesh_surface_new; without the path. */
label_surface *label_surface_open(const label_surface_request *request, error *e);
void label_surface_close(label_surface *s); /* NULL will do */

/* The nearest place of the triangles of all interfaces. */
vec3 label_surface_nearest(const label_surface *s, vec3 x);
const field *label_surface_field(const label_surface *s);
const mesh_patches *label_surface_patches(const label_surface *s); /* the patches of that field */
size_t label_surface_bytes(const label_surface *s);                /* 0 for NULL */

/* The labels on both sides of a patch; the normal points from the first to the second. */
void label_surface_sides(const label_surface *s, uint32_t patch, int64_t out[2]);

/* The numbers of the two materials that each patch separates, in the order of label_surface_sides. The caller frees the array; `what` is named
 * by the error. NULL: limit_memory. */
uint32_t (*label_surface_materials(const label_surface *s, const char *what, error *e))[2];

/* The labels but the background, ascending: the first `most` into `out`. Returns how many there are. */
size_t label_surface_labels(const label_surface *s, size_t most, int64_t *out);

/* A label that is thin (label_thinness), and the one that is not with which it has the largest interface. */
typedef struct label_thin {
    int64_t label, into;
    bool unites; /* there is one, and two labels or more are left without those that are thin */
    bool row;    /* its voxels are alone, or in rows */
} label_thin;

/* The thin labels, ascending: *count of them, which live as long as the surface. */
const label_thin *label_surface_thin(const label_surface *s, size_t *count);

/* Whether most labels that are not thin are so in many places, as where slices of a segmentation do not fit to each
 * other, and are no smaller than a ball of this radius, in the smallest side of a voxel. The largest label, of what is
 * around the others, does not count. */
bool label_surface_is_ragged(const label_surface *s, double radius);

/* The smallest side of a voxel. */
double label_surface_voxel(const label_surface *s);

/* Adds the member `labels` to the report's `surface`, and the warnings of the reader and of thin labels to `warnings`. */
void label_surface_describe(const label_surface *s, json *surface, json *warnings);

#endif

// SPDX-License-Identifier: Apache-2.0
/* label_surface: the interfaces of a segmentation as patches on the triangles between its labels. */
#ifndef HEXAD_SURFACE_LABELS_LABEL_SURFACE_H
#define HEXAD_SURFACE_LABELS_LABEL_SURFACE_H

#include "base/core/threads.h"
#include "surface/field/field.h"
#include "base/json/json.h"
#include "surface/labels/label_volume.h"
#include "surface/triangles/mesh_surface.h"

typedef struct label_surface_request {
    slices *from; /* the volume; not used after label_surface_open */
    const spec_labels *spec;
    double spacing; /* spacing of the points; 0: determined by `count` */
    double count;
    size_t memory_limit;
    threads *pool;
} label_surface_request;

typedef struct label_surface label_surface;

/* Errors: those of label_volume_read, label_mesh_make and mesh_surface_new. Messages do not contain the
 * path. */
label_surface *label_surface_open(const label_surface_request *request, error *e);
void label_surface_close(label_surface *s); /* accepts NULL */

/* The point of the triangles of all interfaces that is nearest to x. */
vec3 label_surface_nearest(const label_surface *s, vec3 x);
const mesh_surface *label_surface_triangles(const label_surface *s); /* owned by *s */
const field *label_surface_field(const label_surface *s);
const mesh_patches *label_surface_patches(const label_surface *s); /* the patches of label_surface_field */
size_t label_surface_bytes(const label_surface *s);                /* 0 for NULL */

/* The labels on both sides of a patch; the normal points from the first to the second. */
void label_surface_sides(const label_surface *s, uint32_t patch, int64_t out[2]);

/* The numbers of the two materials that each patch separates, in the order of label_surface_sides. The caller
 * frees the array. `what`: the object that an error names. NULL: limit_memory. */
uint32_t (*label_surface_materials(const label_surface *s, const char *what, error *e))[2];

/* Stores the labels except the background, ascending, at most `most`, in `out`. Returns the number of all
 * these labels. */
size_t label_surface_labels(const label_surface *s, size_t most, int64_t *out);

/* A thin label (label_thinness), and the label `into`, which is not thin and has the largest interface
 * with it. */
typedef struct label_thin {
    int64_t label, into;
    bool unites; /* `into` exists, and two or more labels are not thin */
    bool row;    /* its voxels are single or in rows */
} label_thin;

/* The thin labels, ascending. *count: their number. They are valid until the surface is closed. */
const label_thin *label_surface_thin(const label_surface *s, size_t *count);

/* Whether most labels are ragged. A label is ragged if it is thin in many places, as where slices of a
 * segmentation do not match, and at least as large as a ball of this radius, in units of the smallest side of
 * a voxel. Thin labels and the largest label, which usually surrounds the others, are not counted. */
bool label_surface_is_ragged(const label_surface *s, double radius);

/* The smallest side of a voxel. */
double label_surface_voxel(const label_surface *s);

/* Adds the member `labels` to the report's `surface`, and the warnings of the reader and of thin labels to
 * `warnings`. */
void label_surface_describe(const label_surface *s, json *surface, json *warnings);

#endif

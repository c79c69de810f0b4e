// SPDX-License-Identifier: Apache-2.0
/* surface_meshes: the mesh files of the surface that a spec names, and the maps that move them to the
 * world. One thread. */
#ifndef HEXAD_JOB_PHASES_SURFACE_MESHES_H
#define HEXAD_JOB_PHASES_SURFACE_MESHES_H

#include "job/attributes/attachment.h"
#include "base/core/error.h"
#include "job/source/source.h"
#include "spec/spec.h"

typedef struct surface_meshes {
    size_t count;
    attachment_file *file; /* in the order of the spec, opened; their paths are the spec's */
} surface_meshes;

/* Opens the meshes. Errors: attribute_missing (the surface has none), those of source_open_file. Free *out
 * after failure, too. */
bool surface_meshes_open(const spec_surface *s, source *from, surface_meshes *out, error *e);
void surface_meshes_close(surface_meshes *m); /* accepts a zeroed object */

/* The comment lines of points.ply, with the topologies of the meshes. The caller frees them. */
char *surface_meshes_comments(const surface_meshes *m);

/* Multiplies m by the matrix of a transform, from the right. */
void surface_append_transform(const spec_surface *s, double m[3][4]);

#endif

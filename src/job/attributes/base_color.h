// SPDX-License-Identifier: Apache-2.0
/* base_color: the colour of a mesh's material at the nearest position of the nearest triangle: the image times
 * the factor of the material, and times the colours of the vertices where the format says so (doc/meshes.md).
 *
 * The mesh file, its files of materials and each image are read by processes of their own. One image is in memory
 * at a time. Contracts: attribute.h.
 */
#ifndef HEXAD_JOB_ATTRIBUTES_BASE_COLOR_H
#define HEXAD_JOB_ATTRIBUTES_BASE_COLOR_H

#include "job/attributes/attribute.h"

#define BASE_COLOR_NAME "base_color"

/* Also decodes each image, so that a job does not fail at its end. */
bool base_color_find(const attribute_request *request, point_attribute_kind *kind, int *components, error *e);
bool base_color_read(const attribute_request *request, size_t count, const vec3 *position, double *values,
                     attribute_counts *counts, error *e);

#endif

// SPDX-License-Identifier: Apache-2.0
/* corners: attributes of mesh vertices, interpolated at the nearest position of the nearest triangle.
 * Contracts: attribute.h.
 */
#ifndef HEXAD_JOB_ATTRIBUTES_CORNERS_H
#define HEXAD_JOB_ATTRIBUTES_CORNERS_H

#include "geometry/mesh/mesh.h"
#include "job/attributes/attribute.h"

bool corners_find(const attribute_request *request, point_attribute_kind *kind, int *components, error *e);
void corners_forget(attribute_mesh **last);
bool corners_read(const attribute_request *request, size_t count, const vec3 *position, double *values,
                  attribute_counts *counts, error *e);

/* Whether point i, at x, is farther than its spacing from a place of a mesh of the file: the place with these weights
 * of the vertices `corner`. */
bool corners_is_far(const attribute_request *request, size_t i, vec3 x, const mesh *m,
                    const uint32_t corner[3], const double weight[3]);

#endif

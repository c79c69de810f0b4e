// SPDX-License-Identifier: Apache-2.0
/* corners: attributes of mesh vertices, interpolated at the nearest position of the nearest triangle.
 * Contracts: attribute.h.
 */
#ifndef HEXAD_JOB_ATTRIBUTES_CORNERS_H
#define HEXAD_JOB_ATTRIBUTES_CORNERS_H

#include "job/attributes/attribute.h"

bool corners_find(const attribute_request *request, point_attribute_kind *kind, int *components, error *e);
void corners_forget(attribute_mesh **last);
bool corners_read(const attribute_request *request, size_t count, const vec3 *position, double *values,
                  attribute_counts *counts, error *e);

#endif

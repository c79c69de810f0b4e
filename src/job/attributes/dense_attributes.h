// SPDX-License-Identifier: Apache-2.0
/* dense_attributes: attributes of dense volumes, NRRD and NIfTI files and stacks of EXR images, read slice by
 * slice; at most four slices are in memory. Contracts: attribute.h.
 */
#ifndef HEXAD_JOB_ATTRIBUTES_DENSE_ATTRIBUTES_H
#define HEXAD_JOB_ATTRIBUTES_DENSE_ATTRIBUTES_H

#include "job/attributes/attribute.h"

bool dense_attributes_find(const attribute_request *request, point_attribute_kind *kind, int *components,
                           error *e);
bool dense_attributes_read(const attribute_request *request, size_t count, const vec3 *position,
                           double *values, attribute_counts *counts, error *e);

#endif

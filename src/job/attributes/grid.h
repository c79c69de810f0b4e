// SPDX-License-Identifier: Apache-2.0
/* grid: attributes of OpenVDB files, from any grid of numbers or vectors. Contracts: attribute.h. */
#ifndef HEXAD_JOB_ATTRIBUTES_GRID_H
#define HEXAD_JOB_ATTRIBUTES_GRID_H

#include "job/attributes/attribute.h"

bool grid_find(const attribute_request *request, point_attribute_kind *kind, int *components, error *e);
bool grid_read(const attribute_request *request, size_t count, const vec3 *position, double *values,
               attribute_counts *counts, error *e);

#endif

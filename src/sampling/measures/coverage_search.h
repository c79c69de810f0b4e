// SPDX-License-Identifier: Apache-2.0
/* coverage_search: the distances of the places of one triangle from their nearest points, and the area that
 * has no point near.
 *
 * Branch and bound: a triangle is divided until bounds on the distances of its places suffice for the
 * decision. For a scan, the distances are those of the points of the surface next to points of the triangle.
 * No state, any thread.
 */
#ifndef HEXAD_SAMPLING_MEASURES_COVERAGE_SEARCH_H
#define HEXAD_SAMPLING_MEASURES_COVERAGE_SEARCH_H

#include "sampling/measures/facets.h"
#include "sampling/measures/sites.h"

/* A place is missing if its distance from every point that is not on an opposite wall exceeds this times the
 * spacing. In an ideal packing the maximum is .58, at a vacancy 1. */
#define COVERAGE_MISSING 1.2
/* Accuracy of distances, in spacings. */
#define COVERAGE_ACCURACY 0.02

/* Returns the maximum over the triangle of the distance in space from a place to its nearest point, divided
 * by the spacing of the point; `known` if that is larger. The result is too small by at most
 * COVERAGE_ACCURACY. */
double coverage_search_farthest(const facets *f, const sites *s, const vec3 corner[3], const facet *of,
                                double known);

/* Returns the area of the missing places of the triangle. */
double coverage_search_missing(const facets *f, const sites *s, const vec3 corner[3], const facet *of);

#endif

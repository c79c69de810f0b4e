/* coverage_search: how far the places of one triangle are from their nearest points, and how much of it has none near.
 *
 * By branch and bound: a triangle is divided until bounds on the distances of its places decide. For a scan, distances
 * are those of the points of the surface next to points of the triangle. Reentrant.
 */
#ifndef HEXAD_MEASURES_COVERAGE_SEARCH_H
#define HEXAD_MEASURES_COVERAGE_SEARCH_H

#include "measures/facets.h"
#include "measures/sites.h"

/* A place farther than this from every point that is not of an opposite wall is missing; of the spacing. An ideal
 * packing has .58, a vacancy in it 1. */
#define COVERAGE_MISSING 1.2
/* Distances are right to this, of the spacing. */
#define COVERAGE_ACCURACY 0.02

/* The largest distance in space of a place of the triangle from its nearest point, over that point's spacing, if it is
 * above `known`; else `known`. At most COVERAGE_ACCURACY too low. */
double coverage_search_farthest(const facets *f, const sites *s, const vec3 corner[3], const facet *of,
                                double known);

/* The area of the triangle whose places are missing. */
double coverage_search_missing(const facets *f, const sites *s, const vec3 corner[3], const facet *of);

#endif

// SPDX-License-Identifier: Apache-2.0
/* sites: the delivered points as the measures of a surface use them.
 *
 * A point on a curve lies on several faces and has a normal for each. A place with normal n and a point are
 * on opposite walls if n . m <= SITES_OPPOSITE for all normals m of the point. The arrays are the caller's.
 * Pure functions.
 */
#ifndef HEXAD_SAMPLING_MEASURES_SITES_H
#define HEXAD_SAMPLING_MEASURES_SITES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "geometry/space/cell_list.h"
#include "geometry/space/vec3.h"
#include "sampling/voronoi/resolution.h"

/* Cosine. The interaction energy is 1 down to -0.5 and 0 below -0.8 (voronoi.h); creases of right angles stay
 * above it. */
#define SITES_OPPOSITE RESOLUTION_OPPOSITE

typedef struct sites {
    size_t count;
    const vec3 *position;
    const double *spacing; /* requested spacing h of each point, > 0 */
    const uint32_t *piece; /* per point: its piece of the surface; NULL: all are of piece 0 */
    /* count + 1: the normals of point i are normal[side[i]] .. normal[side[i + 1] - 1]; at least one. NULL: each
     * point has one normal, of patch 0, and `one_sided` and `patch` are NULL, too */
    const uint32_t *side;
    const vec3 *normal;
    const bool *one_sided; /* per normal: its sign is arbitrary */
    const uint32_t *patch; /* per normal */
    const uint32_t (*patch_labels)
        [2]; /* per patch: the labels that it separates; normals point from the first to the second; or
              * NULL */
    double largest_spacing;
    const cell_list *near; /* of `position`; NULL: not used */
} sites;

/* The points as a solver has them: a copy for each patch on which a point lies; the first ones are the points
 * in their order. */
typedef struct sites_copies {
    size_t count;          /* number of copies */
    const vec3 *normal;    /* NULL: not known */
    const uint32_t *point; /* NULL: copy i is point i */
    const uint32_t *patch; /* NULL: one patch */
    const uint8_t *flags;  /* of point_flags.h; NULL: none */
} sites_copies;

/* Lists the copies of each point: fills side (points + 1 values, zeroed before), one_sided and patch (a value
 * for each copy), and normal if normals are known. */
void sites_gather(const sites_copies *copies, size_t points, uint32_t *side, vec3 *normal, bool *one_sided,
                  uint32_t *patch);

static inline uint32_t sites_piece(const sites *s, uint32_t i)
{
    return s->piece ? s->piece[i] : 0;
}

/* The normals of point i: from this one to that before sites_end. */
static inline uint32_t sites_first(const sites *s, uint32_t i)
{
    return s->side ? s->side[i] : i;
}

static inline uint32_t sites_end(const sites *s, uint32_t i)
{
    return s->side ? s->side[i + 1] : i + 1;
}

static inline uint32_t sites_patch(const sites *s, uint32_t k)
{
    return s->patch ? s->patch[k] : 0;
}

static inline bool sites_is_one_sided(const sites *s, uint32_t k)
{
    return s->one_sided && s->one_sided[k];
}

/* The sign with which the cosine of normals of two patches is compared: 1, -1, or 0: the patches are never
 * opposite. Interfaces with a common label are compared by the normals that point out of it. */
static inline int sites_sign(const sites *s, uint32_t patch, uint32_t other)
{
    if (!s->patch_labels) return 1;
    const uint32_t *a = s->patch_labels[patch], *b = s->patch_labels[other];
    return a[0] == b[0] || a[1] == b[1] ? 1 : a[0] == b[1] || a[1] == b[0] ? -1 : 0;
}

/* The cosine between the k-th normal and a direction n of a patch, with the sign of sites_sign; its absolute
 * value if the normal is one-sided; 1 if the patches are never opposite. */
static inline double sites_cosine(const sites *s, uint32_t k, vec3 n, uint32_t patch)
{
    const int sign = sites_sign(s, sites_patch(s, k), patch);
    const double c = sign * vec3_dot(s->normal[k], n);
    return sign == 0 ? 1 : sites_is_one_sided(s, k) ? fabs(c) : c;
}

/* The largest sites_cosine over the normals of point i. */
static inline double sites_facing(const sites *s, uint32_t i, vec3 n, uint32_t patch)
{
    double most = -1;
    for (uint32_t k = sites_first(s, i); k < sites_end(s, i); k++) {
        const double facing = sites_cosine(s, k, n, patch);
        most = facing > most ? facing : most;
    }
    return most;
}

/* The largest sites_facing between the normals of two points. */
static inline double sites_facing_pair(const sites *s, uint32_t i, uint32_t j)
{
    double most = -1;
    for (uint32_t k = sites_first(s, i); k < sites_end(s, i); k++) {
        const double c = sites_facing(s, j, s->normal[k], sites_patch(s, k)),
                     facing = sites_is_one_sided(s, k) ? fabs(c) : c;
        most = facing > most ? facing : most;
    }
    return most;
}

#endif

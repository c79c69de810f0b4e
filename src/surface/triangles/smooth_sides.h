// SPDX-License-Identifier: Apache-2.0
/* smooth_sides: which triangles of a mesh continue each other smoothly, and which of them are coplanar.
 *
 * A crease is a side without exactly one neighbour, or a side that is sharper than a given angle. The triangles
 * around a vertex between two creases are a sector. Any thread.
 */
#ifndef HEXAD_SURFACE_TRIANGLES_SMOOTH_SIDES_H
#define HEXAD_SURFACE_TRIANGLES_SMOOTH_SIDES_H

#include <stdbool.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"

typedef struct smooth_sides {
    const mesh *m;
    /* per triangle: the triangle across the side from corner k; UINT32_MAX: none */
    const uint32_t (*beside)[3];
    /* per triangle and side, the one from corner k to the next: bits 0, 1: the number of the side in the triangle
     * across it; SMOOTH_SIDES_... */
    uint8_t (*bits)[3];
    uint32_t (*own)[3]; /* `beside`, if it was not given */
    /* per triangle and corner: the result of sector_is_corner, 0: not computed yet. Accessed atomically */
    uint8_t (*corner)[3];
} smooth_sides;

/* The triangle across a side is oriented against this one; it is coplanar with it; the side is a crease. */
enum { SMOOTH_SIDES_REVERSED = 4, SMOOTH_SIDES_COPLANAR = 8, SMOOTH_SIDES_CREASE = 16 };

/* `m` is not owned, nor is `beside`, if it is not NULL. Sides with a larger dihedral angle than `crease`
 * (radians, below pi / 2, or INFINITY: none) are creases. Free *out with smooth_sides_free, also after failure. Errors: limit_memory, cancelled. */
bool smooth_sides_make(const mesh *m, const uint32_t (*beside)[3], double crease, threads *pool,
                       smooth_sides *out, error *e);
void smooth_sides_free(smooth_sides *s);

static inline bool smooth_sides_is_crease(const smooth_sides *s, uint32_t triangle, int side)
{
    return s->bits[triangle][side] & SMOOTH_SIDES_CREASE;
}

static inline bool smooth_sides_is_coplanar(const smooth_sides *s, uint32_t triangle, int side)
{
    return s->bits[triangle][side] & SMOOTH_SIDES_COPLANAR;
}

/* Whether the triangle is coplanar with any of its neighbours. */
static inline bool smooth_sides_has_coplanar(const smooth_sides *s, uint32_t triangle)
{
    const uint8_t *bits = s->bits[triangle];
    return (bits[0] | bits[1] | bits[2]) & SMOOTH_SIDES_COPLANAR;
}

/* A triangle of a sector, and one of its two sides at the vertex of the sector. */
typedef struct sector_step {
    uint32_t triangle;
    uint32_t far;     /* the side's other end */
    uint8_t corner;   /* of the triangle, at the vertex */
    uint8_t side;     /* the side begins at this corner of the triangle, in its own orientation */
    bool is_reversed; /* the triangle is oriented against the first one */
} sector_step;

/* The first step at a corner of a triangle; of its two sides there, the one that begins at the corner if
 * `ahead`. */
static inline sector_step sector_begin(const smooth_sides *s, uint32_t triangle, int corner, bool ahead)
{
    const int next = corner < 2 ? corner + 1 : 0, last = corner > 0 ? corner - 1 : 2;
    const uint32_t *t = s->m->triangle[triangle];
    return (sector_step){triangle, t[ahead ? next : last], (uint8_t)corner, (uint8_t)(ahead ? corner : last),
                         false};
}

static inline bool sector_is_coplanar(const smooth_sides *s, const sector_step *at)
{
    return smooth_sides_is_coplanar(s, at->triangle, at->side);
}

/* The corner of the triangle at the side's other end. */
static inline int sector_far_corner(const sector_step *at)
{
    return at->side != at->corner ? at->side : at->side < 2 ? at->side + 1 : 0;
}

/* Goes to the triangle across the side, and to its other side. False, with *at unchanged: the side is a crease. */
static inline bool sector_next(const smooth_sides *s, sector_step *at)
{
    static const uint8_t modulo3[] = {0, 1, 2, 0, 1};
    const unsigned bits = s->bits[at->triangle][at->side], shared = bits & 3;
    if (bits & SMOOTH_SIDES_CREASE) return false;
    const bool is_against = bits & SMOOTH_SIDES_REVERSED;
    const unsigned ahead = (at->side == at->corner) != is_against; /* the new side begins at the corner */
    const uint32_t next = s->beside[at->triangle][at->side];
    *at = (sector_step){next, s->m->triangle[next][modulo3[shared + 2]], modulo3[shared + ahead],
                        modulo3[shared + 2 - ahead], at->is_reversed != is_against};
    return true;
}

/* A walk through a sector: ahead from a triangle, and if there is a crease then the other way from it. Each side is
 * visited once, also those that are creases. */
typedef struct sector_walk {
    sector_step at;
    uint32_t first;
    uint8_t corner, left; /* steps that are left at most; the sector of an apex may have any number */
    bool is_open;         /* the sector ends at creases */
    bool is_again;        /* `at` is the first triangle, for the second time */
} sector_walk;

enum { SECTOR_WALK_MOST = 255 };

static inline sector_walk sector_walk_begin(const smooth_sides *s, uint32_t triangle, int corner)
{
    return (sector_walk){
        sector_begin(s, triangle, corner, true), triangle, (uint8_t)corner, SECTOR_WALK_MOST, false, false};
}

/* Goes to the next side. False: there is none. */
static inline bool sector_walk_next(const smooth_sides *s, sector_walk *w)
{
    w->is_again = false;
    if (w->left-- == 0) return false;
    if (sector_next(s, &w->at)) return w->is_open || w->at.triangle != w->first;
    if (w->is_open) return false;
    w->is_open = w->is_again = true;
    w->at = sector_begin(s, w->first, w->corner, false);
    return true;
}

/* The first triangle of the sector, seen against the orientation of `triangle`: the one behind a crease, or
 * `triangle` itself if the sector has none (*is_closed). The step is at its side away from the crease. */
sector_step sector_first(const smooth_sides *s, uint32_t triangle, int corner, bool *is_closed);

/* The sides of a sector that are not between coplanar triangles, creases included. */
typedef struct sector_bends {
    int count;       /* SECTOR_BENDS_MOST: that many or more */
    uint32_t far[2]; /* the other ends of the first two */
    bool is_closed;  /* the sector has no crease */
} sector_bends;

enum { SECTOR_BENDS_MOST = 3 };

sector_bends sector_find_bends(const smooth_sides *s, uint32_t triangle, int corner);

/* Whether the vertex is a corner of the facets of the sector: the boundary of the facets turns there, or there are
 * more than two. */
bool sector_is_corner(const smooth_sides *s, uint32_t triangle, int corner);

/* Follows the boundary of a facet along a side that is not between coplanar triangles, to the next corner of the
 * facet. The result is at this corner, in a triangle of the facet. */
sector_step sector_follow(const smooth_sides *s, sector_step at);

#endif

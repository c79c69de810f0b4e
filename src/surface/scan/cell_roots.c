// SPDX-License-Identifier: Apache-2.0
#include "surface/scan/cell_roots.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "surface/field/kuhn.h"

enum { GROUP_EDGES = ROOT_GROUP_CELLS * CELL_EDGES, SLOT_BITS = 10, SLOTS = 1 << SLOT_BITS };
enum { WORDS = 8 }; /* words that identify an edge: the positions and values of its ends */

int cell_crossed_edges(const field_cell *cell, crossed_edge out[CELL_EDGES])
{
    int count = 0;
    for (uint8_t a = 0; a < 8; a++)
        for (uint8_t b = a + 1; b < 8; b++) {
            const bool is_inside = cell->value[a] < 0;
            if ((a & b) != a || is_inside == (cell->value[b] < 0))
                continue; /* edges of Kuhn's tetrahedra ascend along one or several axes */
            out[count++] = is_inside ? (crossed_edge){a, b} : (crossed_edge){b, a};
        }
    return count;
}

/* Lists the edges of a tetrahedron that the surface crosses, in order around the section: from each corner
 * inside to the corners outside, in alternating direction. */
static int ring_of(unsigned inside, const int at[4], crossed_edge ring[4])
{
    int count = 0;
    bool back = false;
    for (int v = 0; v < 4; v++) {
        if (!(inside >> at[v] & 1)) continue;
        for (int w = 0; w < 4; w++) {
            const int other = at[back ? 3 - w : w];
            if (!(inside >> other & 1)) ring[count++] = (crossed_edge){(uint8_t)at[v], (uint8_t)other};
        }
        back = !back;
    }
    return count;
}

int cell_cut(unsigned inside, crossed_edge out[FIELD_CELL_TRIANGLES][3])
{
    int count = 0;
    for (int k = 0; k < KUHN_TETRAHEDRA; k++) {
        const kuhn_path path = kuhn_path_of(k);
        crossed_edge ring[4];
        const int edges = ring_of(inside, path.corner, ring);
        for (int i = 2; i < edges; i++)
            memcpy(out[count++], (crossed_edge[]){ring[0], ring[i - 1], ring[i]}, sizeof out[0]);
    }
    return count;
}

/* The state of a root search. low, high, t: positions along the edge, 0 at the end inside the solid. */
typedef struct root_search {
    vec3 from, edge;
    double low, high, at_low, at_high, newton, t;
    int kept; /* end that the last step did not move: -1 low, 1 high */
    int steps;
    corner *out;
} root_search;

static root_search begin_search(vec3 inside, vec3 outside, double at_inside, double at_outside, corner *out)
{
    *out = (corner){.smooth = false};
    return (root_search){.from = inside,
                         .edge = vec3_sub(outside, inside),
                         .high = 1,
                         .at_low = at_inside,
                         .at_high = at_outside,
                         .newton = -1,
                         .out = out};
}

/* Chooses the next position to evaluate. */
static void choose_place(root_search *s)
{
    s->t = s->low + (s->high - s->low) * s->at_low / (s->at_low - s->at_high);
    if (s->steps & 1 && s->newton > s->low && s->newton < s->high) s->t = s->newton;
    s->out->position = vec3_axpy(s->t, s->edge, s->from);
}

/* Uses F at the position. Returns whether the search has ended. */
static bool take_sample(root_search *s, double value, vec3 gradient, double last_step)
{
    const double length = vec3_norm(gradient);
    s->newton = value == 0 ? s->t : s->t - value / vec3_dot(gradient, s->edge);
    if (length > 0 && fabs(s->newton - s->t) * vec3_norm(s->edge) <= last_step) {
        s->out->position = vec3_axpy(fmin(fmax(s->newton, s->low), s->high), s->edge, s->from);
        s->out->normal = vec3_scale(gradient, 1 / length);
        return s->out->smooth = true;
    }
    if (value < 0) {
        s->low = s->t;
        s->at_low = value;
        if (s->kept == 1) s->at_high *= 0.5;
        s->kept = 1;
    } else {
        s->high = s->t;
        s->at_high = value;
        if (s->kept == -1) s->at_low *= 0.5;
        s->kept = -1;
    }
    return ++s->steps == CELL_ROOT_STEPS;
}

void cell_find_root(const field *f, const field_cell *cell, int inside, int outside, bool is_straight,
                    corner *out)
{
    field_sample sample;
    root_search s = begin_search(cell->corner[inside], cell->corner[outside], cell->value[inside],
                                 cell->value[outside], out);
    do {
        choose_place(&s);
        if (is_straight || !field_sample_at(f, out->position, FIELD_GRADIENT, &sample)) return;
    } while (!take_sample(&s, sample.value, sample.gradient, CELL_LAST_STEP * f->cell_size));
}

struct root_group {
    size_t count;
    struct {
        uint64_t ends[WORDS]; /* bits of the positions of both ends and of F there */
        corner root;
    } edge[GROUP_EDGES];
    uint16_t slot[SLOTS]; /* hash table with open addressing: index of the edge + 1, or 0 */
};

root_group *root_group_new(void)
{
    /* not zeroed: that would touch all of its memory */
    root_group *g = mem_resize(NULL, sizeof *g);
    memset(g->slot, 0, sizeof g->slot);
    g->count = 0;
    return g;
}

void root_group_free(root_group *g)
{
    free(g);
}

void root_group_clear(root_group *g)
{
    if (g->count > 0) memset(g->slot, 0, sizeof g->slot);
    g->count = 0;
}

/* The bits of one number, read by a separate load. A vector load of two numbers that were stored separately
 * just before would stall. */
static inline uint64_t bits_of(const double *number)
{
    uint64_t bits;
    memcpy(&bits, number, sizeof bits);
    __asm__("" : "+r"(bits));
    return bits;
}

static bool has_ends(const uint64_t a[WORDS], const uint64_t b[WORDS])
{
    uint64_t differ = 0;
    for (int k = 0; k < WORDS; k++) differ |= a[k] ^ b[k];
    return !differ;
}

const corner *root_group_add(root_group *g, const field_cell *cell, crossed_edge edge)
{
    const vec3 *p = &cell->corner[edge.inside], *q = &cell->corner[edge.outside];
    const uint64_t ends[WORDS] = {bits_of(&p->x),
                                  bits_of(&p->y),
                                  bits_of(&p->z),
                                  bits_of(&q->x),
                                  bits_of(&q->y),
                                  bits_of(&q->z),
                                  bits_of(&cell->value[edge.inside]),
                                  bits_of(&cell->value[edge.outside])};
    const uint64_t hash = (ends[0] ^ ends[4]) * 0x9E3779B97F4A7C15u ^
                          (ends[1] ^ ends[5]) * 0xC2B2AE3D27D4EB4Fu ^
                          (ends[2] ^ ends[3]) * 0x165667B19E3779F9u;
    size_t slot = (hash ^ hash >> 29) * 0x9E3779B97F4A7C15u >> (64 - SLOT_BITS);
    while (g->slot[slot] && !has_ends(g->edge[g->slot[slot] - 1].ends, ends)) slot = (slot + 1) % SLOTS;
    if (!g->slot[slot]) {
        memcpy(g->edge[g->count].ends, ends, sizeof ends);
        g->slot[slot] = (uint16_t)++g->count;
    }
    return &g->edge[g->slot[slot] - 1].root;
}

static root_search search_edge(root_group *g, size_t k)
{
    double e[WORDS];
    memcpy(e, g->edge[k].ends, sizeof e);
    return begin_search((vec3){e[0], e[1], e[2]}, (vec3){e[3], e[4], e[5]}, e[6], e[7], &g->edge[k].root);
}

/* Computes all roots in SIMD lanes. A lane whose root is found continues with the next edge. The results do
 * not depend on the other lanes. */
void root_group_find(root_group *g, const field *f)
{
    root_search lane[VEC3_LANES];
    bool busy[VEC3_LANES];
    size_t next = 0, left = g->count;
    for (int l = 0; l < VEC3_LANES; l++)
        if ((busy[l] = next < g->count)) lane[l] = search_edge(g, next++);
    while (left > 0) {
        vec3_lanes x, gradient;
        double value[VEC3_LANES];
        bool defined[VEC3_LANES];
        for (int l = 0; l < VEC3_LANES; l++) {
            if (busy[l]) choose_place(&lane[l]);
            vec3_lanes_put(&x, l, lane[busy[l] ? l : 0].out->position);
            defined[l] = busy[l];
        }
        field_sample_lanes(f, &x, defined, value, &gradient);
        for (int l = 0; l < VEC3_LANES; l++) {
            if (!busy[l] || (defined[l] && !take_sample(&lane[l], value[l], vec3_lanes_get(&gradient, l),
                                                        CELL_LAST_STEP * f->cell_size)))
                continue;
            left--;
            if ((busy[l] = next < g->count)) lane[l] = search_edge(g, next++);
        }
    }
}

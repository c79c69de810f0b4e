// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/planar_cells.h"

#include <math.h>
#include <string.h>

#include "base/core/lanes.h"
#include "geometry/space/packing.h"
#include "sampling/packing/pair.h"

/* See planar_cells.h. The error of a polygon grows with the square of the angle between the normals. With the cosine
 * 0.9 and the edge 0.225 of the solver, half as many cells of strongly bent surfaces are certain. */
static const voronoi_planar_bounds BOUNDS = {
    .cosine = PLANAR_CELLS_COSINE, .edge = 0.0005, .near_only = true};

static voronoi_planar_bounds bounds_of(bool borders)
{
    voronoi_planar_bounds bounds = BOUNDS;
    bounds.wide = !borders;
    return bounds;
}

/* Points within VORONOI_FIRST_RING of a point that are tried; with more, they are listed by voronoi.h. ROOM: sides of a
 * polygon, with the first two of them again. */
enum { RING = 8, ROOM = VORONOI_PLANAR_MAX + 2 };
/* The kind of a point that is not plain; of others, their piece. */
enum { NOT_PLAIN = -1 };
/* Minimum of squares by which is divided. */
static const float TINY = 1e-12f;

void planar_cells_gather(const partition *part, uint32_t at, uint32_t first, voronoi_listed *out)
{
    const voronoi_sites all_sites = {part->position, part->normal, part->spacing,
                                     part->near,     NULL,         part->index};
    voronoi_gather_listed(&all_sites, at, first, out);
}

/* ---- neighbours in lanes
 *
 * LANES points are processed at once, one in each lane. Lengths are divided by the spacing of the point. */

typedef struct vector {
    lanes x, y, z;
} vector;

ISA_INLINE vector add(vector a, vector b)
{
    return (vector){a.x + b.x, a.y + b.y, a.z + b.z};
}

ISA_INLINE vector minus(vector a, vector b)
{
    return (vector){a.x - b.x, a.y - b.y, a.z - b.z};
}

ISA_INLINE vector axpy(lanes t, vector a, vector b)
{
    return (vector){t * a.x + b.x, t * a.y + b.y, t * a.z + b.z};
}

ISA_INLINE lanes dot(vector a, vector b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

ISA_INLINE vector cross(vector a, vector b)
{
    return (vector){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

ISA_INLINE lanes norm(vector a)
{
    return lanes_root(dot(a, a));
}

/* A neighbour of each point: its place relative to the point, how much its spacing is larger, its normal and its kind.
 * One neighbour of one point is the same eight numbers. */
typedef union neighbour {
    lanes number[LANES];
    struct {
        vector at;
        lanes growth;
        vector normal;
        lanes kind; /* bits of an int32_t */
    };
} neighbour;

typedef double four __attribute__((vector_size(32)));
typedef float four_floats __attribute__((vector_size(16)));

/* The points and what is found of each. */
typedef struct batch {
    const planar_points *of;
    uint32_t at[LANES];
    four own[LANES];     /* position and spacing */
    double scale[LANES]; /* 1 / spacing */
    lanes support2;      /* square of the support of the energy, unless that depends on the pair */
    vector normal, u, v; /* the normal and the tangent frame */
    lanes_mask kind;
    /* ring[l][0] .. ring[l][filled[l] - 1]: the points within VORONOI_FIRST_RING, at most RING + 1; then a scratch */
    lanes ring[LANES][RING + 2];
    lanes_mask filled;
    /* of points that are not in the ring, nor on opposite walls: the smallest squared distance; the least and the largest
     * growth of all points */
    lanes beyond, least, widest;
    lanes foreign2; /* smallest squared distance of a point of another kind or an opposite wall */
    lanes nearest2, energy;
    lanes_mask alike;
    lanes_mask bent, count; /* beyond the bounds; number of sides, 0: unknown */
    neighbour side[ROOM];   /* in counterclockwise order, the first two again behind the last one */
} batch;

static int32_t kind_of(const planar_points *p, uint32_t i)
{
    if (p->part->flags && p->part->flags[i]) return NOT_PLAIN;
    return p->piece ? (int32_t)p->piece[p->part->index[i]] : 0;
}

ISA_INLINE four place_of(const partition *part, uint32_t i)
{
    const vec3 x = part->position[i];
    return (four){x.x, x.y, x.z, part->spacing[i]};
}

/* The eight numbers of point j as a neighbour of the point in lane l. */
ISA_INLINE lanes load(const batch *b, size_t l, uint32_t j)
{
    const partition *part = b->of->part;
    const vec3 n = part->normal[j];
    const four_floats to =
                          __builtin_convertvector((place_of(part, j) - b->own[l]) * b->scale[l], four_floats),
                      normal = __builtin_convertvector(((four){n.x, n.y, n.z, 0}), four_floats);
    lanes_mask out = (lanes_mask)__builtin_shufflevector(to, normal, 0, 1, 2, 3, 4, 5, 6, 7);
    if (part->flags || b->of->piece) out[LANES - 1] = kind_of(b->of, j);
    return (lanes)out;
}

/* phi of energy_cotangent for squared distances over the support, below 1. */
ISA_INLINE lanes potential(lanes u2)
{
    const lanes q = u2 * (float)(M_PI_2 * M_PI_2), q2 = q * q, q4 = q2 * q2;
    return (PAIR_W_COT_W(q, q2, q4) + q) / lanes_root(q) - (float)M_PI_2;
}

/* Adds the pairs with a neighbour; `listed`: of the lanes that have it. */
ISA_INLINE void add_neighbour(batch *b, const neighbour *n, lanes_mask listed)
{
    const float reach2 = VORONOI_FIRST_RING * VORONOI_FIRST_RING;
    const lanes none = lanes_all(INFINITY), square = lanes_chosen(listed, dot(n->at, n->at), none),
                facing = dot(n->normal, b->normal), mean = 1 + 0.5f * n->growth, mean2 = mean * mean,
                relative2 = square / mean2;
    const lanes_mask seen = listed & (facing > (float)PAIR_FACING_NONE), within = seen & (square < reach2),
                     other = listed & ((lanes_mask)n->kind != b->kind),
                     opposite = listed & (facing <= (float)SITES_OPPOSITE),
                     foreign = other | (listed & (facing < (float)VORONOI_OPPOSITE_COSINE));
    const lanes growth = lanes_only(seen, n->growth);
    b->filled -= within & (b->filled <= RING);
    b->beyond = lanes_smaller(b->beyond, lanes_chosen(seen & ~within, square, none));
    b->least = lanes_smaller(b->least, growth);
    b->widest = lanes_larger(b->widest, growth);
    b->foreign2 = lanes_smaller(b->foreign2, lanes_chosen(foreign, square, none));
    b->alike &= ~(other | opposite);
    b->nearest2 = lanes_smaller(b->nearest2, relative2);
    const bool sized = b->of->support == 0;
    const lanes u2 = sized ? relative2 / 3 : square / b->support2, weight = sized ? mean2 : lanes_all(1);
    const lanes phi = potential(lanes_larger(lanes_smaller(u2, lanes_all(1)), lanes_all(TINY)));
    b->energy += lanes_only(u2 < 1, weight * phi);
}

ISA_CLONES static void add_lists(batch *b)
{
    const neighbours *near = b->of->part->near;
    const uint32_t *list[LANES];
    lanes_mask count;
    int32_t longest = 0;
    for (size_t l = 0; l < LANES; l++) {
        list[l] = neighbours_list(near, b->at[l]);
        count[l] = (int32_t)near->list_count[b->at[l]];
        longest = count[l] > longest ? count[l] : longest;
    }
    b->filled = (lanes_mask){0};
    b->alike = b->kind != NOT_PLAIN;
    b->beyond = b->foreign2 = b->nearest2 = lanes_all(INFINITY);
    b->least = b->widest = b->energy = lanes_all(0);
    for (int32_t k = 0; k < longest; k++) {
        neighbour n;
        for (size_t l = 0; l < LANES; l++) b->ring[l][b->filled[l]] = n.number[l] = load(b, l, list[l][k]);
        lanes_transpose(n.number);
        add_neighbour(b, &n, count > k);
    }
}

/* ---- the polygon */

/* A neighbour in the tangent plane. */
typedef struct planar {
    lanes x, y, square; /* the squared distance in space */
} planar;

ISA_INLINE planar planar_of(const batch *b, const neighbour *n)
{
    return (planar){dot(b->u, n->at), dot(b->v, n->at), dot(n->at, n->at)};
}

/* Loads a point of each ring: of lane l the one with number at[l]. */
ISA_INLINE void load_ring(const batch *b, lanes_mask at, neighbour *out)
{
    for (size_t l = 0; l < LANES; l++) out->number[l] = b->ring[l][at[l]];
    lanes_transpose(out->number);
}

/* Sets numbers that grow with the angle of the points in the tangent plane. The lowest bits are the number in the ring.
 * Numbers of points that a ring lacks are larger. Returns the largest bend, as bend_of in voronoi.c does. */
ISA_INLINE lanes compute_angles(const batch *b, int32_t most, lanes angle[RING])
{
    lanes bend = lanes_all(0);
    for (int32_t k = 0; k < most; k++) {
        const lanes_mask has = b->filled > k;
        neighbour n;
        load_ring(b, (lanes_mask){0} + k, &n);
        const planar p = planar_of(b, &n);
        const lanes height = dot(b->normal, n.at),
                    bends = lanes_larger(1 - dot(b->normal, n.normal), 2 * height * height / p.square),
                    turn = 1 - p.x / (lanes_magnitude(p.x) + lanes_magnitude(p.y) + TINY),
                    key = lanes_chosen(has, 3 + lanes_signed(turn, p.y), lanes_all(RING));
        angle[k] = (lanes)(((lanes_mask)key & -RING) | k);
        bend = lanes_larger(bend, lanes_only(has, bends));
    }
    return bend;
}

/* Lists the points of each ring by their angles, and the first ones again, as sides. */
ISA_INLINE void sort_sides(batch *b, int32_t most, lanes angle[RING])
{
    for (int32_t last = most - 1; last > 0; last--)
        for (int32_t k = 0; k < last; k++) {
            const lanes low = lanes_smaller(angle[k], angle[k + 1]);
            angle[k + 1] = lanes_larger(angle[k], angle[k + 1]);
            angle[k] = low;
        }
    for (int32_t k = 0; k < most + 2; k++) {
        lanes_mask number;
        for (size_t l = 0; l < LANES; l++) {
            const int32_t from = k < b->filled[l] || b->filled[l] > RING ? k : k - b->filled[l];
            lanes_mask bits;
            memcpy(&bits, &angle[from < most ? from : 0], sizeof bits);
            number[l] = bits[l] & (RING - 1);
        }
        load_ring(b, number, &b->side[k]);
    }
}

/* Sets `count` where all points of the ring have a side: the tests of voronoi.c, for all sides. */
ISA_CLONES static void find_polygons(batch *b)
{
    int32_t most = 3;
    for (size_t l = 0; l < LANES; l++) most = b->filled[l] > most ? b->filled[l] : most;
    most = most < RING ? most : RING;
    lanes angle[RING];
    const lanes bend = compute_angles(b, most, angle),
                clear = lanes_larger(lanes_all((float)BOUNDS.edge), bend) * (1 + b->widest),
                unlisted = (float)(0.5 * VORONOI_REACH) * (2 + b->least),
                beyond = lanes_smaller(lanes_root(b->beyond), unlisted);
    sort_sides(b, most, angle);
    const lanes_mask wide = (lanes_mask){0} - !b->of->borders;
    planar q = planar_of(b, &b->side[0]);
    lanes before = lanes_all(0), rest_before = lanes_all(0);
    lanes_mask closed = (b->filled >= 3) & (b->filled <= RING);
    for (int32_t k = 0; k <= most; k++) {
        const planar r = planar_of(b, &b->side[k + 1]);
        const lanes plane = q.x * q.x + q.y * q.y, after = q.x * r.y - q.y * r.x,
                    along = q.x * r.x + q.y * r.y, rest_after = r.square * plane - q.square * along,
                    rest_next = q.square * (r.x * r.x + r.y * r.y) - r.square * along;
        const lanes length = rest_after * before + rest_before * after,
                    least = 2 * clear * lanes_root(plane) * before * after;
        /* the corner between the two */
        const lanes tangent = (lanes_root(along * along + after * after) - along) / after,
                    room = beyond - clear * lanes_chosen(along < 0, tangent, lanes_all(1)),
                    across2 = after * after,
                    farthest2 = rest_after * rest_after + q.square * q.square * across2;
        const lanes_mask corner = (after > 0) & ((along >= 0) | wide) & (room > 0) &
                                  (farthest2 <= room * room * plane * across2),
                         side = (before > 0) & (after > 0) & (length > least), none = (lanes_mask){0};
        closed &= (corner | (b->filled <= k)) & (side | (b->filled < k) | (none == k));
        before = after;
        rest_before = rest_next;
        q = r;
    }
    b->bent = bend > (float)(1 - BOUNDS.cosine);
    b->count = b->filled & closed & ~b->bent;
}

/* Finds the polygon of the point in lane l among all points of its list. */
static void find_polygon(batch *b, size_t l)
{
    const partition *part = b->of->part;
    const uint32_t at = b->at[l], *list = neighbours_list(part->near, at);
    uint32_t place[VORONOI_PLANAR_MAX];
    const voronoi_planar_bounds bounds = bounds_of(b->of->borders);
    voronoi_listed listed;
    planar_cells_gather(part, at, 0, &listed);
    const uint32_t count = voronoi_planar_neighbours(&listed, part->spacing[at], &bounds, place);
    for (uint32_t k = 0; count > 0 && k <= count; k++) {
        const lanes one = load(b, l, list[place[k % count]]);
        for (size_t m = 0; m < LANES; m++) b->side[k].number[m][l] = one[m];
    }
    b->count[l] = (int32_t)count;
}

/* ---- its measures */

/* Sums over the sides of each cell; see planar_cell. */
typedef struct cell_sums {
    lanes area, bend, farthest, straight, edge, edge2, growth2;
} cell_sums;

/* The middle of the curve between two places with unit normals m and n: a cubic with its ends in the tangent
 * planes (Vlachos, Peters, Boyd and Mitchell 2001, "Curved PN triangles"). */
ISA_INLINE vector curve_middle(vector a, vector m, vector b, vector n)
{
    const vector d = minus(b, a), sum = add(a, b), middle = {0.5f * sum.x, 0.5f * sum.y, 0.5f * sum.z};
    return axpy(-0.125f * dot(m, d), m, axpy(0.125f * dot(n, d), n, middle));
}

ISA_INLINE lanes twice_area(vector a, vector b, vector c)
{
    return norm(cross(minus(b, a), minus(c, a)));
}

/* The area between the three curves of a triangle over that of the triangle, by one division into four and
 * Richardson's extrapolation. The first corner is at the origin; u and v are the others, with normals m and n, and
 * the middles of the curves to them are p and q. `twice`: twice the area of the triangle. */
ISA_INLINE lanes bend_factor(vector u, vector m, vector p, vector v, vector n, vector q, lanes twice)
{
    const vector between = curve_middle(u, m, v, n);
    const lanes sum =
        norm(cross(p, q)) + twice_area(p, u, between) + twice_area(q, between, v) + twice_area(p, between, q);
    return (4 * sum / twice - 1) / 3;
}

/* The length of the side from the middle of a curve to a corner, to the second order: an arc of a circle. `turn`: the
 * third normal of the triangle minus the mean of those at the ends of the curve. The corner is at a third of the way
 * to that normal; noise of the normals enters less than by their angles with the side. */
ISA_INLINE lanes side_length(vector side, vector turn)
{
    const lanes bend = dot(turn, side) / 3;
    return lanes_root(dot(side, side) + bend * bend / 12);
}

/* Adds the triangles of the points and two consecutive neighbours, with p and q the middles of the curves to these. */
ISA_INLINE void add_triangle(const batch *b, const neighbour *first, const neighbour *second, vector p,
                             vector q, lanes_mask has, cell_sums *to)
{
    const vector u = first->at, v = second->at, m = first->normal, n = second->normal, w = cross(u, v);
    const lanes u2 = dot(u, u), v2 = dot(v, v), uv = dot(u, v), twice = norm(w), half = 0.5f / twice,
                distance = lanes_root(u2);
    const lanes at_v = half * (v2 - uv),
                at_u = half * (u2 - uv); /* half the cotangents of the angles there */
    const lanes to_u = 2 * half * half * v2, to_v = 2 * half * half * u2;
    const vector wu = cross(w, u), vw = cross(v, w),
                 centre = {to_u * wu.x + to_v * vw.x, to_u * wu.y + to_v * vw.y,
                           to_u * wu.z + to_v * vw.z}; /* the circumcentre */
    /* the surface over it: its distance from a tangent plane is half of the plane's distance from the chord */
    const lanes rise = -(dot(b->normal, centre) + dot(m, minus(centre, u)) + dot(n, minus(centre, v))) / 6;
    const vector corner = axpy(lanes_signed(lanes_all(1), dot(w, b->normal)) * rise / twice, w, centre);
    const lanes flat = 0.25f * (u2 * at_v + v2 * at_u),
                bend = flat * (bend_factor(u, m, p, v, n, q, twice) - 1);
    const vector third_p = axpy(lanes_all(-0.5f), add(b->normal, m), n),
                 third_q = axpy(lanes_all(-0.5f), add(b->normal, n), m);
    const lanes half_p = lanes_signed(side_length(minus(corner, p), third_p), at_v),
                half_q = lanes_signed(side_length(minus(corner, q), third_q), at_u),
                straight = 0.25f * (distance * half_p + lanes_root(v2) * half_q);
    const lanes edge = distance / (1 + 0.5f * first->growth) - 1, growth = first->growth / distance;
    to->area += lanes_only(has, flat + bend);
    to->bend += lanes_only(has, lanes_magnitude(bend));
    to->farthest = lanes_larger(to->farthest, lanes_only(has, norm(corner)));
    to->straight += lanes_only(has, straight);
    to->edge += lanes_only(has, edge);
    to->edge2 += lanes_only(has, edge * edge);
    to->growth2 += lanes_only(has, growth * growth);
}

ISA_INLINE vector middle_to(const batch *b, const neighbour *n)
{
    const vector here = {lanes_all(0), lanes_all(0), lanes_all(0)};
    return curve_middle(here, b->normal, n->at, n->normal);
}

ISA_CLONES static void measure_polygons(const batch *b, cell_sums *out)
{
    cell_sums sums = {lanes_all(0), lanes_all(0), lanes_all(0), lanes_all(0),
                      lanes_all(0), lanes_all(0), lanes_all(0)};
    int32_t most = 0;
    for (size_t l = 0; l < LANES; l++) most = b->count[l] > most ? b->count[l] : most;
    vector p = middle_to(b, &b->side[0]);
    for (int32_t k = 0; k < most; k++) {
        const vector q = middle_to(b, &b->side[k + 1]);
        add_triangle(b, &b->side[k], &b->side[k + 1], p, q, b->count > k, &sums);
        p = q;
    }
    *out = sums;
}

static planar_cell cell_of(const batch *b, const cell_sums *sums, size_t l, double *area)
{
    const float farthest = sums->farthest[l];
    const double h = b->own[l][3];
    if (b->count[l] == 0 || !(farthest <= (float)PLANAR_CELLS_FARTHEST) ||
        b->foreign2[l] < 4 * farthest * farthest)
        return (planar_cell){.certain = false};
    *area = sums->area[l] * h * h;
    return (planar_cell){.farthest = (float)(farthest * h),
                         .edge = sums->edge[l],
                         .edge2 = sums->edge2[l],
                         .straight = (float)(sums->straight[l] - PLANAR_STRAIGHT),
                         .growth2 = sums->growth2[l],
                         .bend = (uint16_t)ceil(PLANAR_BEND * fmin(sums->bend[l] / sums->area[l], 1)),
                         .degree = (uint8_t)b->count[l],
                         .certain = true};
}

ISA_CLONES static void set_frames(batch *b)
{
    const vector n = b->normal;
    const lanes sign = lanes_signed(lanes_all(1), n.z), a = -1 / (sign + n.z), c = n.x * n.y * a;
    b->u = (vector){1 + sign * n.x * n.x * a, sign * c, -sign * n.x};
    b->v = (vector){c, sign + n.y * n.y * a, -n.y};
}

static void open_batch(const planar_points *of, const uint32_t *at, size_t count, batch *out)
{
    const partition *part = of->part;
    out->of = of;
    for (size_t l = 0; l < LANES; l++) {
        const uint32_t i = out->at[l] = at[l < count ? l : 0];
        out->own[l] = place_of(part, i);
        out->scale[l] = 1 / part->spacing[i];
        out->kind[l] = kind_of(of, i);
        const double support = of->support * out->scale[l];
        out->support2[l] = (float)(support * support);
        out->normal.x[l] = (float)part->normal[i].x;
        out->normal.y[l] = (float)part->normal[i].y;
        out->normal.z[l] = (float)part->normal[i].z;
    }
    set_frames(out);
}

void planar_cells_at(const planar_points *of, const uint32_t *at, size_t count, planar_cell *cell,
                     double *area, planar_pairs *pairs)
{
    batch b;
    cell_sums sums;
    open_batch(of, at, count, &b);
    add_lists(&b);
    for (size_t l = 0; l < count; l++)
        pairs[l] = (planar_pairs){b.alike[l], sqrt(b.nearest2[l]), b.energy[l]};
    if (!cell) return;
    find_polygons(&b);
    for (size_t l = 0; l < count; l++) {
        if (b.kind[l] == NOT_PLAIN)
            b.count[l] = 0;
        else if (b.count[l] == 0 && !b.bent[l])
            find_polygon(&b, l);
    }
    measure_polygons(&b, &sums);
    for (size_t l = 0; l < count; l++) cell[l] = cell_of(&b, &sums, l, &area[l]);
}

double planar_cell_mean(const partition *part, bool borders, uint32_t at, const double *value)
{
    const voronoi_planar_bounds bounds = bounds_of(borders);
    voronoi_listed listed;
    uint32_t place[VORONOI_PLANAR_MAX];
    double sum = value[part->index[at]];
    planar_cells_gather(part, at, 0, &listed);
    const uint32_t *list = neighbours_list(part->near, at),
                   count = voronoi_planar_neighbours(&listed, part->spacing[at], &bounds, place);
    for (uint32_t k = 0; k < count; k++) sum += value[part->index[list[place[k]]]];
    return sum / (1 + count);
}

#include "surface/surface.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "surface/projection.h"

#define EDGES 64 /* an edge joins corners a < b: index 8 a + b */

/* Kuhn's decomposition: a tetrahedron for each order of the axes, along a path from corner 0 to 7. */
static const int tetrahedra[6][4] = {{0, 1, 3, 7}, {0, 1, 5, 7}, {0, 2, 3, 7},
                                     {0, 2, 6, 7}, {0, 4, 5, 7}, {0, 4, 6, 7}};

static const size_t GRAIN = 256; /* cells in a chunk of work */

/* Corners are projected to this fraction of the cell: its square is far below the area's error. */
static const double CORNER_TOLERANCE = 1e-4;
/* What the second order leaves is about the square of the excess: triangles above this are cut in four. */
static const double EXCESS_FINE = 5e-3;
/* For bumps of the size of a cell; a sliver at the last depth is corrected no more than this. */
static const int EXCESS_DEPTH = 2;
/* A middle that lies farther off its side than this share of the side belongs to another sheet, or the
 * surface is too rough there: the side stays straight. An arc of a right angle rises by 0.21. */
static const double RISE_LIMIT = 0.25;
/* Of the cell: a false position's error is not squared by the step after, as that of Newton's is. */
static const double ROOT_TOLERANCE = 1e-6;
/* Steps of a false position that halves the value of an end that stays twice (Illinois): a few do. */
static const int ROOT_STEPS = 24;
static const double EXCESS_LIMIT = 0.2;
/* Where the normals in a cell part by a smaller cosine the surface bends within it, and triangles as large
 * as the cell cut corners: it is measured by so many parts along each axis. The area of a scanned bunny at
 * 128 voxels is 2.4e-4 smaller for it. */
static const double BENT_FACING = 0.8;
enum { PARTS = 4, NODES = PARTS + 1 };
/* A triangle that a face of the domain may cut is divided until its sides are this fraction of a cell, and of
 * the domain's shortest side, or so often: what lies between a boundary and its chords goes with the square. */
static const double CLIP_CELL = 1.0 / 8, CLIP_SIDE = 1.0 / 16;
static const int CLIP_DEPTH = 8;
/* How far the surface above a triangle may lie beyond its corners, of its longest side. */
static const double CLIP_BULGE = 0.1;
/* Newton steps that put a corner of a clipped triangle onto the surface: it is nearly there. */
static const int SLIDE_STEPS = 4;
/* A triangle and six planes. */
#define CLIP_CORNERS 9
/* Draws for a point of a triangle that lies in the domain, before any point of it does. */
static const int INSIDE_DRAWS = 200;

typedef struct corner {
    vec3 position, normal;
    bool known, smooth; /* smooth: projected, with a normal */
} corner;

typedef struct triangulation {
    int count;
    corner at[SURFACE_CELL_TRIANGLES][3];
    double area[SURFACE_CELL_TRIANGLES]; /* of what lies in the domain */
    bbox box;                            /* likewise */
} triangulation;

/* A point near the surface, onto it, if that is within `reach`. */
static void place_corner(const field *f, vec3 x, double reach, corner *c)
{
    const projection_limits limits = {3, CORNER_TOLERANCE * f->cell_size,
                                      10 * CORNER_TOLERANCE * f->cell_size, 0.05 * f->cell_size};
    *c = (corner){.position = x, .known = true};
    vec3 p = x;
    if (projection_find(f, &limits, &p, &c->normal) && vec3_norm2(vec3_sub(p, x)) < reach * reach) {
        c->position = p;
        c->smooth = true;
    }
}

/* Where the surface cuts an edge: a root between its ends, never elsewhere. Newton's steps would leave the
 * cell where the surface bends within it, and the triangles fold over each other and count twice. */
static const corner *cut_edge(const field *f, const field_cell *cell, corner *cache, int a, int b)
{
    corner *c = a < b ? &cache[8 * a + b] : &cache[8 * b + a];
    if (c->known) return c;
    double low = 0, high = 1, at_low = cell->value[a], at_high = cell->value[b];
    vec3 edge = vec3_sub(cell->corner[b], cell->corner[a]);
    bool low_is_inside = at_low < 0;
    int kept = 0; /* which end the last step left alone: -1 low, 1 high */
    c->known = true;
    for (int k = 0; k < ROOT_STEPS; k++) {
        field_sample s;
        double t = low + (high - low) * at_low / (at_low - at_high);
        c->position = vec3_axpy(t, edge, cell->corner[a]);
        if (!field_sample_at(f, c->position, FIELD_GRADIENT, &s)) return c;
        double length = vec3_norm(s.gradient);
        if (length > 0 && fabs(s.value) <= ROOT_TOLERANCE * f->cell_size * length) {
            c->normal = vec3_scale(s.gradient, 1 / length);
            c->smooth = true;
            return c;
        }
        if ((s.value < 0) == low_is_inside) {
            low = t;
            at_low = s.value;
            if (kept == 1) at_high *= 0.5;
            kept = 1;
        } else {
            high = t;
            at_high = s.value;
            if (kept == -1) at_low *= 0.5;
            kept = -1;
        }
    }
    return c;
}

/* The relative amount by which the geodesic triangle is larger than the flat one, to second order in edge
 * over radius of curvature. An edge of length l whose normals turn by a along it is l (1 + a^2 / 24) long on
 * the surface, which changes the area by cot(opposite angle) / 4 per change of squared length; and a triangle
 * with these sides has K (sum of squared sides) / 24 more area where the Gaussian curvature is K. */
static double curvature_excess(const corner *t, vec3 twice_area)
{
    double area = 0.5 * vec3_norm(twice_area), sum = 0, squares = 0;
    for (int k = 0; k < 3; k++) {
        const corner *o = &t[k], *p = &t[(k + 1) % 3], *q = &t[(k + 2) % 3];
        vec3 e = vec3_sub(q->position, p->position);
        double l2 = vec3_norm2(e), turn = vec3_dot(e, vec3_sub(q->normal, p->normal));
        double cot =
            vec3_dot(vec3_sub(p->position, o->position), vec3_sub(q->position, o->position)) / (2 * area);
        squares += l2;
        if (l2 > 0) sum += cot / 4 * (turn * turn / l2) * l2 / 12;
    }
    vec3 turns = vec3_cross(vec3_sub(t[1].normal, t[0].normal), vec3_sub(t[2].normal, t[0].normal));
    double gauss = vec3_dot(turns, twice_area) / vec3_norm2(twice_area);
    return sum / area + gauss * squares / 24;
}

/* Area of the surface above a triangle; where it curves much, by four triangles. */
static double curved_area(const field *f, const corner *t, int depth)
{
    vec3 twice_area =
        vec3_cross(vec3_sub(t[1].position, t[0].position), vec3_sub(t[2].position, t[0].position));
    double area = 0.5 * vec3_norm(twice_area);
    if (!(area > 0) || !t[0].smooth || !t[1].smooth || !t[2].smooth) return area;
    double excess = curvature_excess(t, twice_area);
    if (fabs(excess) < EXCESS_FINE) return area * (1 + excess);
    if (depth == EXCESS_DEPTH) return area * (1 + fmin(fmax(excess, -EXCESS_LIMIT), EXCESS_LIMIT));
    corner middle[3]; /* opposite of corner k */
    for (int k = 0; k < 3; k++) {
        vec3 p = t[(k + 1) % 3].position, q = t[(k + 2) % 3].position;
        place_corner(f, vec3_scale(vec3_add(p, q), 0.5), RISE_LIMIT * vec3_norm(vec3_sub(q, p)), &middle[k]);
    }
    double sum = curved_area(f, middle, depth + 1);
    for (int k = 0; k < 3; k++)
        sum += curved_area(f, (corner[3]){t[k], middle[(k + 1) % 3], middle[(k + 2) % 3]}, depth + 1);
    return sum;
}

/* ---- open surfaces: what lies in the domain of the triangles at its faces */

typedef struct clip_corner {
    corner corner;
    unsigned faces; /* bit 2 k + high: lies in that face of the domain */
} clip_corner;

bool surface_slide(const field *f, unsigned fixed, double reach, vec3 *x, vec3 *normal)
{
    vec3 p = *x;
    for (int k = 0; k <= SLIDE_STEPS; k++) {
        field_sample s;
        if (!field_sample_at(f, p, FIELD_GRADIENT, &s)) return false;
        double length = vec3_norm(s.gradient);
        if (length > 0 && fabs(s.value) <= ROOT_TOLERANCE * f->cell_size * length) {
            *x = p;
            *normal = vec3_scale(s.gradient, 1 / length);
            return true;
        }
        for (int axis = 0; axis < 3; axis++)
            if (fixed >> axis & 1) vec3_set(&s.gradient, axis, 0);
        double g2 = vec3_norm2(s.gradient);
        if (!(g2 > 0)) return false;
        p = vec3_axpy(-s.value / g2, s.gradient, p);
        if (vec3_norm2(vec3_sub(p, *x)) > reach * reach) return false;
    }
    return false;
}

/* Between two corners on either side of a face, in it. */
static clip_corner cut_side(const field *f, const clip_corner *p, const clip_corner *q, int face)
{
    int axis = face >> 1;
    double plane = vec3_get(face & 1 ? f->domain.max : f->domain.min, axis);
    double from = vec3_get(p->corner.position, axis), to = vec3_get(q->corner.position, axis);
    vec3 side = vec3_sub(q->corner.position, p->corner.position);
    clip_corner c = {.faces = (p->faces & q->faces) | 1u << face};
    c.corner.position = vec3_axpy((plane - from) / (to - from), side, p->corner.position);
    unsigned fixed = 0;
    for (int k = 0; k < 6; k++)
        if (c.faces >> k & 1) fixed |= 1u << (k >> 1);
    vec3_set(&c.corner.position, axis, plane);
    c.corner.smooth =
        surface_slide(f, fixed, RISE_LIMIT * vec3_norm(side), &c.corner.position, &c.corner.normal);
    return c;
}

/* Sutherland and Hodgman 1974, "Reentrant Polygon Clipping", one face. Returns the number of corners left. */
static int clip_at_face(const field *f, int face, const clip_corner *in, int count, clip_corner *out)
{
    int axis = face >> 1, left = 0;
    double sign = face & 1 ? -1 : 1, plane = vec3_get(face & 1 ? f->domain.max : f->domain.min, axis);
    for (int k = 0; k < count; k++) {
        const clip_corner *p = &in[k], *q = &in[(k + 1) % count];
        bool p_inside = sign * (vec3_get(p->corner.position, axis) - plane) >= 0;
        bool q_inside = sign * (vec3_get(q->corner.position, axis) - plane) >= 0;
        if (p_inside) out[left++] = *p;
        if (p_inside != q_inside) out[left++] = cut_side(f, p, q, face);
    }
    return left;
}

/* Area above a triangle so small that the faces cut it along straight lines. */
static double clip_small(const field *f, const corner *t, bbox *box)
{
    clip_corner polygon[2][CLIP_CORNERS + 1];
    int count = 3, at = 0;
    for (int k = 0; k < 3; k++) polygon[0][k] = (clip_corner){t[k], 0};
    for (int face = 0; face < 6 && count > 0; face++, at = !at)
        count = clip_at_face(f, face, polygon[at], count, polygon[!at]);
    const clip_corner *c = polygon[at];
    double sum = 0;
    for (int k = 0; k < count; k++) *box = bbox_include(*box, c[k].corner.position);
    for (int k = 1; k + 1 < count; k++)
        sum += curved_area(f, (corner[3]){c[0].corner, c[k].corner, c[k + 1].corner}, EXCESS_DEPTH);
    return sum;
}

static double clipped_area(const field *f, const corner *t, int depth, bbox *box)
{
    bbox mine = bbox_empty();
    double longest = 0;
    for (int k = 0; k < 3; k++) {
        mine = bbox_include(mine, t[k].position);
        longest = fmax(longest, vec3_norm(vec3_sub(t[k].position, t[(k + 1) % 3].position)));
    }
    bbox reach = bbox_grow(mine, CLIP_BULGE * longest);
    if (!bbox_overlap(reach, f->domain)) return 0;
    if (bbox_contains(f->domain, reach.min) && bbox_contains(f->domain, reach.max)) {
        *box = bbox_unite(*box, mine);
        return curved_area(f, t, 0);
    }
    vec3 size = bbox_size(f->domain);
    double fine = fmin(CLIP_CELL * f->cell_size, CLIP_SIDE * fmin(size.x, fmin(size.y, size.z)));
    if (longest <= fine || depth == CLIP_DEPTH) return clip_small(f, t, box);
    corner middle[3]; /* opposite of corner k */
    for (int k = 0; k < 3; k++) {
        vec3 p = t[(k + 1) % 3].position, q = t[(k + 2) % 3].position;
        middle[k] = (corner){.position = vec3_scale(vec3_add(p, q), 0.5)};
        middle[k].smooth = surface_slide(f, 0, RISE_LIMIT * vec3_norm(vec3_sub(q, p)), &middle[k].position,
                                         &middle[k].normal);
    }
    double sum = clipped_area(f, middle, depth + 1, box);
    for (int k = 0; k < 3; k++)
        sum += clipped_area(f, (corner[3]){t[k], middle[(k + 1) % 3], middle[(k + 2) % 3]}, depth + 1, box);
    return sum;
}

static void add_triangle(triangulation *out, const corner *a, const corner *b, const corner *c)
{
    corner *t = out->at[out->count++];
    t[0] = *a;
    t[1] = *b;
    t[2] = *c;
}

/* Whether the domain ends nowhere in the cell. */
static bool is_whole(const field *f, const field_cell *cell)
{
    for (int k = 0; f->open && k < 8; k++)
        if (!bbox_contains(f->domain, cell->corner[k])) return false;
    return true;
}

/* The triangles alone. */
static void cut_cell(const field *f, const field_cell *cell, triangulation *out)
{
    corner cache[EDGES];
    memset(cache, 0, sizeof cache);
    out->count = 0;
    for (int k = 0; k < 6; k++) {
        int inside[4], outside[4], in = 0, ex = 0;
        for (int v = 0; v < 4; v++) {
            int c = tetrahedra[k][v];
            if (cell->value[c] < 0)
                inside[in++] = c;
            else
                outside[ex++] = c;
        }
        if (in == 0 || ex == 0) continue;
        const corner *cut[4];
        int n = 0;
        for (int i = 0; i < in; i++) /* in the order of a ring round the section */
            for (int j = 0; j < ex; j++)
                cut[n++] = cut_edge(f, cell, cache, inside[i], outside[in == 2 && i == 1 ? ex - 1 - j : j]);
        add_triangle(out, cut[0], cut[1], cut[2]);
        if (n == 4) add_triangle(out, cut[0], cut[2], cut[3]);
    }
}

void surface_cell(const surface *s, size_t k, field_cell *out)
{
    s->field->ops->cell(s->field, s->parts.order ? s->parts.order[k] : k, out);
}

static bool is_bent(const triangulation *t)
{
    if (t->count == 0) return true; /* an edge passes between the corners */
    for (int i = 0; i < t->count; i++)
        for (int k = 0; k < 3; k++)
            if (vec3_dot(t->at[i][k].normal, t->at[0][0].normal) < BENT_FACING) return true;
    return false;
}

/* The corners of a cell's parts, and F there; false where F is not defined. */
static bool sample_parts(const field *f, const field_cell *cell, vec3 *node, double *value)
{
    for (int n = 0; n < NODES * NODES * NODES; n++) {
        const int at[3] = {n % NODES, n / NODES % NODES, n / NODES / NODES};
        field_sample s;
        node[n] = cell->corner[0];
        for (int axis = 0; axis < 3; axis++)
            node[n] = vec3_axpy(at[axis] / (double)PARTS, vec3_sub(cell->corner[1 << axis], cell->corner[0]),
                                node[n]);
        if (!field_sample_at(f, node[n], FIELD_GRADIENT, &s)) return false;
        value[n] = s.value;
    }
    return true;
}

/* The area in a part; of what has no triangles takes over some. */
static double part_area(const field *f, const vec3 *node, const double *value, int part,
                        triangulation *lacking)
{
    int first = part % PARTS + (part / PARTS % PARTS + part / PARTS / PARTS * NODES) * NODES, inside = 0;
    field_cell small;
    triangulation t;
    double area = 0;
    for (int k = 0; k < 8; k++) {
        int n = first + (k & 1) + ((k >> 1 & 1) + (k >> 2) * NODES) * NODES;
        small.corner[k] = node[n];
        small.value[k] = value[n];
        inside += value[n] < 0;
    }
    if (inside == 0 || inside == 8) return 0;
    cut_cell(f, &small, &t);
    for (int i = 0; i < t.count; i++) {
        double above = curved_area(f, t.at[i], EXCESS_DEPTH);
        area += above;
        if (!lacking || lacking->count == SURFACE_CELL_TRIANGLES) continue;
        lacking->area[lacking->count] = above;
        add_triangle(lacking, &t.at[i][0], &t.at[i][1], &t.at[i][2]);
    }
    return area;
}

/* Measures a cell by its parts; its triangles keep their proportions. What triangles cut off at a sharp edge
 * goes with their size, in the mean of all cells along it: what the parts leave is a third of what they gain. */
static void measure_parts(const field *f, const field_cell *cell, triangulation *out)
{
    vec3 node[NODES * NODES * NODES];
    double value[NODES * NODES * NODES], rough = 0, fine = 0, kept = 0;
    if (!sample_parts(f, cell, node, value)) return;
    triangulation *lacking = out->count == 0 ? out : NULL;
    for (int i = 0; i < out->count; i++) rough += out->area[i];
    for (int part = 0; part < PARTS * PARTS * PARTS; part++) fine += part_area(f, node, value, part, lacking);
    double whole = f->sharp ? fine + (fine - rough) / (PARTS - 1) : fine;
    for (int i = 0; i < out->count; i++) kept += out->area[i];
    for (int i = 0; i < out->count && kept > 0 && whole > 0; i++) out->area[i] *= whole / kept;
}

/* And what of them lies in the domain. */
static void measure_cell(const surface *s, size_t index, triangulation *out)
{
    const field *f = s->field;
    field_cell cell;
    surface_cell(s, index, &cell);
    cut_cell(f, &cell, out);
    bool whole = is_whole(f, &cell);
    out->box = bbox_empty();
    for (int i = 0; i < out->count; i++) {
        const corner *t = out->at[i];
        out->area[i] = whole ? curved_area(f, t, 0) : clipped_area(f, t, 0, &out->box);
    }
    if (!whole) return;
    if (is_bent(out)) measure_parts(f, &cell, out);
    for (int i = 0; i < out->count; i++)
        for (int k = 0; k < 3; k++) out->box = bbox_include(out->box, out->at[i][k].position);
}

typedef struct scan_job {
    surface *s;
    bbox *box; /* of each chunk */
} scan_job;

static void scan_chunk(void *context, int worker, size_t begin, size_t end)
{
    scan_job *job = context;
    (void)worker;
    triangulation t;
    for (size_t chunk = begin; chunk < end; chunk++) {
        size_t last = (chunk + 1) * GRAIN < job->s->cells ? (chunk + 1) * GRAIN : job->s->cells;
        job->box[chunk] = bbox_empty();
        for (size_t k = chunk * GRAIN; k < last; k++) {
            double area = 0;
            measure_cell(job->s, k, &t);
            for (int i = 0; i < t.count; i++) area += t.area[i];
            job->box[chunk] = bbox_unite(job->box[chunk], t.box);
            job->s->area_before[k + 1] = area;
        }
    }
}

static bool no_area(const field *f, error *e)
{
    vec3 low = f->domain.min, high = f->domain.max;
    if (!f->open) return error_set(e, ERROR_NO_SURFACE, "the surface has no area");
    return error_set(
        e, ERROR_NO_SURFACE,
        "no part of the surface lies between (%g, %g, %g) and (%g, %g, %g): move or widen the region", low.x,
        low.y, low.z, high.x, high.y, high.z);
}

surface *surface_scan(const field *f, threads *pool, error *e)
{
    surface *s = mem_alloc(sizeof *s);
    s->field = f;
    s->cells = f->ops->cell_count(f);
    size_t chunks = (s->cells + GRAIN - 1) / GRAIN;
    scan_job job = {s, mem_array(chunks, sizeof *job.box, "the scan of the surface", e)};
    s->area_before = mem_array(s->cells + 1, sizeof *s->area_before, "the scan of the surface", e);
    if (!job.box || !s->area_before || !components_find(f, pool, &s->parts, e)) goto fail;
    threads_run(pool, chunks, 1, scan_chunk, &job);
    if (threads_stopped(pool)) {
        error_set(e, ERROR_CANCELLED, "stopped");
        goto fail;
    }
    s->box = bbox_empty();
    for (size_t k = 0; k < chunks; k++) s->box = bbox_unite(s->box, job.box[k]);
    for (size_t k = 0; k < s->cells; k++) s->area_before[k + 1] += s->area_before[k];
    s->area = s->area_before[s->cells];
    if (!(s->area > 0)) {
        no_area(f, e);
        goto fail;
    }
    free(job.box);
    return s;
fail:
    free(job.box);
    surface_free(s);
    return NULL;
}

void surface_free(surface *s)
{
    if (!s) return;
    components_free(&s->parts);
    free(s->area_before);
    free(s);
}

static vec3 point_of_triangle(const corner *c, rng *r)
{
    double u = sqrt(rng_uniform(r)), v = rng_uniform(r);
    return vec3_add(vec3_scale(c[0].position, 1 - u),
                    vec3_add(vec3_scale(c[1].position, u * (1 - v)), vec3_scale(c[2].position, u * v)));
}

vec3 surface_point(const surface *s, const double *before, double where, rng *r)
{
    size_t low = 0, high = s->cells - 1; /* the last cell that begins at or before `where` */
    while (low < high) {
        size_t middle = low + (high - low + 1) / 2;
        if (before[middle] <= where)
            low = middle;
        else
            high = middle - 1;
    }
    triangulation t;
    measure_cell(s, low, &t);
    double share = (where - before[low]) / (before[low + 1] - before[low]), rest = 0;
    for (int i = 0; i < t.count; i++) rest += share * t.area[i];
    int k = 0;
    while (k < t.count - 1 && rest >= t.area[k]) rest -= t.area[k++];
    vec3 p = point_of_triangle(t.at[k], r);
    for (int draw = 0; s->field->open && draw < INSIDE_DRAWS && !bbox_contains(s->field->domain, p); draw++)
        p = point_of_triangle(t.at[k], r);
    return p;
}

int surface_cell_triangles(const surface *s, size_t cell, vec3 out[SURFACE_CELL_TRIANGLES][3])
{
    field_cell place;
    triangulation t;
    surface_cell(s, cell, &place);
    cut_cell(s->field, &place, &t);
    for (int i = 0; i < t.count; i++)
        for (int k = 0; k < 3; k++) out[i][k] = t.at[i][k].position;
    return t.count;
}

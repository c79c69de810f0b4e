// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/curves/boundary.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

/* Spacing of boundary particles over h. h counts them as particles with whole Voronoi cells, so that the
 * converged packing is this much wider. Smaller (0.95): a seam of defects along the boundary. */
static const double BOUNDARY_SPACING = 1.04;
/* Distance in spacings within which curve ends at an edge of the domain are one sample. */
static const double MERGE_DISTANCE = 0.3;

/* The object that messages about memory name. */
static const char *const WHAT = "the boundary curves";

typedef struct segment {
    vec3 end[2];
} segment;

typedef struct segments {
    segment *item;
    size_t count, capacity;
    size_t *partner; /* per end (2 segment + end): the end of another segment at the same position, or NONE */
} segments;

static const size_t NONE = SIZE_MAX;

/* ---- segments of one face */

/* Distance of x from a face of the domain, positive inside. Faces: 2 axis for the minimum, 2 axis + 1 for
 * the maximum. */
static double distance_inside(const field *f, int face, vec3 x)
{
    int axis = face >> 1;
    return face & 1 ? vec3_get(f->domain.max, axis) - vec3_get(x, axis)
                    : vec3_get(x, axis) - vec3_get(f->domain.min, axis);
}

/* Intersection of the line through p and q with a face. Symmetric in p and q to the last bit. */
static vec3 cross_face(const field *f, int face, vec3 p, vec3 q)
{
    if (vec3_compare(p, q) > 0) {
        vec3 swap = p;
        p = q;
        q = swap;
    }
    double from = distance_inside(f, face, p), to = distance_inside(f, face, q);
    vec3 x = from == 0 ? p : to == 0 ? q : vec3_axpy(from / (from - to), vec3_sub(q, p), p);
    vec3_set(&x, face >> 1, vec3_get(face & 1 ? f->domain.max : f->domain.min, face >> 1));
    return x;
}

/* Clips a segment to the domain's extent along the two other axes. False if nothing remains. */
static bool clip_segment(const field *f, int face, segment *s)
{
    for (int other = 0; other < BBOX_FACES; other++) {
        if (other >> 1 == face >> 1) continue;
        double a = distance_inside(f, other, s->end[0]), b = distance_inside(f, other, s->end[1]);
        if (a <= 0 && b <= 0) return false;
        if (a < 0) s->end[0] = cross_face(f, other, s->end[0], s->end[1]);
        if (b < 0) s->end[1] = cross_face(f, other, s->end[0], s->end[1]);
    }
    return true;
}

static bool add_segment(segments *all, const segment *s, error *e)
{
    if (!MEM_GROW(all->item, all->count, &all->capacity, WHAT, e)) return false;
    all->item[all->count++] = *s;
    return true;
}

/* Adds the segment in which a triangle cuts a face. A vertex in the face counts as outside: an edge in the
 * face is then found once, from the triangle inside. */
static bool cut_triangle(const field *f, int face, const vec3 t[3], segments *all, error *e)
{
    segment s;
    int ends = 0;
    for (int k = 0; k < 3; k++) {
        const vec3 *p = &t[k], *q = &t[(k + 1) % 3];
        if ((distance_inside(f, face, *p) > 0) == (distance_inside(f, face, *q) > 0)) continue;
        s.end[ends++] = cross_face(f, face, *p, *q);
    }
    if (ends < 2 || vec3_compare(s.end[0], s.end[1]) == 0 || !clip_segment(f, face, &s)) return true;
    return add_segment(all, &s, e);
}

/* Whether a cell has corners on both sides of a face. */
static bool cell_straddles_face(const surface *s, size_t cell, int face)
{
    field_cell c;
    bool inside = false, outside = false;
    surface_cell(s, cell, &c);
    for (int k = 0; k < FIELD_CELL_CORNERS; k++) {
        double h = distance_inside(s->field, face, c.corner[k]);
        inside |= h > 0;
        outside |= h <= 0;
    }
    return inside && outside;
}

static bool find_segments(const surface *s, int face, segments *all, error *e)
{
    vec3 t[FIELD_CELL_TRIANGLES][3];
    for (size_t k = 0; k < s->cells; k++) {
        if (!cell_straddles_face(s, k, face)) continue;
        int count = surface_cell_triangles(s, k, t);
        for (int i = 0; i < count; i++)
            if (!cut_triangle(s->field, face, t[i], all, e)) return false;
    }
    return true;
}

/* ---- curves */

typedef struct end {
    vec3 at;
    size_t number;
} end;

static int compare_ends(const void *a, const void *b)
{
    const end *x = a, *y = b;
    int order = vec3_compare(x->at, y->at);
    return order ? order : (x->number > y->number) - (x->number < y->number);
}

/* Sets `partner`: ends with bitwise equal positions are joined in pairs. */
static bool join_segments(segments *all, error *e)
{
    end *ends = mem_array(2 * all->count, sizeof *ends, WHAT, e);
    all->partner = mem_array(2 * all->count, sizeof *all->partner, WHAT, e);
    if (!ends || !all->partner) {
        free(ends);
        return false;
    }
    for (size_t k = 0; k < 2 * all->count; k++) {
        ends[k] = (end){all->item[k / 2].end[k % 2], k};
        all->partner[k] = NONE;
    }
    qsort(ends, 2 * all->count, sizeof *ends, compare_ends);
    for (size_t k = 0; k + 1 < 2 * all->count; k++) {
        if (vec3_compare(ends[k].at, ends[k + 1].at) != 0) continue;
        all->partner[ends[k].number] = ends[k + 1].number;
        all->partner[ends[k + 1].number] = ends[k].number;
        k++;
    }
    free(ends);
    return true;
}

typedef struct curve {
    vec3 *point;
    size_t count;
    double length; /* sum of side_length */
    bool closed;
} curve;

/* Requested spacing at x over the spacing of a uniform request. */
static double relative_spacing(const boundary_request *r, vec3 x)
{
    return r->sizing ? sizing_field_spacing(r->sizing, x, NULL) / r->even : 1;
}

/* Length of a side. With a sizing field: divided by the relative spacing at its middle. */
static double side_length(const boundary_request *r, vec3 a, vec3 b)
{
    return vec3_norm(vec3_sub(b, a)) / relative_spacing(r, vec3_scale(vec3_add(a, b), 0.5));
}

/* The curve that starts with segment end `first`. Its segments are marked as visited. */
static void trace_curve(const boundary_request *r, const segments *all, size_t first, bool *visited,
                        curve *out)
{
    size_t at = first;
    out->count = 0;
    out->length = 0;
    out->point[out->count++] = all->item[at / 2].end[at % 2];
    do {
        size_t other = at ^ 1;
        vec3 x = all->item[other / 2].end[other % 2];
        visited[at / 2] = true;
        out->length += side_length(r, out->point[out->count - 1], x);
        out->point[out->count++] = x;
        at = all->partner[other];
    } while (at != NONE && !visited[at / 2]);
    out->closed = at == first;
}

/* ---- samples */

typedef struct boundary_sampler {
    const surface *s;
    const boundary_request *request;
    double spacing; /* of samples at a relative spacing of 1 */
    boundary *out;
    size_t capacity;
} boundary_sampler;

/* Projects a sample onto the surface within the faces that it lies in. False if that fails or leaves the
 * domain. */
static bool project_in_faces(const boundary_sampler *w, vec3 *x, vec3 *normal)
{
    const field *f = w->s->field;
    unsigned fixed = 0;
    for (int face = 0; face < BBOX_FACES; face++)
        if (distance_inside(f, face, *x) == 0) fixed |= 1u << (face >> 1);
    return surface_slide(f, fixed, w->spacing * relative_spacing(w->request, *x), x, normal) &&
           bbox_contains(f->domain, *x);
}

static void add_sample(boundary_sampler *w, vec3 x)
{
    vec3 normal;
    if (w->out->count == w->capacity || !project_in_faces(w, &x, &normal)) return;
    w->out->position[w->out->count] = x;
    w->out->normal[w->out->count++] = normal;
}

/* Adds the end of a curve. Two curves end where the surface meets an edge of the domain; the end is added
 * once. */
static void add_corner(boundary_sampler *w, vec3 x)
{
    for (size_t k = 0; k < w->out->count; k++)
        if (vec3_norm(vec3_sub(w->out->position[k], x)) <
            MERGE_DISTANCE * w->spacing * relative_spacing(w->request, x))
            return;
    add_sample(w, x);
}

static void sample_corners(boundary_sampler *w, const curve *c)
{
    if (c->closed) return;
    add_corner(w, c->point[0]);
    add_corner(w, c->point[c->count - 1]);
}

/* Adds samples at equal arc lengths along a curve, without its corners. */
static void sample_curve(boundary_sampler *w, const curve *c)
{
    double spaces = round(c->length / w->spacing), step = c->length / spaces, before = 0,
           next = c->closed ? 0 : 1;
    for (size_t k = 0; k + 1 < c->count; k++) {
        vec3 side = vec3_sub(c->point[k + 1], c->point[k]);
        double length = side_length(w->request, c->point[k], c->point[k + 1]);
        for (; next < spaces && next * step <= before + length; next++)
            add_sample(w, vec3_axpy(fmax(next * step - before, 0) / length, side, c->point[k]));
        before += length;
    }
}

typedef struct curves {
    curve *item;
    size_t count;
} curves;

/* Appends the curves that consist of the segments to a list. */
static bool collect_curves(const boundary_request *r, const segments *all, curves *list, error *e)
{
    bool *visited = mem_array(all->count, sizeof *visited, WHAT, e);
    vec3 *points = mem_array(all->count + 1, sizeof *points, WHAT, e);
    curve *larger = mem_array(list->count + all->count, sizeof *larger, WHAT, e);
    bool ok = visited && points && larger;
    if (ok) {
        if (list->count) memcpy(larger, list->item, list->count * sizeof *larger);
        free(list->item);
        list->item = larger;
        larger = NULL;
    }
    for (int closed = 0; ok && closed < 2; closed++) /* open curves first, from one of their ends */
        for (size_t k = 0; ok && k < 2 * all->count; k++) {
            curve c = {.point = points};
            if (visited[k / 2] || (!closed && all->partner[k] != NONE)) continue;
            trace_curve(r, all, k, visited, &c);
            c.point = mem_array(c.count, sizeof *c.point, WHAT, e);
            ok = c.point != NULL;
            if (!ok) break;
            memcpy(c.point, points, c.count * sizeof *c.point);
            list->item[list->count++] = c;
        }
    free(visited);
    free(points);
    free(larger);
    return ok;
}

static bool find_curves(const surface *s, const boundary_request *r, int face, curves *list, error *e)
{
    segments all = {0};
    bool ok = find_segments(s, face, &all, e) &&
              (all.count == 0 || (join_segments(&all, e) && collect_curves(r, &all, list, e)));
    free(all.item);
    free(all.partner);
    return ok;
}

static void free_curves(curves *list)
{
    for (size_t k = 0; k < list->count; k++) free(list->item[k].point);
    free(list->item);
}

static bool sample_all(const curves *list, boundary_sampler *w, error *e)
{
    double length = 0;
    for (size_t k = 0; k < list->count; k++) length += list->item[k].length;
    double most = (double)w->request->most;
    w->spacing = fmax(BOUNDARY_SPACING * w->request->spacing, length / most);
    double samples =
        length / w->spacing + 3 * (double)list->count; /* per curve: two corners and one by rounding */
    w->capacity = (size_t)fmin(samples, most);
    w->out->position = mem_array(w->capacity, sizeof(vec3), WHAT, e);
    w->out->normal = mem_array(w->capacity, sizeof(vec3), WHAT, e);
    if (!w->out->position || !w->out->normal) return false;
    for (size_t k = 0; k < list->count; k++) sample_corners(w, &list->item[k]);
    for (size_t k = 0; k < list->count; k++) sample_curve(w, &list->item[k]);
    return true;
}

double boundary_spacing(const boundary_request *request, vec3 x)
{
    return request->spacing * relative_spacing(request, x);
}

bool boundary_find(const surface *s, const boundary_request *request, boundary *out, error *e)
{
    const field *f = s->field;
    curves list = {0};
    boundary_sampler w = {.s = s, .request = request, .out = out};
    bool ok = true;
    *out = (boundary){0};
    if (!f->open || request->most == 0) return true;
    for (int face = 0; ok && face < BBOX_FACES; face++)
        if (isfinite(vec3_get(face & 1 ? f->boundary_box.max : f->boundary_box.min, face >> 1)))
            ok = find_curves(s, request, face, &list, e);
    ok = ok && sample_all(&list, &w, e);
    free_curves(&list);
    return ok;
}

void boundary_free(boundary *samples)
{
    free(samples->position);
    free(samples->normal);
    *samples = (boundary){0};
}

#include "solver/curves/boundary.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

/* Of h, which counts boundary particles as whole ones: at rest the packing behind the row is that much wider.
 * Denser rows (0.95) leave a seam of defects behind them. */
static const double ROW_SPACING = 1.04;
/* Of the spacing: ends of curves that meet at an edge of the domain are one place. */
static const double SAME_PLACE = 0.3;

typedef struct segment {
    vec3 end[2];
} segment;

typedef struct segments {
    segment *item;
    size_t count, capacity;
    size_t *partner; /* of end number 2 k + end: the end of another segment there, or NONE */
} segments;

static const size_t NONE = SIZE_MAX;

/* ---- segments of one face */

static double height(const field *f, int face, vec3 x)
{
    int axis = face >> 1;
    return face & 1 ? vec3_get(f->domain.max, axis) - vec3_get(x, axis)
                    : vec3_get(x, axis) - vec3_get(f->domain.min, axis);
}

/* Where the line through two points crosses a face: the same bits whichever comes first. */
static vec3 cross_face(const field *f, int face, vec3 p, vec3 q)
{
    if (vec3_compare(p, q) > 0) {
        vec3 swap = p;
        p = q;
        q = swap;
    }
    double from = height(f, face, p), to = height(f, face, q);
    vec3 x = from == 0 ? p : to == 0 ? q : vec3_axpy(from / (from - to), vec3_sub(q, p), p);
    vec3_set(&x, face >> 1, vec3_get(face & 1 ? f->domain.max : f->domain.min, face >> 1));
    return x;
}

/* What is between the other faces of the domain; false where that is nothing. */
static bool cut_segment(const field *f, int face, segment *s)
{
    for (int other = 0; other < 6; other++) {
        if (other >> 1 == face >> 1) continue;
        double a = height(f, other, s->end[0]), b = height(f, other, s->end[1]);
        if (a <= 0 && b <= 0) return false;
        if (a < 0) s->end[0] = cross_face(f, other, s->end[0], s->end[1]);
        if (b < 0) s->end[1] = cross_face(f, other, s->end[0], s->end[1]);
    }
    return true;
}

static bool add_segment(segments *all, const segment *s, error *e)
{
    segment *item =
        mem_grow(all->item, all->count, &all->capacity, 256, sizeof *item, "the boundary curves", e);
    if (!item) return false;
    all->item = item;
    all->item[all->count++] = *s;
    return true;
}

/* A corner in the face counts as outside: an edge in it is then found once, from the triangle inside. */
static bool cut_triangle(const field *f, int face, const vec3 t[3], segments *all, error *e)
{
    segment s;
    int ends = 0;
    for (int k = 0; k < 3; k++) {
        const vec3 *p = &t[k], *q = &t[(k + 1) % 3];
        if ((height(f, face, *p) > 0) == (height(f, face, *q) > 0)) continue;
        s.end[ends++] = cross_face(f, face, *p, *q);
    }
    if (ends < 2 || vec3_compare(s.end[0], s.end[1]) == 0 || !cut_segment(f, face, &s)) return true;
    return add_segment(all, &s, e);
}

static bool face_passes(const surface *s, size_t cell, int face)
{
    field_cell c;
    bool inside = false, outside = false;
    surface_cell(s, cell, &c);
    for (int k = 0; k < 8; k++) {
        double h = height(s->field, face, c.corner[k]);
        inside |= h > 0;
        outside |= h <= 0;
    }
    return inside && outside;
}

static bool find_segments(const surface *s, int face, segments *all, error *e)
{
    vec3 t[FIELD_CELL_TRIANGLES][3];
    for (size_t k = 0; k < s->cells; k++) {
        if (!face_passes(s, k, face)) continue;
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

static bool join_segments(segments *all, error *e)
{
    end *ends = mem_array(2 * all->count, sizeof *ends, "the boundary curves", e);
    all->partner = mem_array(2 * all->count, sizeof *all->partner, "the boundary curves", e);
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
    double length; /* see side_length */
    bool closed;
} curve;

/* The requested spacing at x over that of an even request. */
static double size_at(const boundary_request *r, vec3 x)
{
    return r->sizing ? sizing_field_spacing(r->sizing, x, NULL) / r->even : 1;
}

/* The length of a side where the request is even; its spacings, times a constant, in general. */
static double side_length(const boundary_request *r, vec3 a, vec3 b)
{
    return vec3_norm(vec3_sub(b, a)) / size_at(r, vec3_scale(vec3_add(a, b), 0.5));
}

/* The curve that begins with end `first` of its segment. Its segments are marked. */
static void follow(const boundary_request *r, const segments *all, size_t first, bool *seen, curve *out)
{
    size_t at = first;
    out->count = 0;
    out->length = 0;
    out->point[out->count++] = all->item[at / 2].end[at % 2];
    do {
        size_t other = at ^ 1;
        vec3 x = all->item[other / 2].end[other % 2];
        seen[at / 2] = true;
        out->length += side_length(r, out->point[out->count - 1], x);
        out->point[out->count++] = x;
        at = all->partner[other];
    } while (at != NONE && !seen[at / 2]);
    out->closed = at == first;
}

/* ---- places */

typedef struct placing {
    const surface *s;
    const boundary_request *request;
    double spacing; /* of a row, where the request is even */
    boundary *out;
    size_t capacity;
} placing;

/* Puts a place on the surface within the faces that it lies in. */
static bool settle(const placing *w, vec3 *x, vec3 *normal)
{
    const field *f = w->s->field;
    unsigned fixed = 0;
    for (int face = 0; face < 6; face++)
        if (height(f, face, *x) == 0) fixed |= 1u << (face >> 1);
    return surface_slide(f, fixed, w->spacing * size_at(w->request, *x), x, normal) &&
           bbox_contains(f->domain, *x);
}

static void add_place(placing *w, vec3 x)
{
    vec3 normal;
    if (w->out->count == w->capacity || !settle(w, &x, &normal)) return;
    w->out->position[w->out->count] = x;
    w->out->normal[w->out->count++] = normal;
}

/* Two curves end in each point where the surface meets an edge of the domain. */
static void add_corner(placing *w, vec3 x)
{
    for (size_t k = 0; k < w->out->count; k++)
        if (vec3_norm(vec3_sub(w->out->position[k], x)) < SAME_PLACE * w->spacing * size_at(w->request, x))
            return;
    add_place(w, x);
}

static void place_corners(placing *w, const curve *c)
{
    if (c->closed) return;
    add_corner(w, c->point[0]);
    add_corner(w, c->point[c->count - 1]);
}

/* At equal lengths along the curve; its corners have places already. */
static void place_row(placing *w, const curve *c)
{
    double spaces = round(c->length / w->spacing), step = c->length / spaces, before = 0,
           next = c->closed ? 0 : 1;
    for (size_t k = 0; k + 1 < c->count; k++) {
        vec3 side = vec3_sub(c->point[k + 1], c->point[k]);
        double length = side_length(w->request, c->point[k], c->point[k + 1]);
        for (; next < spaces && next * step <= before + length; next++)
            add_place(w, vec3_axpy(fmax(next * step - before, 0) / length, side, c->point[k]));
        before += length;
    }
}

typedef struct curves {
    curve *item;
    size_t count;
} curves;

static bool collect_curves(const boundary_request *r, const segments *all, curves *list, error *e)
{
    bool *seen = mem_array(all->count, sizeof *seen, "the boundary curves", e);
    vec3 *points = mem_array(all->count + 1, sizeof *points, "the boundary curves", e);
    curve *larger = mem_array(list->count + all->count, sizeof *larger, "the boundary curves", e);
    bool ok = seen && points && larger;
    if (ok) {
        if (list->count) memcpy(larger, list->item, list->count * sizeof *larger);
        free(list->item);
        list->item = larger;
        larger = NULL;
    }
    for (int closed = 0; ok && closed < 2; closed++) /* those with ends first, from one of them */
        for (size_t k = 0; ok && k < 2 * all->count; k++) {
            curve c = {.point = points};
            if (seen[k / 2] || (!closed && all->partner[k] != NONE)) continue;
            follow(r, all, k, seen, &c);
            c.point = mem_array(c.count, sizeof *c.point, "the boundary curves", e);
            ok = c.point != NULL;
            if (!ok) break;
            memcpy(c.point, points, c.count * sizeof *c.point);
            list->item[list->count++] = c;
        }
    free(seen);
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

static bool place_all(const curves *list, placing *w, error *e)
{
    double length = 0;
    for (size_t k = 0; k < list->count; k++) length += list->item[k].length;
    double most = (double)w->request->most;
    w->spacing = fmax(ROW_SPACING * w->request->spacing, length / most);
    double places = length / w->spacing + 3 * (double)list->count; /* two corners, and what rounding adds */
    w->capacity = (size_t)fmin(places, most);
    w->out->position = mem_array(w->capacity, sizeof(vec3), "the boundary curves", e);
    w->out->normal = mem_array(w->capacity, sizeof(vec3), "the boundary curves", e);
    if (!w->out->position || !w->out->normal) return false;
    for (size_t k = 0; k < list->count; k++) place_corners(w, &list->item[k]);
    for (size_t k = 0; k < list->count; k++) place_row(w, &list->item[k]);
    return true;
}

double boundary_spacing(const boundary_request *request, vec3 x)
{
    return request->spacing * size_at(request, x);
}

bool boundary_find(const surface *s, const boundary_request *request, boundary *out, error *e)
{
    const field *f = s->field;
    curves list = {0};
    placing w = {.s = s, .request = request, .out = out};
    bool ok = true;
    *out = (boundary){0};
    if (!f->open || request->most == 0) return true;
    for (int face = 0; ok && face < 6; face++)
        if (isfinite(vec3_get(face & 1 ? f->boundary_box.max : f->boundary_box.min, face >> 1)))
            ok = find_curves(s, request, face, &list, e);
    ok = ok && place_all(&list, &w, e);
    free_curves(&list);
    return ok;
}

void boundary_free(boundary *r)
{
    free(r->position);
    free(r->normal);
    *r = (boundary){0};
}

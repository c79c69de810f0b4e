#include "mesh/fidelity.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "geometry/bbox.h"
#include "mesh/line_tree.h"

/* Points per triangle: one for so many square voxels, and not more than so many. */
static const double area_per_point = 4;
static const int most_points = 256;
/* Of a mesh of few triangles, where it may be hidden. */
static const double places_looked_at = 4096;
/* How far from the mesh its two sides are looked at, in voxels. */
static const double side_gap = 0.75;
static const double close_vox = 0.05;
/* A sheet of so many voxels is followed however it lies to them: measured on plates, whose area is then right to
 * 0.2 %. */
static const double voxels_across = 1.25;
/* Sheets that the zero set does not follow are not thicker than this, whatever else lies in the way of a line. */
static const double thinnest_vox = 2;
/* Faces nearer than this, of the mesh's extent, touch. */
static const double touching = 1e-6;
/* The lines are tilted by this against the normals, so that they do not run along faces of a mesh of right
 * angles. */
static const vec3 tilt = {0.00917, 0.00631, 0.00487};

/* A place between two faces that lie close. */
typedef struct gap {
    double width_vox, area;
    vec3 place; /* world units */
} gap;

typedef struct measuring {
    const mesh *m;
    const field *f;
    const double *index_to_world;
    line_tree *tree;
    double touching_vox;
    gap *gaps;
    size_t gap_count, gap_room;
    double area, followed, near, sum, thin, hidden;
} measuring;

static vec3 in_world(const measuring *w, vec3 p)
{
    const double *m = w->index_to_world;
    return (vec3){m[0] * p.x + m[3], m[5] * p.y + m[7], m[10] * p.z + m[11]};
}

/* The field's distance from its zero set, to first order, in voxels; NAN where there is none. */
static double distance_at(const measuring *w, vec3 p)
{
    field_sample s;
    if (!w->f || !field_sample_at(w->f, in_world(w, p), FIELD_GRADIENT, &s)) return NAN;
    return s.value / (vec3_norm(s.gradient) * w->index_to_world[0]);
}

static bool note_gap(measuring *w, gap g, error *e)
{
    gap *gaps =
        mem_grow(w->gaps, w->gap_count, &w->gap_room, 1024, sizeof *gaps, "the thin parts of the mesh", e);
    if (!gaps) return false;
    w->gaps = gaps;
    w->gaps[w->gap_count++] = g;
    return true;
}

/* Why the zero set does not follow the mesh in a point of its triangle n. */
static bool look_into(measuring *w, uint32_t n, vec3 p, vec3 normal, double part, error *e)
{
    if (!w->tree && !(w->tree = line_tree_new(w->m, e))) return false;
    const line_crossings c = line_tree_cross(w->tree, p, vec3_unit(vec3_add(normal, tilt)), n);
    const double width = fmin(c.ahead, c.behind);
    if (c.winding != 0 || width < w->touching_vox) {
        w->hidden += part;
        return true;
    }
    if (width > thinnest_vox) return true;
    w->thin += part;
    return note_gap(w, (gap){width, part, in_world(w, p)}, e);
}

/* The k-th place of a triangle: the additive sequence of the plastic number, folded into it; the first is its middle. */
static vec3 place_of(vec3 a, vec3 ab, vec3 ac, int k)
{
    double u = fmod(1.0 / 3 + k * 0.7548776662466927, 1), v = fmod(1.0 / 3 + k * 0.5698402909980532, 1);
    return u + v > 1 ? vec3_axpy(1 - u, ab, vec3_axpy(1 - v, ac, a)) : vec3_axpy(u, ab, vec3_axpy(v, ac, a));
}

static bool measure_triangle(measuring *w, uint32_t n, error *e)
{
    const mesh *m = w->m;
    const vec3 a = m->vertex[m->triangle[n][0]], ab = vec3_sub(m->vertex[m->triangle[n][1]], a);
    const vec3 ac = vec3_sub(m->vertex[m->triangle[n][2]], a), normal = vec3_cross(ab, ac);
    const double whole = 0.5 * vec3_norm(normal);
    if (!(whole > DBL_EPSILON)) return true;
    const vec3 unit = vec3_scale(normal, 0.5 / whole), step = vec3_scale(unit, side_gap);
    const int points = (int)fmin(1 + whole / area_per_point, most_points);
    for (int k = 0; k < points; k++) {
        const vec3 p = place_of(a, ab, ac, k);
        const double part = whole / points, d = distance_at(w, p);
        w->area += part;
        if (!(distance_at(w, vec3_add(p, step)) > 0 && distance_at(w, vec3_sub(p, step)) < 0)) {
            if (!look_into(w, n, p, unit, part, e)) return false;
            continue;
        }
        w->followed += part;
        w->near += fabs(d) < close_vox ? part : 0;
        w->sum += part * d * d;
    }
    return true;
}

static int by_width(const void *left, const void *right)
{
    const gap *a = left, *b = right;
    if (a->width_vox != b->width_vox) return a->width_vox < b->width_vox ? -1 : 1;
    return (a->area > b->area) - (a->area < b->area);
}

/* The largest voxels, in those that there are, that leave at most `most` of the area thin, of what voxels of `finest` show. */
static double voxels_wanted(const measuring *w, double finest, double most)
{
    double left = 0;
    for (size_t k = 0; k < w->gap_count; k++) {
        double wanted = w->gaps[k].width_vox / voxels_across;
        if (wanted < finest) continue;
        left += w->gaps[k].area;
        if (left > most) return fmin(wanted, 1);
    }
    return 1;
}

static bool keep_places(const measuring *w, fidelity *out, error *e)
{
    if (!w->gap_count) return true;
    out->thin_place = mem_array(w->gap_count, sizeof *out->thin_place, "the thin parts of the mesh", e);
    if (!out->thin_place) return false;
    for (size_t k = 0; k < w->gap_count; k++) out->thin_place[out->thin_places++] = w->gaps[k].place;
    return true;
}

bool fidelity_measure(const mesh *m, const double index_to_world[16], const field *f, double finest,
                      fidelity *out, error *e)
{
    const double size = index_to_world[0];
    measuring w = {.m = m, .f = f, .index_to_world = index_to_world};
    bool ok = true;
    w.touching_vox = m->triangle_count ? touching * bbox_longest(mesh_box(m)) : 0;
    for (uint32_t n = 0; ok && n < m->triangle_count; n++) ok = measure_triangle(&w, n, e);
    if (ok) {
        if (w.gap_count) qsort(w.gaps, w.gap_count, sizeof *w.gaps, by_width);
        const double whole = w.area > 0 ? w.area : 1, most = FIDELITY_MOST_THIN * w.area;
        fidelity_free(out);
        *out = (fidelity){.area = w.area * size * size,
                          .rms_vox = w.followed > 0 ? sqrt(w.sum / w.followed) : 0,
                          .close = w.near / whole,
                          .unresolved = w.area > 0 ? 1 - w.followed / w.area : 0,
                          .thin = w.thin / whole,
                          .hidden = w.hidden / whole,
                          .thin_voxel = size * voxels_wanted(&w, 0, most),
                          .worth_voxel = size * voxels_wanted(&w, finest / size, most),
                          .tenth_voxel = size * voxels_wanted(&w, 0, w.thin / 10)};
        ok = keep_places(&w, out, e);
    }
    line_tree_free(w.tree);
    free(w.gaps);
    return ok;
}

void fidelity_free(fidelity *f)
{
    free(f->thin_place);
    f->thin_place = NULL;
    f->thin_places = 0;
}

/* Whether there is something on both sides of a place of triangle n: whichever way round it is, it bounds no union. */
static bool is_hidden(const line_tree *tree, uint32_t n, vec3 p, vec3 normal)
{
    const vec3 d = vec3_unit(vec3_add(normal, tilt));
    return line_tree_cross(tree, p, d, n).winding != 0 &&
           line_tree_cross(tree, p, vec3_scale(d, -1), n).winding != 0;
}

bool fidelity_hidden(const mesh *m, double *share, error *e)
{
    line_tree *tree = line_tree_new(m, e);
    const double all = mesh_area(m);
    double hidden = 0;
    if (!tree) return false;
    for (uint32_t n = 0; n < m->triangle_count; n++) {
        const vec3 a = m->vertex[m->triangle[n][0]], ab = vec3_sub(m->vertex[m->triangle[n][1]], a);
        const vec3 ac = vec3_sub(m->vertex[m->triangle[n][2]], a), normal = vec3_cross(ab, ac);
        const double whole = 0.5 * vec3_norm(normal);
        if (!(whole > 0)) continue;
        const int points = (int)fmin(1 + places_looked_at * whole / all, most_points);
        for (int k = 0; k < points; k++)
            hidden += is_hidden(tree, n, place_of(a, ab, ac, k), vec3_scale(normal, 0.5 / whole))
                          ? whole / points
                          : 0;
    }
    line_tree_free(tree);
    *share = hidden / all;
    return true;
}

// SPDX-License-Identifier: Apache-2.0
#include "surface/levelset/fidelity.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/space/bbox.h"
#include "surface/triangles/triangle_tree.h"

/* Samples of a triangle: one per area_per_point square voxels, at most most_points. */
static const double area_per_point = 4;
static const int most_points = 256;
/* Triangles smaller than least_area, in square voxels, share samples: one per that area. golden: offset of
 * the first one in each chunk. */
static const double least_area = 0.25, golden = 0.6180339887498949;
/* side_gap: distance from the mesh at which the sign of F on its two sides is tested, voxels. close_vox:
 * limit of `close`, voxels. */
static const double side_gap = 0.75;
static const double close_vox = 0.05;
/* A plate of this thickness, in voxels, is represented in any orientation: measured on plates, whose area
 * is then accurate to 0.2 %. */
static const double voxels_across = 1.25;
/* Maximum thickness in voxels of a wall that the zero set does not follow. Crossings farther along the
 * line belong to other walls. */
static const double thinnest_vox = 2;
/* Faces nearer than this, over the extent of the mesh, touch. */
static const double touching = 1e-6;
/* The lines are tilted against the normals by this vector, so that they do not run within faces of a mesh
 * with right angles. */
static const vec3 tilt = {0.00917, 0.00631, 0.00487};

/* A sample between two close faces. */
typedef struct gap {
    double width_vox, area;
    vec3 place; /* world units */
} gap;

/* A sample that the zero set does not follow. */
typedef struct deviation {
    uint32_t triangle;
    int32_t place;
    double area;  /* represented by the sample */
    double width; /* distance of the two faces, voxels; INFINITY: there is no second face; HIDDEN */
} deviation;

enum { CHUNK = 4096, HIDDEN = -1 }; /* CHUNK: triangles of a task */

/* Sums of a chunk of triangles. */
typedef struct tally {
    double area, sampled, followed, near, sum; /* sampled: area represented by samples */
    deviation *deviations;
    size_t deviation_count, deviation_capacity;
    error fault; /* code ERROR_NONE: none */
} tally;

typedef struct fidelity_job {
    const mesh *m;
    const field *f;
    const double *index_to_world;
    triangle_tree *tree;
    double touching_vox;
    tally *tallies;
    deviation *deviations;
    size_t deviation_count;
    gap *gaps;
    size_t gap_count;
    double area, sampled, followed, near, sum, thin, hidden;
} fidelity_job;

static vec3 in_world(const fidelity_job *w, vec3 p)
{
    const double *m = w->index_to_world;
    return (vec3){m[0] * p.x + m[3], m[5] * p.y + m[7], m[10] * p.z + m[11]};
}

/* The distance from the zero set to first order, voxels; NAN if the field is undefined. */
static double distance_at(const fidelity_job *w, vec3 p)
{
    field_sample s;
    if (!w->f || !field_sample_at(w->f, in_world(w, p), FIELD_GRADIENT, &s)) return NAN;
    return s.value / (vec3_norm(s.gradient) * w->index_to_world[0]);
}

/* Sample k of a triangle: the additive recurrence of the plastic number, folded into the triangle; the
 * first is the centroid. */
static vec3 place_of(vec3 a, vec3 ab, vec3 ac, int k)
{
    double u = fmod(1.0 / 3 + k * 0.7548776662466927, 1), v = fmod(1.0 / 3 + k * 0.5698402909980532, 1);
    return u + v > 1 ? vec3_axpy(1 - u, ab, vec3_axpy(1 - v, ac, a)) : vec3_axpy(u, ab, vec3_axpy(v, ac, a));
}

/* A triangle and its samples. */
typedef struct places {
    vec3 a, ab, ac, normal; /* unit */
    double area;            /* 0: degenerate, no samples */
    int count;
} places;

static places places_on(const mesh *m, uint32_t n)
{
    const vec3 a = m->vertex[m->triangle[n][0]], ab = vec3_sub(m->vertex[m->triangle[n][1]], a),
               ac = vec3_sub(m->vertex[m->triangle[n][2]], a), normal = vec3_cross(ab, ac);
    const double whole = 0.5 * vec3_norm(normal);
    if (!(whole > DBL_EPSILON)) return (places){.count = 0};
    return (places){a,     ab,
                    ac,    vec3_scale(normal, 0.5 / whole),
                    whole, (int)fmin(1 + whole / area_per_point, most_points)};
}

static bool note_deviation(tally *t, uint32_t n, int place, double area)
{
    if (!MEM_GROW(t->deviations, t->deviation_count, &t->deviation_capacity, "the thin parts of the mesh",
                  &t->fault))
        return false;
    t->deviations[t->deviation_count++] = (deviation){.triangle = n, .place = place, .area = area};
    return true;
}

/* Measures the samples of a triangle, which represent `area` together. */
static bool measure_triangle(const fidelity_job *w, uint32_t n, const places *on, double area, tally *t)
{
    const vec3 step = vec3_scale(on->normal, side_gap);
    for (int k = 0; k < on->count; k++) {
        const vec3 p = place_of(on->a, on->ab, on->ac, k);
        const double part = area / on->count, d = distance_at(w, p);
        t->sampled += part;
        if (!(distance_at(w, vec3_add(p, step)) > 0 && distance_at(w, vec3_sub(p, step)) < 0)) {
            if (!note_deviation(t, n, k, part)) return false;
            continue;
        }
        t->followed += part;
        t->near += fabs(d) < close_vox ? part : 0;
        t->sum += part * d * d;
    }
    return true;
}

static void measure_chunk(void *context, int worker, size_t begin, size_t end)
{
    const fidelity_job *w = context;
    tally *t = &w->tallies[begin / CHUNK];
    double due = fmod(golden * (double)(begin / CHUNK), 1) *
                 least_area; /* area of small triangles since the last sample of them */
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        const places on = places_on(w->m, (uint32_t)n);
        t->area += on.area;
        if (on.count == 0) continue;
        const bool small = on.area < least_area;
        if (small && (due -= on.area) > 0) continue;
        if (small) due += least_area;
        if (!measure_triangle(w, (uint32_t)n, &on, small ? least_area : on.area, t)) return;
    }
}

static bool gather_tallies(fidelity_job *w, size_t count, error *e)
{
    size_t deviations = 0;
    for (size_t k = 0; k < count; k++) {
        const tally *t = &w->tallies[k];
        if (t->fault.code != ERROR_NONE) {
            *e = t->fault;
            return false;
        }
        w->area += t->area;
        w->sampled += t->sampled;
        w->followed += t->followed;
        w->near += t->near;
        w->sum += t->sum;
        deviations += t->deviation_count;
    }
    w->deviations = mem_array(deviations, sizeof *w->deviations, "the thin parts of the mesh", e);
    if (!w->deviations) return false;
    for (size_t k = 0; k < count; k++)
        for (size_t i = 0; i < w->tallies[k].deviation_count; i++)
            w->deviations[w->deviation_count++] = w->tallies[k].deviations[i];
    return true;
}

/* Determines why the zero set does not follow a sample. */
static void classify(const fidelity_job *w, deviation *d)
{
    const places on = places_on(w->m, d->triangle);
    const vec3 p = place_of(on.a, on.ab, on.ac, d->place);
    const line_crossings c =
        triangle_tree_cross(w->tree, p, vec3_unit(vec3_add(on.normal, tilt)), d->triangle);
    const double width = fmin(c.ahead, c.behind);
    d->width = c.winding != 0 || width < w->touching_vox ? HIDDEN : width > thinnest_vox ? INFINITY : width;
}

static void classify_chunk(void *context, int worker, size_t begin, size_t end)
{
    const fidelity_job *w = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) classify(w, &w->deviations[k]);
}

static bool list_gaps(fidelity_job *w, error *e)
{
    w->gaps = mem_array(w->deviation_count, sizeof *w->gaps, "the thin parts of the mesh", e);
    if (!w->gaps) return false;
    for (size_t k = 0; k < w->deviation_count; k++) {
        const deviation *d = &w->deviations[k];
        if (d->width == INFINITY) continue;
        if (d->width == HIDDEN) {
            w->hidden += d->area;
            continue;
        }
        const places on = places_on(w->m, d->triangle);
        w->thin += d->area;
        w->gaps[w->gap_count++] =
            (gap){d->width, d->area, in_world(w, place_of(on.a, on.ab, on.ac, d->place))};
    }
    return true;
}

static bool sample_mesh(fidelity_job *w, threads *pool, error *e)
{
    const size_t count = w->m->triangle_count, chunks = (count + CHUNK - 1) / CHUNK;
    w->tallies = mem_array(chunks, sizeof *w->tallies, "the thin parts of the mesh", e);
    if (!w->tallies) return false;
    threads_run(pool, count, CHUNK, measure_chunk, w);
    bool ok = gather_tallies(w, chunks, e);
    for (size_t k = 0; k < chunks; k++) free(w->tallies[k].deviations);
    if (!ok || w->deviation_count == 0) return ok;
    if (!(w->tree = triangle_tree_new(w->m, pool, e))) return false;
    threads_run(pool, w->deviation_count, CHUNK / 16, classify_chunk, w);
    return list_gaps(w, e);
}

static int by_width(const void *left, const void *right)
{
    const gap *a = left, *b = right;
    if (a->width_vox != b->width_vox) return a->width_vox < b->width_vox ? -1 : 1;
    return (a->area > b->area) - (a->area < b->area);
}

/* The largest voxel size, in present voxels, for which at most `most` of the area is thin. Only the part
 * that voxels of size `finest` represent counts. */
static double voxels_wanted(const fidelity_job *w, double finest, double most)
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

static bool keep_places(const fidelity_job *w, fidelity *out, error *e)
{
    if (!w->gap_count) return true;
    out->thin_place = mem_array(w->gap_count, sizeof *out->thin_place, "the thin parts of the mesh", e);
    if (!out->thin_place) return false;
    for (size_t k = 0; k < w->gap_count; k++) out->thin_place[out->thin_places++] = w->gaps[k].place;
    return true;
}

bool fidelity_measure(const mesh *m, const double index_to_world[16], const field *f, double finest,
                      threads *pool, fidelity *out, error *e)
{
    const double size = index_to_world[0];
    fidelity_job w = {.m = m, .f = f, .index_to_world = index_to_world};
    w.touching_vox = m->triangle_count ? touching * bbox_longest(mesh_box(m, pool)) : 0;
    bool ok = sample_mesh(&w, pool, e);
    if (ok) {
        if (w.gap_count) qsort(w.gaps, w.gap_count, sizeof *w.gaps, by_width);
        const double whole = w.sampled > 0 ? w.sampled : 1, most = FIDELITY_MAX_THIN * w.sampled;
        fidelity_free(out);
        *out = (fidelity){.area = w.area * size * size,
                          .rms_vox = w.followed > 0 ? sqrt(w.sum / w.followed) : 0,
                          .close = w.near / whole,
                          .unresolved = w.sampled > 0 ? 1 - w.followed / w.sampled : 0,
                          .thin = w.thin / whole,
                          .hidden = w.hidden / whole,
                          .thin_voxel = size * voxels_wanted(&w, 0, most),
                          .worth_voxel = size * voxels_wanted(&w, finest / size, most),
                          .tenth_voxel = size * voxels_wanted(&w, 0, w.thin / 10)};
        ok = keep_places(&w, out, e);
    }
    triangle_tree_free(w.tree);
    free(w.tallies);
    free(w.deviations);
    free(w.gaps);
    return ok;
}

void fidelity_free(fidelity *f)
{
    free(f->thin_place);
    f->thin_place = NULL;
    f->thin_places = 0;
}

/* Whether a property holds of a sample of triangle n, at p. */
typedef bool sample_test(const triangle_tree *tree, uint32_t n, vec3 p, vec3 normal, double width);

/* The share of `sampled` samples, evenly over the area, for which the property holds. */
static bool measure_share(const mesh *m, int sampled, sample_test *holds, double width, double *share,
                          error *e)
{
    triangle_tree *tree = triangle_tree_new(m, NULL, e);
    const double step = mesh_area(m) / sampled;
    double passed = 0, next = 0.5 * step;
    int found = 0;
    if (!tree) return false;
    for (uint32_t n = 0; n < m->triangle_count; n++) {
        const vec3 a = m->vertex[m->triangle[n][0]], ab = vec3_sub(m->vertex[m->triangle[n][1]], a);
        const vec3 ac = vec3_sub(m->vertex[m->triangle[n][2]], a), normal = vec3_cross(ab, ac);
        passed += 0.5 * vec3_norm(normal);
        for (int k = 0; next < passed; k++, next += step)
            found += holds(tree, n, place_of(a, ab, ac, k), vec3_unit(normal), width);
    }
    triangle_tree_free(tree);
    *share = (double)found / sampled;
    return true;
}

/* Whether solids are on both sides, whatever their orientation: the sample does not bound the union. */
static bool is_hidden(const triangle_tree *tree, uint32_t n, vec3 p, vec3 normal, double width)
{
    const vec3 d = vec3_unit(vec3_add(normal, tilt));
    (void)width;
    return triangle_tree_cross(tree, p, d, n).winding != 0 &&
           triangle_tree_cross(tree, p, vec3_scale(d, -1), n).winding != 0;
}

bool fidelity_hidden(const mesh *m, double *share, error *e)
{
    return measure_share(m, 2048, is_hidden, 0, share, e);
}

/* Whether the outside is on one side of a sample and, on the other side, at a distance of less than
 * `width`. */
static bool is_thin(const triangle_tree *tree, uint32_t n, vec3 p, vec3 normal, double width)
{
    const vec3 d = vec3_unit(vec3_add(normal, tilt));
    const line_crossings ahead = triangle_tree_cross(tree, p, d, n),
                         behind = triangle_tree_cross(tree, p, vec3_scale(d, -1), n);
    return (ahead.winding == 0 || behind.winding == 0) && fmin(ahead.ahead, behind.ahead) < width;
}

bool fidelity_thin(const mesh *m, double voxel, double *share, error *e)
{
    return measure_share(m, 1024, is_thin, voxels_across * voxel, share, e);
}

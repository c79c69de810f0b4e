#include "solver/particles/coverage.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "field/patches.h"
#include "field/projection.h"
#include "geometry/near_points.h"

/* Cells are looked at in so many parts at most, each of which has a largest distance of its own: with fewer cells in a part
 * most of them are looked at before there is one that spares the look. */
enum { PARTS = 256, FEWEST_CELLS = 1024 };
/* With so many cells all threads look at them: that takes a millisecond. */
enum { FEWEST_WIDE = 20000 };
/* One of so many is looked at before all of them are. */
enum { FIRST_OF = 16 };
/* Newton's steps onto the surface, and how near, of a cell, is on it. */
enum { PROJECTION_STEPS = 8 };
static const double ACCURACY = 1e-3;

/* Points that were near the places looked at last. */
enum { SEEN = 4 };

/* Spacings that differ by more than this are told by place. */
static const double GRADED = 1.25;
/* Bins along an axis: no more than these, nor than so many to a point. */
enum { BINS_MOST = 64 };
static const double BINS_PER_POINT = 2;
/* Bins are a hair wider than they count for, so that no rounding puts a point one too far. */
static const double HAIR = 1e-6;

/* The least spacing of the points about a place. */
typedef struct spacings {
    double all;   /* of all points */
    double reach; /* so far about a place */
    double over;  /* bins to a length */
    vec3 origin;
    int bins[3];
    double *near; /* of each bin, with those next to it; NULL: `all` everywhere */
} spacings;

typedef struct coverage_job {
    const surface *scan;
    near_points *points;
    const vec3 *position;
    const double *spacing;
    spacings least;
    size_t first; /* of the cells that are looked at */
    size_t step;  /* from one to the next */
    size_t grain;
    double known; /* no smaller distance is looked for */
    double farthest[PARTS];
} coverage_job;

static int clamped_bin(const spacings *s, vec3 x, int axis)
{
    const double at = (vec3_get(x, axis) - vec3_get(s->origin, axis)) * s->over;
    return at < 0 ? -1 : at >= s->bins[axis] ? s->bins[axis] : (int)at;
}

/* Each bin becomes the least of it and those next to it along an axis, which are `stride` away. */
static void spread(spacings *s, int axis, size_t stride)
{
    const size_t total = (size_t)s->bins[0] * (size_t)s->bins[1] * (size_t)s->bins[2];
    const size_t along = stride * (size_t)s->bins[axis];
    for (size_t line = 0; line < total; line++) {
        if (line % along >= stride) continue; /* not the first of its line */
        double before = INFINITY;
        for (size_t at = line; at < line + along; at += stride) {
            const double own = s->near[at],
                         next = at + stride < line + along ? s->near[at + stride] : INFINITY;
            s->near[at] = fmin(own, fmin(before, next));
            before = own;
        }
    }
}

static bool find_spacings(const vec3 *position, const double *spacing, size_t count, spacings *out, error *e)
{
    double least = INFINITY, largest = 0;
    for (size_t i = 0; i < count; i++) { /* without fmin, which is a call */
        least = spacing[i] < least ? spacing[i] : least;
        largest = spacing[i] > largest ? spacing[i] : largest;
    }
    *out = (spacings){.all = least};
    if (!(largest > GRADED * least)) return true;
    bbox box = bbox_of_points(position, count, NULL);
    const double most = fmin(fmax(1, cbrt(BINS_PER_POINT * (double)count)), BINS_MOST);
    out->reach = fmax(largest, bbox_longest(box) / most);
    out->over = 1 / ((1 + HAIR) * out->reach);
    box = bbox_grow(box, out->reach);
    out->origin = box.min;
    for (int a = 0; a < 3; a++) out->bins[a] = (int)(vec3_get(bbox_size(box), a) * out->over) + 1;
    const size_t total = (size_t)out->bins[0] * (size_t)out->bins[1] * (size_t)out->bins[2];
    out->near = mem_array(total, sizeof *out->near, "the search for near points", e);
    for (size_t k = 0; out->near && k < total; k++) out->near[k] = INFINITY;
    for (size_t i = 0; out->near && i < count; i++) {
        const int x = clamped_bin(out, position[i], 0), y = clamped_bin(out, position[i], 1),
                  z = clamped_bin(out, position[i], 2);
        double *bin =
            &out->near[((size_t)z * (size_t)out->bins[1] + (size_t)y) * (size_t)out->bins[0] + (size_t)x];
        *bin = fmin(*bin, spacing[i]);
    }
    size_t stride = 1;
    for (int a = 0; out->near && a < 3; stride *= (size_t)out->bins[a++]) spread(out, a, stride);
    return out->near != NULL;
}

/* A distance: with a point no farther than it from x no place within `radius` of x is farther than `farthest` from its nearest
 * point, in that one's spacings. Not above 0 where there is none. */
static double enough_at(const spacings *s, vec3 x, double radius, double farthest)
{
    const double anywhere = farthest * s->all - radius;
    if (!s->near) return anywhere;
    int at[3];
    for (int a = 0; a < 3; a++) {
        at[a] = clamped_bin(s, x, a);
        if (at[a] < 0 || at[a] == s->bins[a]) return anywhere;
    }
    const double least =
        s->near[((size_t)at[2] * (size_t)s->bins[1] + (size_t)at[1]) * (size_t)s->bins[0] + (size_t)at[0]];
    /* the nearest point of such a place is no farther from x than that point and the radius twice */
    return fmax(anywhere, fmin(farthest * least - radius, s->reach - 2 * radius));
}

/* Triangles of cells larger than the spacing lie off the surface by more than that. A place from which no step leads to it
 * is put on it in its cell, as far as F is known there. False where that is beyond an open end. */
static bool onto_surface(const surface *scan, size_t k, double cell_size, vec3 *x)
{
    const field *f = scan->field;
    const projection_limits limits = {PROJECTION_STEPS, ACCURACY * cell_size, ACCURACY * cell_size,
                                      ACCURACY * cell_size};
    vec3 p = *x, normal;
    if (projection_find(f, &limits, &p, &normal) && vec3_norm(vec3_sub(p, *x)) < cell_size)
        *x = p;
    else if (!f->patches)
        *x = surface_bisect(scan, k, *x);
    return !f->open || bbox_contains(f->domain, *x);
}

/* Whether there is a point within a distance > 0: one of those near the places before, the last one first, or another, which becomes the
 * last. Cells that follow each other are near the same points. */
static bool has_point(const coverage_job *job, vec3 x, double within, uint32_t near[SEEN])
{
    if (!(within > 0)) return false;
    for (int k = 0; k < SEEN; k++)
        if (vec3_norm2(vec3_sub(job->position[near[k]], x)) <= within * within) return true;
    double distance;
    const uint32_t found = near_points_nearest(job->points, x, within, &distance);
    memmove(near + 1, near, (SEEN - 1) * sizeof *near);
    near[0] = found;
    return distance <= within;
}

/* Of a cell: its triangles, and whether all of their places are near enough to a point, by its middle alone. A cell that is one
 * triangle has one place, and the middle says no more of it. */
typedef struct cell_look {
    size_t cell;
    vec3 triangle[FIELD_CELL_TRIANGLES][3];
    int count;
    double size; /* of the cell; of one that is not done */
    bool is_done;
} cell_look;

static void look_at_cell(const coverage_job *job, size_t k, double farthest, uint32_t near[SEEN],
                         cell_look *out)
{
    const field *f = job->scan->field;
    out->cell = k;
    out->count = f->ops->cell_triangles ? surface_cell_rough_triangles(job->scan, k, out->triangle) : -1;
    out->is_done = out->count == 0;
    out->size = f->cell_size;
    if (out->count == 1 && !f->uneven) return;
    double radius;
    const vec3 middle = surface_cell_middle(job->scan, k, &radius);
    /* with a point that near its middle no place of the cell is farther than the farthest */
    out->is_done = has_point(job, middle, enough_at(&job->least, middle, radius, farthest), near);
    if (out->is_done) return;
    if (f->uneven) {
        field_cell cell;
        surface_cell(job->scan, k, &cell);
        out->size = field_cell_size(f, &cell);
    }
    if (out->count < 0) out->count = surface_cell_rough_triangles(job->scan, k, out->triangle);
}

/* The farthest place of a cell, if that is beyond `farthest`. */
static double look_at_places(const coverage_job *job, const cell_look *look, double farthest,
                             uint32_t near[SEEN])
{
    const field *f = job->scan->field;
    for (int i = 0; i < look->count; i++) {
        vec3 x = field_triangle_middle(look->triangle[i]);
        if (f->open && !bbox_contains(f->domain, x)) continue;
        double distance;
        if (has_point(job, x, enough_at(&job->least, x, 0, farthest), near) ||
            !onto_surface(job->scan, look->cell, look->size, &x))
            continue;
        uint32_t point =
            near_points_nearest(job->points, x, enough_at(&job->least, x, 0, farthest), &distance);
        farthest = fmax(farthest, distance / job->spacing[point]);
    }
    return farthest;
}

/* A group of cells, up to `end`, and whether all of their places are near enough to a point, by its middle alone. */
typedef struct group_look {
    size_t end;
    bool is_done;
} group_look;

/* Whether cell k need not be looked at, since its group is done. */
static bool is_done_by_group(const coverage_job *job, size_t k, double farthest, uint32_t near[SEEN],
                             group_look *group)
{
    vec3 middle;
    double radius;
    if (k >= group->end)
        group->is_done = surface_cell_group(job->scan, k, &group->end, &middle, &radius) &&
                         has_point(job, middle, enough_at(&job->least, middle, radius, farthest), near);
    return group->is_done;
}

static void cells_chunk(void *context, int worker, size_t begin, size_t end)
{
    coverage_job *job = context;
    double farthest = job->known;
    uint32_t near[SEEN] = {0};
    group_look group = {0};
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        const size_t k = job->first + n * job->step;
        if (is_done_by_group(job, k, farthest, near, &group)) continue;
        if (!(surface_cell_area(job->scan, k) > 0)) continue;
        cell_look look;
        look_at_cell(job, k, farthest, near, &look);
        if (!look.is_done) farthest = look_at_places(job, &look, farthest, near);
    }
    job->farthest[begin / job->grain] = farthest;
}

size_t coverage_parts(const surface *scan)
{
    return scan->field->patches ? scan->field->patches->count : 1;
}

/* The cells of a part begin here, and end where those of the next begin. */
static size_t first_of_part(const surface *scan, size_t part)
{
    return scan->field->patches ? scan->parts.begin[part] : part * scan->cells;
}

/* The largest distance in every so many of the cells from `begin` on, or `known`. */
static double measure_cells(coverage_job *job, size_t begin, size_t end, size_t step, double known,
                            threads *pool)
{
    const size_t cells = (end - begin + step - 1) / step;
    job->first = begin;
    job->step = step;
    job->known = known;
    job->grain = cells / PARTS + 1;
    if (job->grain < FEWEST_CELLS) job->grain = FEWEST_CELLS;
    memset(job->farthest, 0, sizeof job->farthest);
    threads_run(pool, cells, job->grain, cells_chunk, job);
    for (int k = 0; k < PARTS; k++) known = fmax(known, job->farthest[k]);
    return known;
}

/* Some cells first: what is known of these spares most looks at the others. */
static double measure_part(coverage_job *job, size_t begin, size_t end, double known, threads *pool)
{
    if (end - begin > FIRST_OF * FEWEST_CELLS) known = measure_cells(job, begin, end, FIRST_OF, known, pool);
    return measure_cells(job, begin, end, 1, known, pool);
}

bool coverage_measure(const surface *scan, const vec3 *position, const double *spacing, size_t count,
                      threads *pool, double *farthest, error *e)
{
    coverage_job job = {.scan = scan, .position = position, .spacing = spacing};
    if (!find_spacings(position, spacing, count, &job.least, e)) return false;
    if (!(job.points = near_points_new(position, count, pool, e))) {
        free(job.least.near);
        return false;
    }
    const bool narrow = threads_narrow(pool, scan->cells < FEWEST_WIDE); /* few points may have many cells */
    for (size_t k = 0; k < coverage_parts(scan); k++)
        farthest[k] =
            measure_part(&job, first_of_part(scan, k), first_of_part(scan, k + 1), farthest[k], pool);
    threads_narrow(pool, narrow);
    near_points_free(job.points);
    free(job.least.near);
    return !threads_stopped(pool) || error_set(e, ERROR_CANCELLED, "stopped");
}

static bool add_place(coverage_places *p, vec3 x, uint32_t patch, error *e)
{
    const char *what = "the bare places";
    if (p->count == p->room) {
        const size_t room = p->room > 0 ? 2 * p->room : 1024;
        vec3 *place = mem_array(room, sizeof *place, what, e);
        uint32_t *of = mem_array(room, sizeof *of, what, e);
        if (!place || !of) {
            free(place);
            free(of);
            return false;
        }
        if (p->count > 0) {
            memcpy(place, p->place, p->count * sizeof *place);
            memcpy(of, p->patch, p->count * sizeof *of);
        }
        free(p->place);
        free(p->patch);
        *p = (coverage_places){place, of, p->count, room};
    }
    p->place[p->count] = x;
    p->patch[p->count++] = patch;
    return true;
}

/* The bare places of a cell. */
static bool add_places(const coverage_job *job, const cell_look *look, uint32_t patch, double bare,
                       uint32_t near[SEEN], coverage_places *out, error *e)
{
    const field *f = job->scan->field;
    for (int i = 0; i < look->count; i++) {
        vec3 x = field_triangle_middle(look->triangle[i]);
        double distance;
        if (f->open && !bbox_contains(f->domain, x)) continue;
        if (has_point(job, x, enough_at(&job->least, x, 0, bare), near)) continue;
        if (!f->patches && !onto_surface(job->scan, look->cell, look->size, &x)) continue;
        const uint32_t point = near_points_nearest(job->points, x, 0, &distance);
        if (distance > bare * job->spacing[point] && !add_place(out, x, patch, e)) return false;
    }
    return true;
}

bool coverage_find_bare(const surface *scan, const vec3 *position, const double *spacing, size_t count,
                        double bare, coverage_places *out, error *e)
{
    coverage_job job = {.scan = scan, .position = position, .spacing = spacing};
    uint32_t near[SEEN] = {0};
    *out = (coverage_places){0};
    if (!find_spacings(position, spacing, count, &job.least, e)) return false;
    bool ok = (job.points = near_points_new(position, count, NULL, e)) != NULL;
    for (uint32_t patch = 0; ok && patch < coverage_parts(scan); patch++)
        for (size_t k = first_of_part(scan, patch); ok && k < first_of_part(scan, patch + 1); k++) {
            if (!(surface_cell_area(scan, k) > 0)) continue;
            cell_look look;
            look_at_cell(&job, k, bare, near, &look);
            if (!look.is_done) ok = add_places(&job, &look, patch, bare, near, out, e);
        }
    near_points_free(job.points);
    free(job.least.near);
    return ok;
}

void coverage_places_free(coverage_places *p)
{
    free(p->place);
    free(p->patch);
    *p = (coverage_places){0};
}

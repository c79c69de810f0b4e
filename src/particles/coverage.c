#include "particles/coverage.h"

#include <math.h>
#include <string.h>

#include "field/patches.h"
#include "packing/point_tree.h"
#include "surface/projection.h"

/* Cells are looked at in so many parts at most, each of which has a largest distance of its own: with fewer cells in a part
 * most of them are looked at before there is one that spares the look. */
enum { PARTS = 256, FEWEST_CELLS = 1024 };
/* Newton's steps onto the surface, and how near, of a cell, is on it. */
enum { PROJECTION_STEPS = 8 };
static const double ACCURACY = 1e-3;

typedef struct coverage_job {
    const surface *scan;
    const point_tree *points;
    const vec3 *position;
    const double *spacing;
    double least; /* of all spacings */
    size_t first; /* of the cells that are looked at */
    size_t grain;
    double farthest[PARTS];
} coverage_job;

/* The middle of a cell, and how far its corners are from it. */
static vec3 middle_of(const field_cell *cell, double *radius)
{
    vec3 sum = {0, 0, 0};
    for (int k = 0; k < 8; k++) sum = vec3_add(sum, cell->corner[k]);
    vec3 middle = vec3_scale(sum, 0.125);
    *radius = 0;
    for (int k = 0; k < 8; k++) *radius = fmax(*radius, vec3_norm(vec3_sub(cell->corner[k], middle)));
    return middle;
}

/* Triangles of cells larger than the spacing lie off the surface by more than that. A place from which no step leads to it
 * stays where it is, unless that is nowhere. */
static bool onto_surface(const field *f, double cell_size, vec3 *x)
{
    const projection_limits limits = {PROJECTION_STEPS, ACCURACY * cell_size, ACCURACY * cell_size,
                                      ACCURACY * cell_size};
    vec3 p = *x, normal;
    if (!projection_find(f, &limits, &p, &normal)) return true;
    if (f->open && !bbox_contains(f->domain, p)) return false;
    if (vec3_norm(vec3_sub(p, *x)) < cell_size) *x = p;
    return true;
}

/* Whether there is a point within a distance: near[0] mostly, else near[1], else one that becomes them in turn. Cells
 * that follow each other are near the same points. */
static bool has_point(const coverage_job *job, vec3 x, double within, uint32_t near[2])
{
    for (int k = 0; k < 2 && within > 0; k++)
        if (vec3_norm2(vec3_sub(job->position[near[k]], x)) <= within * within) return true;
    double distance;
    uint32_t found = point_tree_nearest(job->points, x, within, &distance);
    near[1] = near[0];
    near[0] = found;
    return distance <= within;
}

/* The farthest place of a cell, if that is beyond `farthest`. */
static double look_at_places(const coverage_job *job, size_t k, double cell_size, double farthest,
                             uint32_t near[2])
{
    const field *f = job->scan->field;
    vec3 triangle[FIELD_CELL_TRIANGLES][3];
    int count = surface_cell_rough_triangles(job->scan, k, triangle);
    for (int i = 0; i < count; i++) {
        vec3 x = field_triangle_middle(triangle[i]);
        if (f->open && !bbox_contains(f->domain, x)) continue;
        double distance;
        if (has_point(job, x, farthest * job->least, near) || !onto_surface(f, cell_size, &x)) continue;
        uint32_t point = point_tree_nearest(job->points, x, farthest * job->least, &distance);
        farthest = fmax(farthest, distance / job->spacing[point]);
    }
    return farthest;
}

static void cells_chunk(void *context, int worker, size_t begin, size_t end)
{
    coverage_job *job = context;
    double farthest = 0;
    uint32_t near[2] = {0, 0};
    (void)worker;
    for (size_t k = job->first + begin; k < job->first + end; k++) {
        field_cell cell;
        double radius;
        if (!(surface_cell_area(job->scan, k) > 0)) continue;
        surface_cell(job->scan, k, &cell);
        vec3 middle = middle_of(&cell, &radius);
        /* with a point that near its middle no place of the cell is farther than the farthest */
        if (!has_point(job, middle, farthest * job->least - radius, near))
            farthest = look_at_places(job, k, field_cell_size(job->scan->field, &cell), farthest, near);
    }
    job->farthest[begin / job->grain] = farthest;
}

size_t coverage_parts(const surface *scan)
{
    return scan->field->patches ? scan->field->patches->count : 1;
}

static double measure_cells(coverage_job *job, size_t begin, size_t end, threads *pool)
{
    double most = 0;
    job->first = begin;
    job->grain = (end - begin) / PARTS + 1;
    if (job->grain < FEWEST_CELLS) job->grain = FEWEST_CELLS;
    memset(job->farthest, 0, sizeof job->farthest);
    threads_run(pool, end - begin, job->grain, cells_chunk, job);
    for (int k = 0; k < PARTS; k++) most = fmax(most, job->farthest[k]);
    return most;
}

static double least_of(const double *spacing, size_t count)
{
    double least = INFINITY;
    for (size_t i = 0; i < count; i++) least = fmin(least, spacing[i]);
    return least;
}

bool coverage_measure(const surface *scan, const vec3 *position, const double *spacing, size_t count,
                      threads *pool, double *farthest, error *e)
{
    point_tree *points = point_tree_new(position, count, e);
    if (!points) return false;
    coverage_job job = {.scan = scan,
                        .points = points,
                        .position = position,
                        .spacing = spacing,
                        .least = least_of(spacing, count)};
    const size_t parts = coverage_parts(scan), *begin = scan->parts.begin;
    for (size_t k = 0; k < parts; k++)
        farthest[k] = measure_cells(&job, scan->field->patches ? begin[k] : 0,
                                    scan->field->patches ? begin[k + 1] : scan->cells, pool);
    point_tree_free(points);
    return !threads_stopped(pool) || error_set(e, ERROR_CANCELLED, "stopped");
}

bool coverage_of_places(const vec3 *place, size_t places, const vec3 *position, const double *spacing,
                        size_t count, double *farthest, error *e)
{
    if (places == 0) return true;
    point_tree *points = point_tree_new(position, count, e);
    if (!points) return false;
    const double least = least_of(spacing, count);
    for (size_t k = 0; k < places; k++) {
        double distance;
        uint32_t point = point_tree_nearest(points, place[k], *farthest * least, &distance);
        *farthest = fmax(*farthest, distance / spacing[point]);
    }
    point_tree_free(points);
    return true;
}

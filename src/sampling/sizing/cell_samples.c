// SPDX-License-Identifier: Apache-2.0
#include "sampling/sizing/cell_samples.h"

#include <stdlib.h>

#include "base/core/memory.h"
#include "surface/field/patches.h"
#include "surface/field/projection.h"

/* Maximum distance of a sample from the centre of its cell, in cell sizes. */
static const double FARTHEST = 1.5;

typedef struct sample_job {
    const surface *scan;
    cell_samples *out;
} sample_job;

/* For a cell of triangles: the centroid of the first one, which is on the surface. */
static void sample_triangle(const surface *scan, size_t k, cell_samples *out)
{
    vec3 t[FIELD_CELL_TRIANGLES][3];
    field_sample s;
    out->found[k] = surface_cell_triangles(scan, k, t) > 0;
    if (!out->found[k]) return;
    vec3 x = out->position[k] = field_triangle_middle(t[0]);
    out->patch[k] = surface_cell_patch(scan, k, x);
    const field *f = field_of_patch(scan->field, out->patch[k]);
    out->found[k] = field_sample_at(f, x, FIELD_GRADIENT, &s) && vec3_norm2(s.gradient) > 0;
    if (out->found[k]) out->normal[k] = vec3_unit(s.gradient);
}

static void sample_cell(const surface *scan, size_t k, cell_samples *out)
{
    const field *f = scan->field;
    field_cell cell;
    if (f->ops->cell_triangles) {
        sample_triangle(scan, k, out);
        return;
    }
    surface_cell(scan, k, &cell);
    const double size = field_cell_size(f, &cell);
    const projection_limits limits = projection_draft(size);
    vec3 middle = field_cell_middle(&cell), x = middle;
    out->found[k] =
        projection_find(f, &limits, &x, &out->normal[k]) && vec3_norm(vec3_sub(x, middle)) <= FARTHEST * size;
    out->position[k] = out->found[k] ? x : middle;
    out->patch[k] = surface_cell_patch(scan, k, out->position[k]);
}

static void sample_chunk(void *context, int worker, size_t begin, size_t end)
{
    const sample_job *job = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) sample_cell(job->scan, k, job->out);
}

bool cell_samples_take(const surface *scan, threads *pool, cell_samples *out, error *e)
{
    const char *what = "samples of the surface's cells";
    *out = (cell_samples){0};
    out->position = mem_array(scan->cells, sizeof *out->position, what, e);
    out->normal = mem_array(scan->cells, sizeof *out->normal, what, e);
    out->patch = mem_array(scan->cells, sizeof *out->patch, what, e);
    out->found = mem_array(scan->cells, sizeof *out->found, what, e);
    if (!out->position || !out->normal || !out->patch || !out->found) return false;
    sample_job job = {scan, out};
    threads_run(pool, scan->cells, THREADS_GRAIN, sample_chunk, &job);
    return true;
}

void cell_samples_free(cell_samples *s)
{
    free(s->position);
    free(s->normal);
    free(s->patch);
    free(s->found);
}

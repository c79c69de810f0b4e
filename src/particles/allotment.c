#include "particles/allotment.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "packing/packing.h"
#include "particles/population.h"

/* Rows take room from the packing, which makes the spacing wider and the rows shorter: so often this is gone through. And so
 * often the patches are looked for that have room besides; each time there are fewer. */
enum { PASSES = 4, ROOM_PASSES = 20 };
/* Rows take no more than this share of the points. */
static const double ROWS_MOST = 0.9;
/* Patches that are a smaller share of the surface do not set the spacing of all, where no other has room. */
static const double LEAST_SHARE = 0.01;

/* A patch of fewer cells gets no more than these, whatever its curves leave. */
static const double LEAST_CELLS = 0.5;
static const double LONELY_MOST = 0.25;

static const char *const WHAT = "the particles of each patch";

/* The share of a patch in all points. */
static double share_of(const allotment_input *in, size_t patch)
{
    const double *weight = sizing_field_weight(in->sizing, in->scan);
    const components *parts = &in->scan->parts;
    return (weight[parts->begin[patch + 1]] - weight[parts->begin[patch]]) / weight[in->scan->cells];
}

static bool make_rows(const allotment_input *in, double spacing, size_t most, curve_rows *out, error *e)
{
    const boundary_request request = {spacing, in->sizing, in->even, most};
    curve_rows_free(out);
    return curve_rows_make(in->field, &request, out, e);
}

/* What a patch takes besides its rows where all of the surface takes so many cells, or less than 0: its curves leave no room. */
static double room_of(const allotment_input *in, const curve_rows *rows, size_t patch, double cells)
{
    const double all = share_of(in, patch) * cells, border = rows->border[patch];
    return all - (all < LEAST_CELLS ? fmax(border, 0) : border);
}

/* What all patches take besides their rows. */
static double sum_of_rooms(const allotment_input *in, const curve_rows *rows, double cells)
{
    double sum = 0;
    for (size_t k = 0; k < in->field->patches->count; k++) sum += fmax(room_of(in, rows, k, cells), 0);
    return sum;
}

/* How many cells make room for `count` particles besides the rows. A patch with no room leaves what its rows have too much to no
 * other. */
static double cells_for(const allotment_input *in, const curve_rows *rows, double count)
{
    double cells = INFINITY, share = 1, border = 0;
    for (size_t k = 0; k < in->field->patches->count; k++) border += rows->border[k];
    for (int pass = 0; pass < ROOM_PASSES && share > LEAST_SHARE && count + fmax(border, 0) < cells * share;
         pass++) {
        cells = (count + fmax(border, 0)) / share;
        share = border = 0;
        for (size_t k = 0; k < in->field->patches->count; k++) {
            const double room = room_of(in, rows, k, cells), part = share_of(in, k);
            if (!(room > 0)) continue;
            share += part;
            border += part * cells - room;
        }
    }
    return cells;
}

/* A patch without a place on a curve would have no point: it has one, unless these would be more than LONELY_MOST of all. They
 * take no part in the rest. Returns how many there are. */
static size_t serve_lonely(const allotment *a, size_t patches, size_t count, double *wanted, uint32_t *served)
{
    size_t lonely = 0;
    for (size_t k = 0; k < a->rows.stands; k++) served[a->rows.patch[k]] = 1;
    for (size_t k = 0; k < patches; k++) lonely += served[k] = !served[k] && wanted[k] > 0 && wanted[k] < 1;
    if ((double)lonely > LONELY_MOST * (double)count) lonely = 0;
    for (size_t k = 0; k < patches; k++) {
        if (lonely == 0) served[k] = 0;
        if (served[k]) wanted[k] = 0;
    }
    return lonely;
}

/* Shares out `count` particles, each patch to within one of its part of what the cells behind the rows leave. */
static bool share_out(const allotment_input *in, double cells, size_t count, allotment *out, error *e)
{
    size_t patches = in->field->patches->count;
    out->free = mem_array(patches, sizeof *out->free, WHAT, e);
    double *wanted = mem_array(patches, sizeof *wanted, WHAT, e), sum = 0, seen = 0;
    bool ok = out->free && wanted;
    for (size_t k = 0; ok && k < patches; k++) wanted[k] = fmax(room_of(in, &out->rows, k, cells), 0);
    if (ok) count -= serve_lonely(out, patches, count, wanted, out->free);
    for (size_t k = 0; ok && k < patches; k++) sum += wanted[k];
    for (size_t k = 0; ok && !(sum > 0) && k < patches; k++) wanted[k] = share_of(in, k);
    if (!(sum > 0)) sum = 1;
    for (size_t k = 0; ok && k < patches; k++) { /* what rounding takes from one goes to the next */
        double before = round(seen);
        seen = k + 1 < patches ? seen + wanted[k] * ((double)count / sum) : (double)count;
        out->free[k] += (uint32_t)fmax(round(seen) - before, 0);
        out->free_count += out->free[k];
    }
    free(wanted);
    return ok;
}

bool allotment_for_count(const allotment_input *in, size_t count, allotment *out, error *e)
{
    double cells = (double)count;
    size_t most = (size_t)(ROWS_MOST * (double)count);
    *out = (allotment){0};
    for (int pass = 0; pass < PASSES; pass++) {
        out->spacing = packing_spacing(in->scan->area, cells);
        if (!make_rows(in, out->spacing, most, &out->rows, e)) return false;
        cells = cells_for(in, &out->rows, (double)(count - out->rows.count));
    }
    return share_out(in, cells, count - out->rows.count, out, e);
}

bool allotment_for_spacing(const allotment_input *in, double spacing, size_t most, allotment *out, error *e)
{
    double cells = packing_count(in->scan->area, spacing);
    *out = (allotment){.spacing = spacing};
    if (!make_rows(in, spacing, most, &out->rows, e)) return false;
    return share_out(in, cells, (size_t)round(sum_of_rooms(in, &out->rows, cells)), out, e);
}

void allotment_free(allotment *a)
{
    curve_rows_free(&a->rows);
    free(a->free);
    *a = (allotment){0};
}

void allotment_add_rows(const allotment *a, particles *p)
{
    const curve_rows *r = &a->rows;
    for (size_t k = 0; k < r->stands; k++) {
        size_t i = p->count++;
        p->position[i] = r->position[r->place[k]];
        p->normal[i] = r->normal[k];
        p->patch[i] = r->patch[k];
        p->place[i] = r->place[k];
        p->lambda[i] = 0;
    }
}

bool allotment_replace_rows(const allotment *a, particles *p, error *e)
{
    bool *gone = mem_array(p->count, sizeof *gone, WHAT, e);
    if (!gone) return false;
    for (size_t i = 0; i < p->count; i++) gone[i] = particles_is_fixed(p, i);
    population_remove(p, gone);
    free(gone);
    allotment_add_rows(a, p);
    return true;
}

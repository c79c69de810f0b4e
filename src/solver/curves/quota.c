#include "solver/curves/quota.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "geometry/block_map.h"
#include "packing/packing.h"
#include "solver/particles/population.h"

/* Rows take room from the packing, which makes the spacing wider and the rows shorter: so often this is gone through. And so
 * often the patches are looked for that have room besides; each time there are fewer. */
enum { PASSES = 4, ROOM_PASSES = 20 };
/* Rows take no more than this share of the points. */
static const double ROWS_MOST = 0.9;
/* A patch of fewer cells gets no more than these, whatever its curves leave. */
static const double LEAST_CELLS = 0.5;
/* Patches of less than a point have no more than this share of the points. */
static const double LONELY_MOST = 0.25;
/* In spacings: what is nearer to a place takes no point of its own. */
static const double NEAR = 0.6;

static const char *const WHAT = "the particles of each patch";

/* The share of a patch in all points. */
static double share_of(const quota_input *in, size_t patch)
{
    const double *weight = sizing_field_weight(in->sizing, in->scan);
    const components *parts = &in->scan->parts;
    return (weight[parts->begin[patch + 1]] - weight[parts->begin[patch]]) / weight[in->scan->cells];
}

static bool make_rows(const quota_input *in, double spacing, size_t most, curve_samples *out, error *e)
{
    const boundary_request request = {spacing, in->sizing, in->even, most};
    curve_samples_free(out);
    return curve_samples_make(in->field, &request, out, e);
}

/* What a patch takes besides its rows where all of the surface takes so many cells, or less than 0: its curves leave no room. */
static double room_of(const quota_input *in, const curve_samples *rows, size_t patch, double cells)
{
    const double all = share_of(in, patch) * cells, border = rows->border[patch];
    return all - (all < LEAST_CELLS ? fmax(border, 0) : border);
}

/* What all patches take besides their rows. */
static double sum_of_rooms(const quota_input *in, const curve_samples *rows, double cells)
{
    double sum = 0;
    for (size_t k = 0; k < in->field->patches->count; k++) sum += fmax(room_of(in, rows, k, cells), 0);
    return sum;
}

/* What becomes of a patch when all is shared out. */
enum { SHARES, HAS_ONE, HAS_NONE };

/* How many cells make room for `count` particles besides the rows, on patches that share them. A patch with no room leaves what its
 * rows have too much to no other. */
static double cells_for(const quota_input *in, const curve_samples *rows, const unsigned char *fate,
                        double count)
{
    double cells = INFINITY, share = 0, border = 0;
    for (size_t k = 0; k < in->field->patches->count; k++) {
        if (fate[k] != SHARES) continue;
        share += share_of(in, k);
        border += fmax(rows->border[k], 0); /* no less: cells only fall */
    }
    if (!(share > 0)) return count;
    for (int pass = 0; pass < ROOM_PASSES && share > 0 && count + fmax(border, 0) < cells * share; pass++) {
        cells = (count + fmax(border, 0)) / share;
        share = border = 0;
        for (size_t k = 0; k < in->field->patches->count; k++) {
            const double room = room_of(in, rows, k, cells), part = share_of(in, k);
            if (fate[k] != SHARES || !(room > 0)) continue;
            share += part;
            border += part * cells - room;
        }
    }
    return cells;
}

/* A patch without a place on a curve, and with room for less than a point. */
typedef struct lonely {
    double room;
    uint32_t patch;
} lonely;

static int compare_lonely(const void *left, const void *right)
{
    const lonely *a = left, *b = right;
    if (a->room != b->room) return a->room < b->room ? 1 : -1;
    return (a->patch > b->patch) - (a->patch < b->patch);
}

static lonely *list_lonely(const quota_input *in, const curve_samples *rows, double cells, size_t *count,
                           error *e)
{
    const size_t patches = in->field->patches->count;
    lonely *list = mem_array(patches, sizeof *list, WHAT, e);
    bool *stands = mem_array(patches, sizeof *stands, WHAT, e);
    *count = 0;
    for (size_t k = 0; stands && k < rows->copies; k++) stands[rows->patch[k]] = true;
    for (uint32_t k = 0; list && stands && k < patches; k++) {
        const double room = room_of(in, rows, k, cells);
        if (!stands[k] && room > 0 && room < 1) list[(*count)++] = (lonely){room, k};
    }
    if (!stands) {
        free(list);
        list = NULL;
    }
    free(stands);
    if (list && *count > 0) qsort(list, *count, sizeof *list, compare_lonely);
    return list;
}

/* Places in boxes, none of which is smaller than what is near. */
typedef struct crowd {
    block_map boxes;
    vec3 origin;
    double side;
    uint32_t *last,
        *before; /* of each box its last place, of each place the one before it in its box; or NOWHERE */
    vec3 *place;
    uint32_t count;
} crowd;

static const uint32_t NOWHERE = UINT32_MAX;

static bool crowd_init(crowd *c, const quota_input *in, double spacing, size_t most, error *e)
{
    const double largest = in->sizing ? sizing_field_describe(in->sizing).largest / in->even : 1;
    *c = (crowd){.origin = in->scan->box.min, .side = NEAR * spacing * largest};
    c->last = mem_array(most, sizeof *c->last, WHAT, e);
    c->before = mem_array(most, sizeof *c->before, WHAT, e);
    c->place = mem_array(most, sizeof *c->place, WHAT, e);
    return c->last && c->before && c->place && block_map_init(&c->boxes, 1024, e);
}

static void crowd_free(crowd *c)
{
    block_map_free(&c->boxes);
    free(c->last);
    free(c->before);
    free(c->place);
}

static void box_of(const crowd *c, vec3 x, int32_t out[3])
{
    for (int axis = 0; axis < 3; axis++)
        out[axis] = (int32_t)floor((vec3_get(x, axis) - vec3_get(c->origin, axis)) / c->side);
}

static bool crowd_add(crowd *c, vec3 x, error *e)
{
    const uint32_t boxes = c->boxes.count;
    int32_t at[3];
    uint32_t box;
    box_of(c, x, at);
    if (!block_map_find_or_add(&c->boxes, at[0], at[1], at[2], &box, e)) return false;
    c->before[c->count] = box == boxes ? NOWHERE : c->last[box];
    c->place[c->count] = x;
    c->last[box] = c->count++;
    return true;
}

static bool crowd_has(const crowd *c, vec3 x, double within)
{
    int32_t at[3];
    box_of(c, x, at);
    for (int n = 0; n < 27; n++) {
        const uint32_t box =
            block_map_find(&c->boxes, at[0] + n % 3 - 1, at[1] + n / 3 % 3 - 1, at[2] + n / 9 - 1);
        for (uint32_t k = box == BLOCK_MAP_NONE ? NOWHERE : c->last[box]; k != NOWHERE; k = c->before[k])
            if (vec3_norm2(vec3_sub(c->place[k], x)) < within * within) return true;
    }
    return false;
}

static vec3 place_on(const quota_input *in, uint32_t patch)
{
    field_cell cell;
    vec3 sum = {0, 0, 0};
    surface_cell(in->scan, in->scan->parts.begin[patch], &cell);
    for (int k = 0; k < 8; k++) sum = vec3_axpy(0.125, cell.corner[k], sum);
    return sum;
}

/* Lonely patches have no part in what is shared out. One has a point of its own, unless a place on a curve or a larger lonely
 * one is near it; but none has if these were more than LONELY_MOST of all. `fate` of each patch; *served: how many have one. */
static bool serve_lonely(const quota_input *in, const curve_samples *rows, double spacing, double cells,
                         size_t count, unsigned char *fate, size_t *served, error *e)
{
    const boundary_request request = {spacing, in->sizing, in->even, 0};
    size_t found;
    lonely *list = list_lonely(in, rows, cells, &found, e);
    crowd points = {0};
    bool ok = list && crowd_init(&points, in, spacing, rows->count + found, e);
    *served = 0;
    memset(fate, SHARES, in->field->patches->count);
    for (size_t k = 0; ok && k < rows->count; k++) ok = crowd_add(&points, rows->position[k], e);
    for (size_t k = 0; ok && k < found; k++) {
        const vec3 x = place_on(in, list[k].patch);
        const bool near = crowd_has(&points, x, NEAR * boundary_spacing(&request, x));
        fate[list[k].patch] = near ? HAS_NONE : HAS_ONE;
        *served += !near;
        ok = near || crowd_add(&points, x, e);
    }
    if ((double)*served > LONELY_MOST * (double)count) {
        memset(fate, SHARES, in->field->patches->count);
        *served = 0;
    }
    crowd_free(&points);
    free(list);
    return ok;
}

/* Shares out `count` particles: one for each lonely patch that is to have one, and each other patch to within one of its part
 * of what the cells behind the rows leave. */
static bool share_out(const quota_input *in, double cells, const unsigned char *fate, size_t count,
                      quota *out, error *e)
{
    size_t patches = in->field->patches->count;
    out->free = mem_array(patches, sizeof *out->free, WHAT, e);
    double *wanted = mem_array(patches, sizeof *wanted, WHAT, e), sum = 0, seen = 0;
    bool ok = out->free && wanted;
    for (size_t k = 0; ok && k < patches; k++) {
        wanted[k] = fate[k] == SHARES ? fmax(room_of(in, &out->rows, k, cells), 0) : 0;
        out->free[k] = fate[k] == HAS_ONE;
        count -= fate[k] == HAS_ONE;
        sum += wanted[k];
    }
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

bool quota_for_count(const quota_input *in, size_t count, quota *out, error *e)
{
    double cells = (double)count;
    size_t most = (size_t)(ROWS_MOST * (double)count), served = 0;
    unsigned char *fate = mem_array(in->field->patches->count, 1, WHAT, e);
    *out = (quota){0};
    bool ok = fate != NULL;
    for (int pass = 0; ok && pass < PASSES; pass++) {
        out->spacing = packing_spacing(in->scan->area, cells);
        ok = make_rows(in, out->spacing, most, &out->rows, e) &&
             serve_lonely(in, &out->rows, out->spacing, cells, count - out->rows.count, fate, &served, e);
        if (ok) cells = cells_for(in, &out->rows, fate, (double)(count - out->rows.count - served));
    }
    ok = ok && share_out(in, cells, fate, count - out->rows.count, out, e);
    free(fate);
    return ok;
}

bool quota_for_spacing(const quota_input *in, double spacing, size_t most, quota *out, error *e)
{
    double cells = packing_count(in->scan->area, spacing);
    size_t served = 0, count;
    unsigned char *fate = mem_array(in->field->patches->count, 1, WHAT, e);
    *out = (quota){.spacing = spacing};
    bool ok = fate && make_rows(in, spacing, most, &out->rows, e);
    if (ok) {
        count = (size_t)round(sum_of_rooms(in, &out->rows, cells));
        ok = serve_lonely(in, &out->rows, spacing, cells, count, fate, &served, e) &&
             share_out(in, cells, fate, count + served, out, e);
    }
    free(fate);
    return ok;
}

void quota_free(quota *a)
{
    curve_samples_free(&a->rows);
    free(a->free);
    *a = (quota){0};
}

void quota_add_rows(const quota *a, particles *p)
{
    const curve_samples *r = &a->rows;
    for (size_t k = 0; k < r->copies; k++) {
        size_t i = p->count++;
        p->position[i] = r->position[r->place[k]];
        p->normal[i] = r->normal[k];
        p->patch[i] = r->patch[k];
        p->place[i] = r->place[k];
        p->hint[i] = FIELD_NO_HINT;
        p->lambda[i] = 0;
    }
}

bool quota_replace_rows(const quota *a, particles *p, error *e)
{
    bool *gone = mem_array(p->count, sizeof *gone, WHAT, e);
    if (!gone) return false;
    for (size_t i = 0; i < p->count; i++) gone[i] = particles_is_fixed(p, i);
    population_remove(p, gone);
    free(gone);
    quota_add_rows(a, p);
    return true;
}
